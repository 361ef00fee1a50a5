"""Documents of the commands that put others together: `report` and `batch`."""

from __future__ import annotations

from typing import Literal, NotRequired

from typing_extensions import TypedDict

from scripts.json_documents.comparison import WhereBody
from scripts.json_documents.explanation import ExplainBody, WeightedSet
from scripts.json_documents.parts import Absorption, Document, Number, Six, Timing


class Stair(TypedDict):
    name: str
    rms: Six
    in_all: Number
    """All axes on one scale."""
    beside: bool
    """Not a step: for comparison."""
    learnt_here: bool
    """A GP learnt on these very logs."""


class StairNoise(TypedDict):
    rms: Six
    in_all: Number


class Staircase(TypedDict):
    title: str
    stairs: list[Stair]
    noise: StairNoise


class BeforeAfter(TypedDict):
    on: str
    before: WhereBody
    after: WhereBody


class NextFlight(TypedDict):
    effects: list[str]
    trajectory: str | None
    """The file's text; null where `why_not` says why."""
    why_not: NotRequired[str]
    segments: NotRequired[list[str]]
    separable: NotRequired[bool]
    separation_before: NotRequired[Number]
    separation_expected: NotRequired[Number]
    advice: NotRequired[list[str]]


class Report(Document):
    page: str
    axes: list[str]
    unmeasured: list[str]
    summary: str
    explain: ExplainBody
    staircases: list[Staircase]
    absorbs: Absorption | None
    where: BeforeAfter
    next_flights: list[NextFlight]
    """For each group."""
    fitted_model: str
    commands: list[str]
    """This, `options` and `packages` repeat the report."""
    options: dict[str, str]
    packages: dict[str, str]
    timing: list[Timing]


Same = TypedDict("Same", {"log": str, "as": str})


class Failure(TypedDict):
    log: str
    vehicle: str | None
    reason: str


class Row(TypedDict):
    log: str
    vehicle: str | None
    date: str | None
    flight: str | None
    status: str
    seconds: Number
    verdict: str | None
    rms: Six | None
    cpu_s: Number


class RankedValue(TypedDict):
    effect: str
    name: str
    value: Number
    std: Number
    unit: str


class RankedSet(TypedDict):
    set: list[str]
    effects: list[str]
    weight: float
    log_odds: Number
    """Against no effect."""
    gain: Number
    """In log likelihood on held-out flights."""
    better: Number
    """Share of held-out flights that are predicted better."""
    rms: Six
    """On held-out flights."""
    values: list[RankedValue]


class Probability(TypedDict):
    effect: str
    probability: Number


class Group(TypedDict):
    weight: float
    sets: list[WeightedSet]


class CandidateOdds(TypedDict):
    candidate: str
    log_odds: Number


class Ranking(TypedDict):
    vehicle: str | None
    reason: str
    sets: list[RankedSet]
    """Of effects; docs/batch.md."""
    repeats: list[Same]
    """Logs of a flight that another log has in another form; both count once."""
    flights: NotRequired[list[str]]
    seconds: NotRequired[float]
    held_out: NotRequired[bool]
    effects: NotRequired[list[Probability]]
    groups: NotRequired[list[Group]]
    """Sets that predict the same, the plainest first."""
    alone: NotRequired[list[CandidateOdds]]
    """Each candidate alone."""
    rms: NotRequired[Six]
    left_out: NotRequired[list[str]]


class Batch(Document):
    command: Literal["inspect", "compare", "explain", "changed"]
    output: str
    passes: int
    settled: bool
    """No member of a set that counts was found a tenth of its typical size from where it was linearised."""
    logs: int
    failed: int
    done_now: int
    """Logs of this run."""
    done_before: int
    """Logs of earlier runs."""
    same: list[Same]
    """Logs with the content of another."""
    failures: list[Failure]
    rows: list[Row]
    """One for each log (docs/batch.md)."""
    rankings: list[Ranking]
    """One for each vehicle."""
