"""What a log can answer and what it cannot, before there is a model; and the setting of its logger that changes it.

Rates are those that the analyses need with their default filter. How much motion a question needs is typical, not
computed: only a model knows what its error would be (`wrenchgap design` computes it).
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from wrenchgap.flight.autopilot import Autopilot
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.flight.row_kernels import lengths
from wrenchgap.learn.data.checks import RATE_OVER_CUTOFF
from wrenchgap.learn.data.measurement import CUTOFF_HZ, low_pass
from wrenchgap.learn.health.autopilot_messages import Battery
from wrenchgap.learn.health.phases import AIRBORNE, FlightPhases, NoPhases
from wrenchgap.learn.health.rotors import Thrusts
from wrenchgap.learn.health.vibration import Vibration


@dataclass(frozen=True)
class AnswerNeeds:
    """What a log must have for an answer."""

    rate: float = RATE_OVER_CUTOFF * CUTOFF_HZ
    """Rate of commands and IMU [Hz] for the analyses' default filter, which shows a motor lag of 30 ms (5 Hz)."""
    flight: float = 8.0
    """Time in the air [s]: with less, `explain` holds out blocks that are shorter than half their usual."""
    speed: float = 2.0
    """Speed [m/s] whose rotor drag, typically 0.3 m/s^2 for each m/s, stands above the bias of an accelerometer."""
    turning: float = 1.0
    """Angular acceleration [rad/s^2], root mean square: a tenth of a typical inertia's torque then stands above that
    of turbulence in hover."""
    rotor_hz: float = 200.0
    """Highest frequency of interest of rotors of 13 to 25 cm [Hz], where no speed is measured."""
    drop: float = 3.0
    """Drop of the voltage over the flight [%]: 6 % of thrust at the same command."""
    any_rate: float = 1.0
    """Rate of commands [Hz] whose means say how hover is trimmed."""


NEEDS = AnswerNeeds()


class Question(StrEnum):
    """What users ask of a log."""

    ROTORS = "weak rotor"
    CENTRE = "centre of mass"
    LAG = "motor lag"
    INERTIA = "inertia, torque per command"
    DRAG = "drag"
    VOLTAGE = "thrust with the battery's voltage"
    SPECTRUM = "vibration of single rotors"


class Lack(StrEnum):
    """What a log has too little of; `Answer.have` and `.need` are in the unit."""

    ANY = "rate of commands [Hz]"
    MOTORS = "rate of commands of each motor [Hz]"
    COMMANDS = "rate of the commands [Hz]"
    IMU = "rate of the IMU [Hz]"
    ROTORS = "rate of the IMU for rotors [Hz]"
    FLIGHT = "time in the air [s]"
    SPEED = "speed [m/s]"
    TURNING = "angular acceleration [rad/s^2]"
    FOLLOWING = "motion that follows the commands"
    VOLTAGE = "drop of the voltage [%]"


ASKED: dict[Question, tuple[Lack, ...]] = {
    Question.ROTORS: (Lack.MOTORS, Lack.FLIGHT),
    Question.CENTRE: (Lack.ANY, Lack.FLIGHT),
    Question.LAG: (Lack.MOTORS, Lack.COMMANDS, Lack.IMU, Lack.TURNING, Lack.FLIGHT, Lack.FOLLOWING),
    Question.INERTIA: (Lack.COMMANDS, Lack.IMU, Lack.TURNING, Lack.FLIGHT, Lack.FOLLOWING),
    Question.DRAG: (Lack.IMU, Lack.SPEED, Lack.FLIGHT),
    Question.VOLTAGE: (Lack.VOLTAGE, Lack.FLIGHT),
    Question.SPECTRUM: (Lack.ROTORS,),
}
"""What each question needs, in the order in which a lack of it is told."""


KNOWN = (None, NoPhases.POWER)
"""Where it is known whether, and when, the vehicle flew."""


@dataclass(frozen=True)
class Answer:
    """Whether a log can answer a question, or what it `lack`s: it has so much (None: not logged), so much is needed."""

    question: Question
    lack: Lack | None = None
    have: float | None = None
    need: float | None = None


@dataclass(frozen=True)
class Setting:
    """A setting of the logger: the parameter `name`, its value `now` (None: not in the log), and what to set.

    For a logger without such a parameter `name` is "cflib", or "" where nothing is known of it, and `to` is None.
    """

    name: str
    now: int | None = None
    to: int | None = None


