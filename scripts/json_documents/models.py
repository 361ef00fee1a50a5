"""Documents of `add`, `remove`, `history`, `model`, `calibrate`, `trend` and `learn`."""

from __future__ import annotations

from typing import Any, Literal, NotRequired

from typing_extensions import TypedDict

from scripts.json_documents.comparison import Comparison
from scripts.json_documents.parts import Absorption, Document, Fitted, HeldOut, Number, Observer, Six, Three
from wrenchgap.learn.identify.calibrate import Fate


class Add(Document):
    model: str
    model_version: int
    effects: list[Fitted]
    refitted: NotRequired[list[str]]
    axes: NotRequired[list[str]]
    unmeasured: NotRequired[list[str]]
    cutoff_hz: NotRequired[float]
    rms_before: NotRequired[Six]
    rms_after: NotRequired[Six]
    between_flights: NotRequired[Six | None]
    at_bound: NotRequired[list[str]]
    held_out: NotRequired[HeldOut | None]


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
    content_sha256: str
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
    versions: list[ModelVersion]


class Tolerances(TypedDict):
    mass: Number
    inertia: list[list[Number]] | None
    com: Three | None
    imu_position: Three | None


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
    gives: Literal["thrust", "speed"]
    source: str
    hover: Number


class Model(Document):
    model: NotRequired[str]
    name: str
    mass: float
    inertia: list[Three]
    com: Three
    imu_position: Three
    tolerances: Tolerances
    rotors: list[Rotor]
    full_thrust_over_weight: Number
    command: Command | None
    effects: list[Fitted]
    assumed: list[str]


class Tried(TypedDict):
    effect: str
    fate: Fate
    t: Number
    lack: str | None
    reason: str | None


class Trimmed(TypedDict):
    effect: str
    name: str
    unit: str
    value: Number
    std: Number
    scatter: Number
    values: list[Number]


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
    held_out: HeldOut | None
    between_flights: Six | None
    at_bound: list[str]


class Step(TypedDict):
    flight: str
    index: int
    before: Number
    after: Number
    size: Number
    low: Number
    high: Number
    t: Number
    p: Number


class Drift(TypedDict):
    slope: Number
    low: Number
    high: Number
    t: Number
    p: Number


class ParameterTrend(TypedDict):
    effect: str
    name: str
    unit: str
    values: list[Number]
    std: list[Number]
    errors: list[Number]
    where: str | None
    verdict: Literal["steady", "steps", "drift", "few", "open"]
    scatter: Number
    level: list[Number]
    steps: list[Step]
    drift: Drift | None
    at_limit: list[str]


class NotFitted(TypedDict):
    effect: str
    flight: str
    reason: str


class Trend(Document):
    verdict: Literal["changed", "steady", "few"]
    summary: str
    model: str
    effects: list[str]
    flights: list[str]
    parameters: list[ParameterTrend]
    inspect: list[str]
    significant: float
    axes: list[str]
    rms: list[Six]
    unmeasured: list[str]
    effects_left_out: list[NotFitted]
    cutoff_hz: float


class Within(TypedDict):
    within_95: list[Number]
    within_3_sigma: list[Number]


class Coverage(TypedDict):
    before: Within
    after: Within


class Conditioning(TypedDict):
    percentile_1: Number
    median: Number
    maximum: Number


class StabilityMargin(TypedDict):
    percentile_1: Number
    lag_s: float
    delay_s: float


class OutputVerdict(TypedDict):
    output: str
    decision: Literal["compensate", "do not", "needs"]
    reason: str
    gain: Number
    reduction: list[Number]
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
    settings: dict[str, Any]
    samples: int
    points: int
    spacing_s: float
    cutoff_hz: float
    physics: str
    sigma_prior: list[Number]
    sigma_training: list[Number]
    sigma_scale: list[Number]
    coverage: dict[str, Coverage]
    conditioning: Conditioning
    stability_margin: StabilityMargin
    observer: Observer | None
    lags_s: list[Number]
    blind: list[str]
    verdicts: list[OutputVerdict]
    training: Comparison
    validation: Comparison | None
    warnings: list[str]
    alternatives: list[Alternative]
    absorbs: Absorption | None
