"""Documents of `inspect`, `convert`, `simulate` and `design`."""

from __future__ import annotations

from typing import NotRequired

from typing_extensions import TypedDict

from scripts.json_documents.parts import CheckResult, Document, Fitted, LeftOut, Level, Number, Six, Three, Timing


class Topic(TypedDict):
    topic: str
    type: str
    count: int
    rate: Number
    jitter: Number
    gaps: int
    longest_gap: Number
    header_offset: Number
    """Of header stamps from log times [s]."""
    header_rate: Number
    """Of header stamps against log times."""
    header_jitter: Number
    dropped: dict[str, int]
    """Samples by reason."""
    plays: list[str]
    """Roles that it plays."""
    could_play: list[str]
    """Roles that it could play by its type."""
    problem: str | None


class Phase(TypedDict):
    name: str
    start: Number
    stop: Number
    why: str
    event: Number
    """When it happens [s]: of an impact its first sample, of a crash its impact or, without one, where
    motion begins to contradict the commands; null of other phases."""
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
    """Which topic plays each role, in the syntax of `--topic`."""
    checks: list[CheckResult]
    model_checks: list[CheckResult]
    """With `--model`."""
    notes: list[str]
    shift_s: dict[str, float]
    left_out: list[LeftOut]
    phases: list[Phase]
    """With `--model`."""
    unmeasured: list[str]
    timing: Timing | None
    """Offsets between topics (docs/timing.md)."""


class Inspect(Document):
    logs: list[Log]
    model: NotRequired[str]
    """With `-o`: the model that says how these logs were read."""
    model_version: NotRequired[int]


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
    """What was read and written."""


class Simulate(Document):
    log: str
    made_by: str
    """This and the following are those of the log's own metadata; what was hidden is in neither."""
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
    """The effect that is there."""
    imitator: str
    """The effect that the model has instead."""
    counts: bool
    """False where the imitator has many more parameters."""
    told: bool
    """Separable."""
    cosine: Number
    share_left: Number
    """Of the truth's contribution."""
    evidence: Number
    separation: Number
    added_rms: Six
    """What the truth adds."""
    left_rms: Six
    """What the imitator leaves of it."""
    noise: Six
    separation_simulated: NotRequired[Number]
    """That of two fits on the simulated flight."""


class Separation(TypedDict):
    seconds: float
    separation: Number
    """Of the hardest pair."""
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
    """Share of the largest rotor speed; 0 without rotors."""
    position_error_max_m: Number
    attitude_error_max_deg: Number


class Design(Document):
    trajectory: str | None
    """Null where no flight separates the effects."""
    effects: list[Fitted]
    separable: bool
    summary: str
    advice: list[str]
    """What else does."""
    axes: list[str]
    baseline: str
    before: Separation
    """On the given logs, or on a hover."""
    expected: Separation
    """On the designed flight."""
    manoeuvres: list[Manoeuvre]
    duration_s: float
    limits: Limits
    flown: list[Flown]
    """Simulated with each effect hidden."""
    tried: int
    least_separation: float