def answers_of(
    flight: Flight,
    thrusts: Thrusts | None,
    phases: FlightPhases,
    battery: Battery | None,
    vibration: Vibration,
    *,
    follows: bool = True,
    lags: bool = True,
) -> tuple[Answer, ...]:
    """Every question, and what the log lacks for it first; none of a log that is not what it seems.

    `follows` says whether the motion follows the commands about x or y, `lags` whether it does on any axis that the
    actuators make, which shows their lag: only a model tells.
    """
    if phases.lack is NoPhases.DOUBT:
        return ()
    sent, motion = flight.actuators if thrusts is not None else flight.commanded, flight.imu or flight.odometry
    rate, seen = (None if series is None else 1.0 / series.period for series in (sent, motion))
    dropped = None if battery is None or battery.none else max(100.0 * battery.drop, 0.0)
    has: dict[Lack, tuple[float | None, float]] = {
        Lack.ANY: (rate, NEEDS.any_rate),
        Lack.MOTORS: (None if thrusts is None else rate, NEEDS.any_rate),
        Lack.COMMANDS: (rate, NEEDS.rate),
        Lack.IMU: (seen, NEEDS.rate),
        Lack.ROTORS: (vibration.rate, 2.0 * max(vibration.rotor_hz, default=NEEDS.rotor_hz)),
        Lack.FLIGHT: (phases.seconds(*AIRBORNE) if phases.lack in KNOWN else None, NEEDS.flight),
        Lack.SPEED: (_speed(flight, phases), NEEDS.speed),
        Lack.TURNING: (_turning(flight, phases), NEEDS.turning),
        Lack.VOLTAGE: (dropped, NEEDS.drop),
        Lack.FOLLOWING: (1.0 if follows else None, 1.0),
    }
    short = {lack for lack, (have, need) in has.items() if have is None or have < need}
    of_lag = short - {Lack.FOLLOWING} if lags else short | {Lack.FOLLOWING}
    short_of = {q: of_lag if q is Question.LAG else short for q in ASKED}
    first = {q: next((lack for lack in asked if lack in short_of[q]), None) for q, asked in ASKED.items()}
    return tuple(Answer(q, lack, *((None, None) if lack is None else has[lack])) for q, lack in first.items())


def _turning(flight: Flight, phases: FlightPhases) -> float | None:
    """Root mean square of the angular acceleration about x and y in the air [rad/s^2], as the analyses filter it."""
    if flight.imu is None or np.isnan(flight.imu.omega_B[:, :2]).any() or phases.lack not in KNOWN:
        return None
    time, dt = flight.imu.time, flight.imu.period
    turn = np.gradient(low_pass(flight.imu.omega_B[:, :2], dt, min(CUTOFF_HZ, 0.3 / dt)), dt, axis=0)
    air = phases.within(time, *AIRBORNE)
    return float(np.sqrt(np.mean(np.sum(turn[air] ** 2, axis=1)))) if air.any() else 0.0


def _speed(flight: Flight, phases: FlightPhases) -> float | None:
    """Speed in the air [m/s] that is exceeded for a tenth of the time."""
    odometry = flight.odometry
    if odometry is None or odometry.velocity_E is None or phases.lack not in KNOWN:
        return None
    speeds: Array = lengths(odometry.velocity_E)[phases.within(odometry.time, *AIRBORNE)]
    return float(np.percentile(speeds, 90.0)) if len(speeds) else 0.0


PX4_BITS = 1 << 3 | 1 << 4
"""SDLOG_PROFILE of PX4: bit 3, system identification, and 4, high rate; both log IMU and motor commands at full
rate."""
ARDUPILOT_BITS = 1 << 0 | 1 << 18
"""LOG_BITMASK of Copter: bit 0, fast attitude (with RATE, what the mixer is asked for), and 18, fast IMU, both at the
rate of the main loop; motor outputs (RCOU, bit 10) stay at 10 Hz."""


def settings_of(autopilot: Autopilot | None, answers: Iterable[Answer], names: Iterable[str]) -> tuple[Setting, ...]:
    """What to set in the logger so that more can be answered; `names` are topics and columns of the log."""
    fast = autopilot is not None and autopilot.name == "ArduPilot"  # PX4 and cflib log no IMU fast enough for rotors
    rates = {Lack.ANY, Lack.MOTORS, Lack.COMMANDS, Lack.IMU} | ({Lack.ROTORS} if fast else set())
    slow = any(answer.lack in rates for answer in answers)
    return tuple(logger_settings(autopilot, list(names))) if slow else ()


def logger_settings(autopilot: Autopilot | None, names: Sequence[str] = ()) -> Iterator[Setting]:
    """What logs motor commands and the IMU faster; `names` of topics and columns tell a Crazyflie."""
    if autopilot is None:
        if not any(re.search(r"\bmotor[._](motor_)?m1\b", name) for name in names):  # else it is a matter of reading it
            crazyflie = any(re.search(r"(^|/)(cf|crazyflie)\d*(/|$)", name) for name in names)
            yield Setting("cflib" if crazyflie else "")
        return
    name, bits = ("LOG_BITMASK", ARDUPILOT_BITS) if autopilot.name == "ArduPilot" else ("SDLOG_PROFILE", PX4_BITS)
    now = autopilot.parameters.get(name)
    value = None if now is None else int(now)
    if value is None or value | bits != value:
        yield Setting(name, value, (value or (0 if autopilot.name == "ArduPilot" else 1)) | bits)
