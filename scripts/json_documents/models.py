"""Documents of `add`, `remove`, `history`, `model`, `calibrate`, `trend` and `learn`."""

# Long because documents of models share these parts, each of which refers to those above it.

from __future__ import annotations

from typing import Any, Literal, NotRequired

from typing_extensions import TypedDict

from scripts.json_documents.comparison import Comparison
from scripts.json_documents.parts import (
    Absorption,
    AutopilotParameters,
    Document,
    Fitted,
    HeldOut,
    Number,
    Observer,
    Six,
    Three,
)
from wrenchgap.learn.identify.calibrate import Fate


class Add(Document):
    model: str
    model_version: int
    effects: list[Fitted]
    refitted: NotRequired[list[str]]
    """Effects that the model had already."""
    axes: NotRequired[list[str]]
    unmeasured: NotRequired[list[str]]
    cutoff_hz: NotRequired[float]
    rms_before: NotRequired[Six]
    rms_after: NotRequired[Six]
    between_flights: NotRequired[Six | None]
    """By how much the fitted flights differ on average (standard deviations); null where they do not."""
    at_bound: NotRequired[list[str]]
    """Parameters that ended at a limit of their plausible range."""
    held_out: NotRequired[HeldOut | None]
    """Null where the logs are too short."""


class Remove(Document):
    model: str
    model_version: int
    removed: list[str]
    effects: list[Fitted]


class File(TypedDict):
    file: str
    sha256: str


class ChangedValue(TypedDict):
    effect: str
    parameter: str
    before: Number
    before_std: Number
    after: Number
    after_std: Number
    unit: str


class ModelVersion(TypedDict):
    version: int
    date: str | None
    command: str
    wrenchgap: str | None
    file: str | None
    """Null, `as given`, or `changed by hand` where no command wrote it."""
    content_sha256: str
    """Of the file without its history."""
    parent_sha256: str | None
    flights: list[File]
    held_out: HeldOut | None
    added: list[str]
    removed: list[str]
    changed: list[ChangedValue]
    effects: list[Fitted]


class History(Document):
    model: str
    axes: list[str]
    changed_by_hand_since: bool
    """The file changed after its last version."""
    versions: list[ModelVersion]
    """Oldest first."""


class Tolerances(TypedDict):
    mass: Number
    """This and the others are null where nothing is said; `thrust` is relative, `thrust_axis` in radians."""
    inertia: list[list[Number]] | None
    com: Three | None
    imu_position: Three | None
    thrust: Number
    thrust_axis: Number


class Rotor(TypedDict):
    rotor: str
    x: float
    y: float
    z: float
    spin: int
    c_f: float
    kappa: float
    radius: Number
    thrust_max: Number


class Command(TypedDict):
    unit: str
    """That of the log."""
    gives: Literal["thrust", "speed"]
    source: str
    """Where the curve comes from."""
    hover: Number
    """The command that hovers."""


class Model(Document):
    model: NotRequired[str]
    name: str
    mass: float
    inertia: list[Three]
    com: Three
    imu_position: Three
    tolerances: Tolerances
    rotors: list[Rotor]
    """In the order of logged commands."""
    full_thrust_over_weight: Number
    command: Command | None
    effects: list[Fitted]
    assumed: list[str]
    """What nobody said, and where the value comes from."""


class Tried(TypedDict):
    effect: str
    fate: Fate
    """`one flight`: helps within flights, not on flights left out whole; `at its limit`: a parameter ended at
    the limit of what is plausible.
    """
    t: Number
    lack: str | None
    reason: str | None


class Trimmed(TypedDict):
    effect: str
    name: str
    unit: str
    value: Number
    std: Number
    """With the scatter between flights."""
    scatter: Number
    """Null of one flight."""
    values: list[Number]
    """Each flight's own."""


class Unseen(TypedDict):
    flight: str
    rms_before: Six
    rms_after: Six


class Calibrate(Document):
    model: str
    model_version: int
    summary: list[str]
    flights: list[str]
    axes: list[str]
    unmeasured: list[str]
    cutoff_hz: float
    effects: list[Fitted]
    tried: list[Tried]
    parameters: list[Trimmed]
    rms_before: list[Six]
    rms_after: list[Six]
    unseen: list[Unseen]
    """Of `--validate`."""
    hidden_rotor: dict[str, str | float] | None
    """`parameter` and `change` [1] of a rotor's thrust that is found with the given model, not with what helps."""
    held_out: HeldOut | None
    between_flights: Six | None
    at_bound: list[str]
    """Parameters that ended at a limit of their plausible range."""


