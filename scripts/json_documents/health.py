"""The document of `check`."""

from __future__ import annotations

from typing import Literal

from typing_extensions import TypedDict

from scripts.json_documents.parts import AutopilotParameters, CheckResult, Document, Level, Number


class Statement(TypedDict):
    level: Level
    about: str
    short: str
    words: str


class Autopilot(TypedDict):
    name: str
    firmware: str
    hardware: str
    frame: str
    dropouts: int
    """Gaps (PX4) or blocks (ArduPilot) that the logger lost."""
    lost_s: Number
    """Their length in all; null where it is not logged."""


class FlightPhase(TypedDict):
    name: str
    start: Number
    stop: Number
    why: str
    event: Number
    """When it happens [s]: of an impact its first sample, of a crash its impact or, without one, where
    motion begins to contradict the commands; null of other phases."""


class RotorPlace(TypedDict):
    name: str
    x: Number
    """Forward, in distances of the farthest rotor; null where nothing tells it."""
    y: Number
    """To the left."""
    spin: int | None
    """1 counter-clockwise, -1 clockwise, seen from above."""


class Motor(TypedDict):
    rotor: RotorPlace
    deviation: Number
    """Of its commanded thrust from what its place asks for, relative to the mean of all."""
    at_most: Number
    """Share of the time in the air at its largest command; null where the ends are not known."""
    at_least: Number
    alike: list[RotorPlace]
    """Rotors that are coaxial with it and commanded alike."""


class StoppedMotor(TypedDict):
    rotor: RotorPlace
    start: Number
    stop: Number
    last: bool
    """To the end of the flight."""


class Motors(TypedDict):
    condition: Literal["hover", "flight"]
    """Level hover; "flight" where there was too little of it, and the balance is not known."""
    seconds: Number
    shape: str
    """What the deviations balance."""
    centre: list[float] | None
    """Of thrust: forward and to the left, in distances of the farthest rotor."""
    yaw: Number
    """Excess of the motors that turn counter-clockwise over the mean, relative."""
    curve: Number
    """Thrust is taken as f u^2 + (1 - f) u of a command u; null where it is the square of a speed."""
    motors: list[Motor]
    stopped: list[StoppedMotor]
    """Motors that were commanded nothing in the air, alone; all else is of the time before."""


class Peak(TypedDict):
    hz: Number
    rms: Number
    """In m/s^2."""
    rotors: list[str]
    """Rotors at whose `multiple` it lies."""
    multiple: int
    folded: bool
    """By the logged rate."""
    harmonic: bool
    """Another peak lies at twice or half of it."""


class Vibration(TypedDict):
    source: str
    levels: list[float]
    """95th percentiles in the air [m/s^2], of what `source` logs."""
    limits: list[float] | None
    clipped: int | None
    """Samples at the end of the accelerometer's range; null where nobody counts."""
    rms: list[float] | None
    """Of the logged specific force above 20 Hz, by axis [m/s^2]."""
    rotor_hz: list[float]
    rate_hz: Number
    peaks: list[Peak]


class Battery(TypedDict):
    rest: Number
    """All voltages in V."""
    start: Number
    flight: Number
    lowest: Number
    end: Number
    cells: int | None
    limit: Number
    """Voltage that the autopilot's parameters call low or empty."""
    limit_of: str
    """Which parameters."""
    below: Number
    """Time below it in the air [s]."""
    none: bool
    """What it reads is no battery."""
    current: Number
    """Median in the air [A]; null where none is measured."""


class Ratio(TypedDict):
    of: str
    topic: str
    median: Number
    high: Number
    """95th percentile."""
    rejected: Number
    """Share of the time above 1."""


class Estimator(TypedDict):
    topic: str
    ratios: list[Ratio]
    faulty: Number
    """Share of the time in the air with a flag of a fault."""
    disturbed: Number
    """Share of it in which the magnetic field is not the expected one (PX4)."""
    no_fix: bool
    """The GPS had no fix in the air."""
    sources: list[str]
    """What the position comes from without one, where that is logged."""


class Rate(TypedDict):
    role: str
    topic: str
    hz: Number
    last: Number
    """When its last message came [s]."""
    gaps: int
    longest_gap: Number
    in_flight: Number
    """The longest gap between take-off and landing [s]."""


class Answer(TypedDict):
    question: str
    lack: str | None
    """What the log lacks first; null where it can be answered."""
    have: Number
    need: Number


class Setting(TypedDict):
    name: str
    """A parameter of the autopilot, "cflib", or empty."""
    now: int | None
    to: int | None


class Message(TypedDict):
    time: Number
    """The first [s], in flight if one came there."""
    level: str
    text: str
    in_flight: bool
    count: int


class LogHealth(TypedDict):
    path: str
    format: str
    sha256: str
    duration_s: float
    level: Level
    """Of the checks."""
    statements: list[Statement]
    autopilot: Autopilot | None
    phases: list[FlightPhase]
    phases_lack: str | None
    """Why there is none."""
    motors: Motors | None
    vibration: Vibration | None
    battery: Battery | None
    estimator: Estimator | None
    messages: list[Message]
    """What the autopilot reported to be wrong, the worst first."""
    rates: list[Rate]
    answers: list[Answer]
    settings: list[Setting]
    """Of the logger, with which more could be answered."""
    contradictions: list[CheckResult]
    """Bad checks of the log against the model, which was then not used."""
    checks: list[CheckResult]
    notes: list[str]


class Repeated(TypedDict):
    log: str
    same_as: str


class Check(Document):
    answer: list[str]
    """The first lines: what to look at, what is not answered, the next command."""
    logs: list[LogHealth]
    repeated: list[Repeated]
    """Files that equal one before, and were left out."""
    autopilot_parameters: AutopilotParameters
