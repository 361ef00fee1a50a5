"""Document of `changed`."""

from __future__ import annotations

from typing import Literal

from typing_extensions import TypedDict

from scripts.json_documents.explanation import Class, Sensitivity, Settle
from scripts.json_documents.parts import AutopilotParameters, Document, Number, Six, Timing, Untried


class ChangedParameter(TypedDict):
    effect: str
    name: str
    healthy: Number
    scatter: Number
    """Between healthy flights."""
    suspect: Number
    std: Number
    """Of the change, from within flights."""
    unit: str
    significance: Number
    """Change over the hypotenuse of `scatter` and `std`."""
    where: str | None
    """The user's name of the rotor or arm."""


class Place(TypedDict):
    effect: str
    parameter: str
    where: str
    probability: float


class Alone(TypedDict):
    effect: str
    log_odds: Number
    """Against no change."""
    large: bool
    """Large enough for a name."""
    parameters: list[ChangedParameter]


class OddFlight(TypedDict):
    flight: str
    effect: str
    odds: Number


class NotCompared(TypedDict):
    quantity: str
    unit: str
    healthy: list[Number]
    """5th to 95th percentile."""
    suspect: list[Number]
    """5th to 95th percentile."""
    outside: float
    """Share of the suspect flights' time outside the healthy range."""
    reason: str


class EffectValue(TypedDict):
    effect: str
    name: str
    value: Number


class ChangedFlight(TypedDict):
    flight: str
    role: Literal["healthy", "odd", "suspect"]
    mean: Six
    rms: Six
    values: list[EffectValue]


class Confidence(TypedDict):
    effect: str
    confidence: float
    family: str


class Changed(Document):
    verdict: Literal["changed", "nothing", "unknown"]
    firm: list[str]
    classes: list[Class]
    """As in `explain`, of changes."""
    parameters: list[ChangedParameter]
    odd: list[str]
    """Flights given as healthy that are not."""
    odd_because: list[OddFlight]
    """The change that says most of it."""
    not_compared: list[NotCompared]
    """Quantities in which the flights do not overlap."""
    summary: str
    inspect: list[str]
    """What to look at on the vehicle."""
    effects: list[Confidence]
    places: list[Place]
    """Rotor or arm, likeliest first."""
    nothing: float
    """Weight of no change."""
    alone: list[Alone]
    """Each change alone."""
    settle: list[Settle]
    healthy: list[str]
    suspect: list[str]
    scatter: Six
    """What healthy flights differ by."""
    scatter_from: str
    """`flights` or, with one healthy flight, `typical values`."""
    by_flight: list[ChangedFlight]
    axes: list[str]
    answering: list[str]
    """Feedback-dominated axes."""
    by_means: bool
    """Means over flights alone are compared."""
    louder: list[str]
    """Axes on which suspect flights leave far more."""
    not_tried: list[Untried]
    sensitivity: Sensitivity
    """The smallest change of each parameter that would have been firm."""
    unmeasured: list[str]
    """Axes that were not measured (docs/logs.md); in lists of six they are null."""
    timing: list[Timing]
    autopilot_parameters: AutopilotParameters
    """Which parameters of the autopilot differ between the flights."""
    cutoff_hz: float