class Step(TypedDict):
    flight: str
    index: int
    """From 0."""
    before: Number
    after: Number
    size: Number
    low: Number
    """95 %, with `high`."""
    high: Number
    t: Number
    p: Number
    """Of one as large without any, corrected for the places and parameters tested."""


class Drift(TypedDict):
    slope: Number
    """By flight."""
    low: Number
    """95 %, with `high`."""
    high: Number
    t: Number
    p: Number
    """Of one as large without any, corrected for what was tested."""


class ParameterTrend(TypedDict):
    effect: str
    name: str
    unit: str
    values: list[Number]
    std: list[Number]
    """As in `add`."""
    errors: list[Number]
    """`std` without the law's own error, which is alike on all flights."""
    where: str | None
    verdict: Literal["steady", "steps", "drift", "scattered", "few", "open"]
    """`scattered`: flights differ, in neither way; `few`: fewer than four; `open`: not shown by these flights."""
    scatter: Number
    """Deviation about the level."""
    level: list[Number]
    """Mean of the segment, or the line, at each flight."""
    steps: list[Step]
    drift: Drift | None
    apart: list[str]
    """Flights outside the scatter of the others."""
    at_limit: list[str]


class NotFitted(TypedDict):
    effect: str
    flight: str
    reason: str


class Trend(Document):
    verdict: Literal["changed", "scattered", "steady", "few"]
    """`scattered`: no step and no drift, and flights differ; `few`: fewer than four flights."""
    summary: str
    model: str
    effects: list[str]
    flights: list[str]
    dates: list[str | None]
    """UTC; null where a log has none."""
    parameters: list[ParameterTrend]
    inspect: list[str]
    significant: float
    """`p` below which a step or a drift counts."""
    axes: list[str]
    rms: list[Six]
    unmeasured: list[str]
    effects_left_out: list[NotFitted]
    autopilot_parameters: AutopilotParameters
    """Which parameters of the autopilot differ between the flights."""
    cutoff_hz: float


class Within(TypedDict):
    within_95: list[Number]
    within_3_sigma: list[Number]


class Coverage(TypedDict):
    before: Within
    after: Within


class Conditioning(TypedDict):
    percentile_1: Number
    """Of the smallest eigenvalue of I + dmu/dW along the training commands."""
    median: Number
    maximum: Number


class StabilityMargin(TypedDict):
    percentile_1: Number
    """At most 1e6; with lag and delay of the actuators."""
    lag_s: float
    delay_s: float


class OutputVerdict(TypedDict):
    output: str
    decision: Literal["compensate", "do not", "needs"]
    reason: str
    """`helps`, `nothing`, `lag`, `worse`, `inputs`, `excitation` or `longer`."""
    gain: Number
    reduction: list[Number]
    """With its 95 % interval."""
    summary: str


class Alternative(TypedDict):
    inputs: list[str]
    inference: str
    rms: list[Number]
    gain: Number
    significance: Number
    best: bool


class Learn(Document):
    gp: str
    axes: list[str]
    unmeasured: list[str]
    outputs: list[str]
    """Axes learnt."""
    settings: dict[str, Any]
    samples: int
    points: int
    """Samples kept."""
    spacing_s: float
    """Between samples."""
    cutoff_hz: float
    physics: str
    """Effects under the GP, or `nominal`."""
    sigma_prior: list[Number]
    """Far from the data."""
    sigma_training: list[Number]
    """99th percentile over the data."""
    sigma_scale: list[Number]
    """Factor of calibration."""
    coverage: dict[str, Coverage]
    """`training` and `unseen` flights: shares within 1.96 and 3 sigma, before and after calibration."""
    conditioning: Conditioning
    stability_margin: StabilityMargin
    observer: Observer | None
    lags_s: list[Number]
    """Lag that was not learnt as a function."""
    blind: list[str]
    """Components of the command that the GP does not look at."""
    verdicts: list[OutputVerdict]
    training: Comparison
    validation: Comparison | None
    warnings: list[str]
    alternatives: list[Alternative]
    """Other inputs and inferences on held-out time."""
    absorbs: Absorption | None
    """Effects that the GP reproduces."""
