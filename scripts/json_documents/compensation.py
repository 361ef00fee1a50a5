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


class Replay(Document):
    flight: str
    axes: list[str]
    unmeasured: list[str]
    settings: dict[str, Any]
    source: Literal["desired", "commanded"]
    steps: int
    duration: float
    restarts: int
    correction_mean_abs: Six
    correction_max_abs: Six
    accepted: Number
    iterations_mean: Number
    sigma: Quantiles
    sigma_threshold: Number
    beta: Quantiles
    held_back: Number
    outputs: list[str]
    error_before_mean_abs: list[Number]
    error_after_mean_abs: list[Number]
    error_before_max_abs: list[Number]
    error_after_max_abs: list[Number]
    error_fall: list[Number]
    measured_minus_logged: Six
    measured_minus_predicted: Six
    eigenvalue_min: Number
    near_singular: Number
    saturation: Saturation | None
    saturation_logged: Saturation | None
    solve_mean_ms: Number
    solve_p99_ms: Number
    solve_max_ms: Number
    trouble: dict[str, int]
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
    summary: str
    export: str
    folder: str
    precision: Literal["double", "float"]
    records: int
    identical: int
    agree: int
    state_changed: int
    out_of_order: int
    largest_difference: Number
    largest_difference_of_state: Number
    tolerance: Number
    starts: int
    lost: int
    damaged: int
    repeated: int
    other_exports: dict[str, int]
    statuses: dict[str, int]
    deviations: list[Deviation]
    warnings: list[str]


class NullRun(TypedDict):
    attitude_deg_max: Number
    attitude_deg_rms: Number
    position_m_max: Number
    position_m_rms: Number
    duration_s: float


class AttitudeError(TypedDict):
    mean_abs: Three
    median_abs: Three
    rms: Three


class PositionError(TypedDict):
    mean: Number
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


class Counterfactual(Document):
    flight: str
    model: str
    changes: list[str]
    start_s: float
    null_run: NullRun
    tracking: dict[str, Tracking]
    baselines: dict[str, Tracking]
    axes: list[str]
    disturbance: Disturbance
    unmeasured: list[str]
    stability_margin: Number
    observer: Observer | None
    controller_explained: Six
    lost: str | None


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
    at_worst: Operations


class Evaluations(TypedDict):
    usual: float
    at_worst: float


class Bytes(TypedDict):
    constants: int
    state: int
    stack: int


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
    corrected: str
    left_out: dict[str, str]
    precision: Literal["double", "float"]
    dt: float
    points: int
    further_inputs: list[str]
    observer: ExportObserver | None
    solved: Number
    warnings: list[str]
    operations: OperationsOfStep
    evaluations: Evaluations
    bytes: Bytes
