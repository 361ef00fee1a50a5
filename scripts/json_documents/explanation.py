"""Document of `explain`."""

from __future__ import annotations

from typing import Literal

from typing_extensions import TypedDict

from scripts.json_documents.comparison import Comparison, Relevance
from scripts.json_documents.parts import Document, Fitted, Number, Six, Three, Timing, Untried, Value


class Settle(TypedDict):
    kind: Literal["bench", "flight"]
    what: str
    separates: list[list[list[str]]]
    """Groups of sets that it tells apart."""


class WeightedSet(TypedDict):
    effects: list[str]
    weight: float


class Established(TypedDict):
    effect: str
    parameters: dict[str, Number]


class Class(TypedDict):
    weight: float
    sets: list[WeightedSet]
    """Most probable first; without effects: nothing is missing; `late_clock`: late stamps of the IMU, `late_gyroscope`:
    of a gyroscope with a low-pass of its own, `accelerometer_calibration`, `gyroscope_calibration`: the sensor's."""
    established: list[Established]
    """Effects in all of its sets."""
    settle: list[Settle]
    """What would tell its sets apart."""


class Rival(TypedDict):
    effect: str
    members: list[str]
    """In whose place: the member's, or that of several that go together."""
    separation: Number
    """Standard errors by which the set with this effect fits worse."""
    cosine: Number
    """Of the changes that the two make to the prediction."""
    alike: bool
    """It is of the same group."""
    weight: Number
    """Of that set, among all."""


class Member(TypedDict):
    effect: str
    probability: Number
    """Confidence."""
    share: Number
    """Of the error energy that returns without it."""
    significance: Number
    """Paired t."""
    evidence: Number
    """Of the set with it against the set without it, on held-out time."""
    group: list[str]
    """The effect and those that are indistinguishable from it."""
    rivals: list[Rival]
    """What other sets have in its place."""


class Band(TypedDict):
    axis: str
    low_hz: float
    high_hz: float
    over_noise: float


class Oscillation(TypedDict):
    frequency_hz: float
    damping: float
    """Damping ratio."""
    frame: Literal["E", "B"] | None
    """In which the mode is fixed; null: neither."""
    share: float
    """Of the energy above the noise that it predicts on held-out blocks."""
    significance: Number
    """Paired t."""
    words: str


class OneRotor(TypedDict):
    rotors: list[str]
    """Several where they push alike."""
    share: float
    """Of the residual that pushes in their direction."""


class Residual(TypedDict):
    over_noise: Number
    in_worst_tenth: Number
    """Of the time: share of the energy."""
    bands: list[Band]
    """Frequencies above 2.5 times the sensors' noise."""
    swing: Oscillation | None
    """A lightly damped mode."""
    one_rotor: OneRotor | None
    """The rotor in whose direction the residual pushes."""
    depends_on: Relevance | None
    """As `relevance` of `where`."""


class Candidate(TypedDict):
    effect: str
    heldout_fall: Six
    """RMS reduction on held-out time."""
    score: Number
    """Share of the error energy that it removes."""
    parameters: list[Value]
    evidence: Number
    """Log ratio of the held-out errors, summed over the axes."""
    significance: Number
    """Paired t."""
    companions: list[str]
    """Effects tried with it (`wind`)."""
    implausible: list[str]
    """Parameters at limits of their plausible range."""


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
    """Of the fitted flights."""
    percentile: Number
    """The 95th, of this flight."""
    outside: bool
    """The flight goes beyond what was fitted."""


class FlightRanges(TypedDict):
    flight: str
    ranges: list[Range]
    """Of one unseen flight, against those that were fitted."""


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
    """The smallest that alone would have been firm; null where none up to `plausible`."""
    instead: list[str]
    """Alternatives to it."""
    where: dict[str, float]
    """By name, values that parameters have of which nothing is seen without it."""


class Injected(TypedDict):
    effect: str
    parameter: str
    unit: str
    size: float
    share: float
    """Of the limit."""
    firm: bool
    as_stated: bool
    """Firm at the whole limit (below it, it need not be), and no other name was."""
    others: list[str]
    """Names that were firm with it and are not without."""


class Sensitivity(TypedDict):
    limits: list[Limit]
    """What these flights could have shown."""
    injected: list[Injected]
    """Tests of the limits."""
    summary: list[str]


class ExplainBody(TypedDict):
    verdict: Literal["effect", "group", "unknown", "nothing"]
    effects: list[str]
    """Of the named set, largest share first (docs/explain.md); several that stand for one are joined by ` + `."""
    groups: list[list[str]]
    """As `effects`, with the names that are indistinguishable."""
    members: list[Member]
    """Of the most probable set."""
    left: Residual
    """The residual."""
    ranking: list[Candidate]
    """Every candidate alone."""
    axes: list[str]
    summary: str
    already: str
    """What the given model's fitted effects hold beyond their typical size, in a line; empty where nothing does."""
    fitted: list[Fitted]
    """The chosen effects, fitted together."""
    steps: list[Step]
    """Of earlier versions' selection: one step."""
    classes: list[Class]
    """Sets that these logs cannot tell apart, the most probable first."""
    settle: list[Settle]
    """What would tell the sets apart, cheapest first."""
    firm: list[str]
    """Names in nine tenths of the weight without a group (of a form its family)."""
    open: list[str]
    """Axes on which structure is left."""
    air: Air | None
    """Velocity of the air."""
    dropped: list[str]
    """Of earlier versions' selection: empty."""
    not_tried: list[Untried]
    sensitivity: Sensitivity
    rms_before: Six
    """On held-out time."""
    rms_after: Six
    """On held-out time."""
    noise: Six
    """Rms of the sensor noise behind the filter: about the rms of a perfect model."""
    unmeasured: list[str]
    """Axes that were not measured (docs/logs.md); in lists of six they are null."""
    validation: Validation | None
    """As `compare`, for the models `given` and `explained`."""
    flights: list[str]
    timing: list[Timing]
    cutoff_hz: float | None
    notes: list[str]


class Explain(Document, ExplainBody):
    pass
