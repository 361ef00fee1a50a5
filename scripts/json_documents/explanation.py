"""Documents of `explain` and `changed`."""

from __future__ import annotations

from typing import Literal

from typing_extensions import TypedDict

from scripts.json_documents.comparison import Comparison, Relevance
from scripts.json_documents.parts import Document, Fitted, Number, Six, Three, Timing, Untried, Value


class Settle(TypedDict):
    kind: Literal["bench", "flight"]
    what: str
    separates: list[list[list[str]]]


class WeightedSet(TypedDict):
    effects: list[str]
    weight: float


class Established(TypedDict):
    effect: str
    parameters: dict[str, Number]


class Class(TypedDict):
    weight: float
    sets: list[WeightedSet]
    established: list[Established]
    settle: list[Settle]


class Rival(TypedDict):
    effect: str
    separation: Number
    cosine: Number
    alike: bool
    weight: Number


class Member(TypedDict):
    effect: str
    probability: Number
    share: Number
    significance: Number
    evidence: Number
    group: list[str]
    rivals: list[Rival]


class Band(TypedDict):
    axis: str
    low_hz: float
    high_hz: float
    over_noise: float


class Oscillation(TypedDict):
    frequency_hz: float
    damping: float
    frame: Literal["E", "B"] | None
    share: float
    significance: Number
    words: str


class OneRotor(TypedDict):
    rotors: list[str]
    share: float


class Residual(TypedDict):
    over_noise: Number
    in_worst_tenth: Number
    bands: list[Band]
    swing: Oscillation | None
    one_rotor: OneRotor | None
    depends_on: Relevance | None


class Candidate(TypedDict):
    effect: str
    heldout_fall: Six
    score: Number
    parameters: list[Value]
    evidence: Number
    significance: Number
    companions: list[str]
    implausible: list[str]


class Step(TypedDict):
    on: list[str]
    chosen: str | None
    alike: list[str]
    candidates: list[Candidate]


class Air(TypedDict):
    wind_E: Three
    std: Three


class Range(TypedDict):
    quantity: str
    unit: str
    maximum: Number
    percentile: Number
    outside: bool


class FlightRanges(TypedDict):
    flight: str
    ranges: list[Range]


class Validation(Comparison):
    fall: Six
    ranges: list[FlightRanges]
    warnings: list[str]


class Limit(TypedDict):
    effect: str
    parameter: str
    unit: str
    plausible: float
    size: float | None
    instead: list[str]


class Injected(TypedDict):
    effect: str
    parameter: str
    unit: str
    size: float
    share: float
    firm: bool
    as_stated: bool
    others: list[str]


class Sensitivity(TypedDict):
    limits: list[Limit]
    injected: list[Injected]
    summary: list[str]


class ExplainBody(TypedDict):
    verdict: Literal["effect", "group", "unknown", "nothing"]
    effects: list[str]
    groups: list[list[str]]
    members: list[Member]
    left: Residual
    ranking: list[Candidate]
    axes: list[str]
    summary: str
    fitted: list[Fitted]
    steps: list[Step]
    classes: list[Class]
    settle: list[Settle]
    firm: list[str]
    open: list[str]
    air: Air | None
    dropped: list[str]
    not_tried: list[Untried]
    sensitivity: Sensitivity
    rms_before: Six
    rms_after: Six
    noise: Six
    unmeasured: list[str]
    validation: Validation | None
    flights: list[str]
    timing: list[Timing]
    cutoff_hz: float | None
    notes: list[str]


class Explain(Document, ExplainBody):
    pass


class ChangedParameter(TypedDict):
    effect: str
    name: str
    healthy: Number
    scatter: Number
    suspect: Number
    std: Number
    unit: str
    significance: Number
    where: str | None


class Place(TypedDict):
    effect: str
    parameter: str
    where: str
    probability: float


class Alone(TypedDict):
    effect: str
    log_odds: Number
    large: bool
    parameters: list[ChangedParameter]


class OddFlight(TypedDict):
    flight: str
    effect: str
    odds: Number


class NotCompared(TypedDict):
    quantity: str
    unit: str
    healthy: list[Number]
    suspect: list[Number]
    outside: float
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
    parameters: list[ChangedParameter]
    odd: list[str]
    odd_because: list[OddFlight]
    not_compared: list[NotCompared]
    summary: str
    inspect: list[str]
    effects: list[Confidence]
    places: list[Place]
    nothing: float
    alone: list[Alone]
    settle: list[Settle]
    healthy: list[str]
    suspect: list[str]
    scatter: Six
    scatter_from: str
    by_flight: list[ChangedFlight]
    axes: list[str]
    answering: list[str]
    by_means: bool
    louder: list[str]
    not_tried: list[Untried]
    sensitivity: Sensitivity
    unmeasured: list[str]
    timing: list[Timing]
    cutoff_hz: float
