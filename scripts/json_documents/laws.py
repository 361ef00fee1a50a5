"""The document of `discover`."""

from __future__ import annotations

from typing import Literal, NotRequired

from typing_extensions import TypedDict

from scripts.json_documents.parts import Document, Number, Six


class LawCoefficient(TypedDict):
    symbol: str
    """What it multiplies."""
    unit: str
    value: float
    std: Number


class LikeLaw(TypedDict):
    name: str
    formula: str


class LawPart(TypedDict):
    part: str
    """A flight, or a third of a single one."""
    value: float
    """Of the leading coefficient there."""
    std: Number


class NearestEffect(TypedDict):
    name: str
    cosine: float
    """Between what the law and the effect predict."""


class SeenRange(TypedDict):
    quantity: str
    low: float
    high: float


class FoundLaw(TypedDict):
    name: str
    """Of its effect, in the file of the law."""
    formula: str
    causes: list[str]
    """What it depends on."""
    coefficients: list[LawCoefficient]
    gain: float
    """[nats]"""
    null_quantile: float
    """What chance gains in one residual of twenty."""
    p_value: float
    """Share of residuals of chance in which as much was found."""
    equivalents: list[LikeLaw]
    """What predicts the same on these flights."""
    stability: float
    """Share of halves of the time in which it is found again."""
    parts: list[LawPart]
    nearest: NearestEffect | None
    mean_power: Number
    """That it feeds into the motion on average [W]; null where the velocity is not known."""
    feeding_share: float
    """Share of the time in which it does."""
    flown_ranges: list[SeenRange]
    """1 to 99 % of its quantities on these flights."""


class Discover(Document):
    summary: list[str]
    outcome: Literal["law", "depends", "nothing"]
    verdict: str
    """Of `explain`."""
    effects: list[str]
    """That `explain` named."""
    laws: list[FoundLaw]
    rejected: list[str]
    """Formulas that were found and did not hold."""
    depends: list[str]
    """On what the rest depends."""
    rms_before: Six
    """That named effects leave on held-out time."""
    rms_after: Six
    noise: Six
    energy_reduction: float
    """Share of the energy above the sensors' noise that the laws take off held-out time."""
    regression_reduction: float
    """Share of the variance that regressions on all logged quantities take off."""
    held_out: str
    tried: int
    """Laws that were tried."""
    law: NotRequired[str]
    """The file that was written."""
