"""Documents of `inspect`, `convert`, `simulate` and `design`."""

from __future__ import annotations

from typing import NotRequired

from typing_extensions import TypedDict

from scripts.json_documents.parts import Check, Document, Fitted, LeftOut, Level, Number, Six, Three, Timing


class Topic(TypedDict):
    topic: str
    type: str
    count: int
    rate: Number
    jitter: Number
    gaps: int
    longest_gap: Number
    header_offset: Number
    header_rate: Number
    header_jitter: Number
    dropped: dict[str, int]
    plays: list[str]
    could_play: list[str]
    problem: str | None


class Phase(TypedDict):
    name: str
    start: Number
    stop: Number
    why: str
    left_out: bool


class Log(TypedDict):
    version: int
    path: str
    format: str
    size_bytes: int
    sha256: str
    start_ns: int
    duration_s: float
    level: Level
    topics: list[Topic]
    mapping: dict[str, str]
    checks: list[Check]
    model_checks: list[Check]
    notes: list[str]
    shift_s: dict[str, float]
    left_out: list[LeftOut]
    phases: list[Phase]
    unmeasured: list[str]
    timing: Timing | None


class Inspect(Document):
    logs: list[Log]


class Played(TypedDict):
    topic: str
    samples: int


class Converted(TypedDict):
    log: str
    output: str
    roles: dict[str, Played]
    notes: list[str]


class Convert(Document):
    logs: list[Converted]


class Simulate(Document):
    log: str
    made_by: str
    model: str
    model_sha256: str
    trajectory: str
    trajectory_sha256: NotRequired[str]
    duration: str
    excitation: str
    seed: str
    integral: str
    duration_s: float
    tilt_max_deg: Number
    position_error_rms_m: Number
    attitude_error_rms_deg: Number


class Direction(TypedDict):
    truth: str
    imitator: str
    counts: bool
    told: bool
    cosine: Number
    share_left: Number
    evidence: Number
    separation: Number
    added_rms: Six
    left_rms: Six
    noise: Six
    separation_simulated: NotRequired[Number]


class Separation(TypedDict):
    seconds: float
    separation: Number
    separable: bool
    directions: list[Direction]


class Manoeuvre(TypedDict):
    name: str
    vigour: float
    azimuth_deg: float


class Limits(TypedDict):
    room_m: Three
    tilt_deg: float
    speed_m_s: float


class Flown(TypedDict):
    truth: str
    tilt_max_deg: Number
    speed_max_m_s: Number
    rotor_max: Number
    position_error_max_m: Number
    attitude_error_max_deg: Number


class Design(Document):
    trajectory: str | None
    effects: list[Fitted]
    separable: bool
    summary: str
    advice: list[str]
    axes: list[str]
    baseline: str
    before: Separation
    expected: Separation
    manoeuvres: list[Manoeuvre]
    duration_s: float
    limits: Limits
    flown: list[Flown]
    tried: int
    least_separation: float
