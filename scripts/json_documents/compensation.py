"""Documents of `replay`, with and without an export, `counterfactual` and `export`."""

from __future__ import annotations

from typing import Any, Literal

from typing_extensions import TypedDict

from scripts.json_documents.parts import Document, Head, Number, Observer, Six, Three


class Quantiles(TypedDict):
    p5: Number
    p50: Number
    p95: Number
    max: Number


class Saturation(TypedDict):
    rotor_speed: int
    tilt_rate: int
    tilt_range: int
    held: int
    """Steps with an angle held."""


class Replay(Document):
    flight: str
    axes: list[str]
    unmeasured: list[str]
    settings: dict[str, Any]
    """Of the compensator; null for a default."""
    source: Literal["desired", "commanded"]
    """Logged wrench that was the input."""
    steps: int
    duration: float
    restarts: int
    """Fresh starts after gaps."""
    correction_mean_abs: Six
    correction_max_abs: Six
    accepted: Number
    """Share of the steps whose optimum solves the problem."""
    iterations_mean: Number
    sigma: Quantiles
    """Over the steps."""
    sigma_threshold: Number
    beta: Quantiles
    held_back: Number
    """Share of the steps with beta above 0.5."""
    outputs: list[str]
    error_before_mean_abs: list[Number]
    """Predicted wrench error abs(mu(W)) without the correction."""
    error_after_mean_abs: list[Number]
    """Predicted wrench error abs(mu(W + dW) + dW) with it."""
    error_before_max_abs: list[Number]
    error_after_max_abs: list[Number]
    error_fall: list[Number]
    """1 - after / before."""
    measured_minus_logged: Six
    """Mean absolute difference of the measured wrench from the command."""
    measured_minus_predicted: Six
    """The same from model and GP."""
    eigenvalue_min: Number
    """Of I + dmu/dW along the log."""
    near_singular: Number
    """Share of the commands where that is below 0.2."""
    saturation: Saturation | None
    """Steps limited with the correction."""
    saturation_logged: Saturation | None
    """Steps limited without it."""
    solve_mean_ms: Number
    """Wall clock of a step, mean over blocks of 128; `solve_*_ms` are the only numbers that differ between two runs."""
    solve_p99_ms: Number
    solve_max_ms: Number
    trouble: dict[str, int]
    """Messages, and the number of their steps."""
    warnings: list[str]


class Deviation(TypedDict):
    number: int
    time: Number
    quantity: str
    flown: Number
    made: Number
    status_flown: str
    status_made: str


class ReplayExport(Document):
    proved: bool
    """The export made every recorded output, and nothing else changed its state."""
    summary: str
    export: str
    folder: str
    precision: Literal["double", "float"]
    records: int
    identical: int
    """Periods that agree to the last bit."""
    agree: int
    """Periods within `tolerance`."""
    state_changed: int
    """Periods before which the state was changed from outside."""
    out_of_order: int
    """Periods whose number repeats or goes back without `wg_reset`."""
    largest_difference: Number
    largest_difference_of_state: Number
    tolerance: Number
    starts: int
    """Periods after `wg_reset`."""
    lost: int
    """Periods not recorded."""
    damaged: int
    """Periods that begin like a record and are none."""
    repeated: int
    """Repeats."""
    other_exports: dict[str, int]
    """Periods of other exports."""
    statuses: dict[str, int]
    deviations: list[Deviation]
    """The first ten that do not agree."""
    warnings: list[str]


class NullRun(TypedDict):
    attitude_deg_max: Number
    attitude_deg_rms: Number
    position_m_max: Number
    position_m_rms: Number
    duration_s: float


class AttitudeError(TypedDict):
    mean_abs: Three
    """Of e_R about x, y, z: the sine of the error angle."""
    median_abs: Three
    rms: Three


class PositionError(TypedDict):
    mean: Number
    """Of the distance from the reference."""
    median: Number
    rms: Number
    max: Number


class Tracking(TypedDict):
    attitude_error: AttitudeError
    position_error_m: PositionError
    duration_s: float


class Disturbance(TypedDict):
    mean: Six
    rms: Six
    rms_above_10_hz: Six
    max_abs: Six
    pull_rms: Six
    """The part that kept the integration on the recorded motion."""


class Counterfactual(Document):
    flight: str
    model: str
    changes: list[str]
    start_s: float
    null_run: NullRun
    """Nothing changed, against the recorded odometry: it bounds the accuracy of the rest. Above 0.5 deg or 2 cm
    `notes` says so.
    """
    tracking: dict[str, Tracking]
    """`recorded`, `null_run`, `counterfactual` and, with `--gp`, `uncompensated`."""
    baselines: dict[str, Tracking]
    """`--baselines`, `--feedback`: errors with other compensators; with --gp and --allocation that of the GP alone."""
    axes: list[str]
    disturbance: Disturbance
    """What the model does not explain, about O in B."""
    unmeasured: list[str]
    stability_margin: Number
    observer: Observer | None
    controller_explained: Six
    """Share of the desired wrench's variance that the model's control law explains; null where it hardly moved."""
    lost: str | None
    """When and why control was lost."""


class Operations(TypedDict):
    add: int
    multiply: int
    divide: int
    sqrt: int
    exp: int
    trig: int
    other: int


class OperationsOfStep(TypedDict):
    usual: Operations
    """Mean of the recorded steps."""
    at_worst: Operations


class Evaluations(TypedDict):
    usual: float
    at_worst: float


class Bytes(TypedDict):
    constants: int
    state: int
    stack: int
    """An upper bound."""


class ExportLoop(TypedDict):
    lag_s: float
    delay_s: float


class ExportObserver(TypedDict):
    hz: float
    lag_s: float
    torque_max_nm: Three
    sensitivity_peak: Number
    loop: ExportLoop


class Export(Head):
    folder: str
    files: list[str]
    vehicle: str
    outputs: list[str]
    effects: list[str]
    """Those that are in it."""
    corrected: str
    """Which axes, and by what."""
    left_out: dict[str, str]
    """Effects that are not in it: the reason."""
    precision: Literal["double", "float"]
    dt: float
    points: int
    further_inputs: list[str]
    observer: ExportObserver | None
    """With the bounds of its estimate."""
    solved: Number
    """Share of the recorded steps that the search solves."""
    warnings: list[str]
    operations: OperationsOfStep
    """Of one step."""
    evaluations: Evaluations
    """Of the model in one step."""
    bytes: Bytes
