"""Parts that the documents of several commands share.

A number is None where it was not finite; `NotRequired` is a key that only some options bring.
"""

from __future__ import annotations

from typing import Annotated, Literal, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

Number = float | None
Three = Annotated[list[Number], Field(min_length=3, max_length=3)]
Six = Annotated[list[Number], Field(min_length=6, max_length=6)]
Level = Literal["ok", "warn", "bad"]


class Input(TypedDict):
    role: str
    """`log`, `validation`, `healthy`, `suspect`, `model`, `against`, `believed`, `bench table`,
    `trajectory`, `gp` or `batch`."""
    file: str
    """As it was named."""
    sha256: str
    shift_s: NotRequired[dict[str, float]]
    """With `--shift`: seconds by which the stamps of each role were moved."""
    vehicle: NotRequired[str | None]


class CheckResult(TypedDict):
    flight: NotRequired[str]
    name: str
    level: Level
    words: str
    mend: str | None
    """The option that corrects it."""
    accepted: bool


class LeftOut(TypedDict):
    flight: NotRequired[str]
    start: Number
    """Null where it is open."""
    stop: Number
    """Null where it is open."""
    why: str
    """Begins with the phase (docs/checks.md), if it is one."""


class Head(TypedDict):
    schema: str
    """Name and version, as `wrenchgap.compare/1`."""
    version: str
    """Of wrenchgap."""
    inputs: list[Input]
    notes: NotRequired[list[str]]
    """Sentences that a user should read: what was assumed, repaired or left out."""
    checks: NotRequired[list[CheckResult]]
    """What was asked of each log (docs/checks.md)."""


class Document(Head):
    left_out: NotRequired[list[LeftOut]]
    """Times that are not used."""


class AutopilotParameter(TypedDict):
    name: str
    values: list[Number]
    """In the order of `logs`."""


class IgnoredParameter(TypedDict):
    name: str
    reason: str


class AutopilotParameters(TypedDict):
    logs: list[str]
    """Those with parameters of an autopilot."""
    without: list[str]
    differ: list[AutopilotParameter]
    ignored: list[IgnoredParameter]
    """They differ, and say nothing of the vehicle."""
    not_in_all: int
    """Parameters that only some of the logs have."""


class Value(TypedDict):
    name: str
    value: Number
    """Of an effect that the model has, in sets and classes, the change."""
    std: NotRequired[Number]
    unit: str


class Fitted(TypedDict):
    effect: str
    parameters: list[Value]


class HeldOut(TypedDict):
    rms_before: Six
    """On held-out time."""
    rms_after: Six
    """On held-out time."""
    noise: Six
    """Rms of the sensor noise behind the filter: about the rms of a perfect model."""
    fall: Six
    """RMS reduction, 1 - after / before."""
    verdict: str
    outcome: Literal["better", "worse", "unclear"]
    change: Number
    """Of the error energy, relative."""
    t: Number
    """Paired t of the change."""


class Loop(TypedDict):
    lag_s: float
    delay_s: float
    gains: NotRequired[str]


class Observer(TypedDict):
    hz: Number
    """Bandwidth; null where none keeps the margin."""
    lag_s: Number
    sensitivity_peak: Number
    """M_s of the whole loop."""
    left: Number
    """Share of the residual that it leaves on the training log; above 0.75 there is no observer."""
    loop: Loop
    summary: str


class Absorbed(TypedDict):
    effect: str
    cosine: Number
    """Of the GP's correction with the effect's."""
    share: Number
    """Of the GP's correction that the effect reproduces."""
    significance: Number
    """Paired t of the error that the effect removes."""
    named: bool
    """Share, cosine and significance are clear."""
    parameters: list[Value]


class Absorption(TypedDict):
    effects: list[str]
    summary: str
    tried: list[Absorbed]


class Untried(TypedDict):
    effect: str
    lack: str
    """`arms`, `tilt`, `coaxial`, `geometry` (of the model), `rotors`, `pose`, `imu`, `voltage` (of the log),
    `excitation` (of the flight), `air` (nothing on which moving air would act), `known` (to a tolerance) or
    `fit` (no possible values).
    """
    reason: str


class Part(TypedDict):
    name: str
    seconds: Number
    std: Number


class Offset(TypedDict):
    first: str
    second: str
    """The topic of which `seconds` is the delay."""
    seconds: Number
    """Positive where `second` is late; null where `problem` says why."""
    std: Number
    drift: Number
    """Slope of the offset over the flight [s/s]; null where blocks are too few."""
    drift_std: Number
    coherence: Number
    """Mean over the frequencies in use."""
    lowest_hz: Number
    """Of the frequencies in use."""
    highest_hz: Number
    """Of the frequencies in use."""
    interval_95: Number
    """Half width [s]."""
    halves: list[Part]
    """The offset in each half of the flight."""
    axes: list[Part]
    """The offset by axis."""
    bands: list[Part]
    """The offset by band of frequency."""
    blocks: int
    """Blocks of time that were taken."""
    problem: str | None


class SensorOffset(Offset):
    effect_error: Number
    """Relative error of an effect that the odometry drives."""


class Response(Offset):
    axis: str
    shape: Literal["delay", "lag", "either"] | None
    """What the phases decide."""
    lag: Number
    leaves: Number
    """Rms residual of a model without the lag."""
    residual: Number
    noise: Number
    matters: bool
    """`leaves` is worth a warning (docs/timing.md)."""


class Timing(TypedDict):
    sensors: list[SensorOffset]
    tracking: list[Offset]
    controller: Offset | None
    responses: list[Response]
    warnings: list[str]
    words: list[str]
