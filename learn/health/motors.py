"""How evenly the motors work in hover, and how long they are at the ends of their range.

In hover the commanded thrusts balance weight and torques. What they deviate by from their mean has a shape: two
neighbours against the opposite two balance a centre of mass that is off; motors of one turning direction against those
of the other balance a yaw torque; a motor alone makes up for a propeller or motor that is weak. Hover counts where the
vehicle is level: rotors on arms that tilt share the thrust by the attitude. A coaxial pair that is commanded alike
counts as one motor here: its command does not tell which of the two is weak.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from wrenchgap.flight.check import Level
from wrenchgap.flight.flight import Array, Mask
from wrenchgap.flight.row_kernels import runs
from wrenchgap.learn.health.phases import AIRBORNE, LEVEL, FlightPhases
from wrenchgap.learn.health.rotors import RotorPlace, Thrusts


@dataclass(frozen=True)
class MotorThresholds:
    """From when on motors are said to work unevenly, or to be at their ends too long."""

    uneven: float = 0.1
    """Deviation of a motor's thrust from the mean, beyond which it is worth a word: a centre of mass 7 % of the arm
    off the middle makes it in a quadrotor, and propellers of one kind differ by a few per cent."""
    bad: float = 0.25
    """The same, beyond which little is left for control: half of the reserve at a hover with half of the thrust."""
    shape: float = 0.8
    """Share of the squared deviations that one shape explains, from which on the others are not needed."""
    beside_yaw: float = 0.07
    """Deviation of a motor's thrust from the mean of those that turn its way, beyond which a yaw bias is not all: up to
    6 % on five healthy Crazyflies, 8 % with 3 mm cut off one blade."""
    saturated: float = 0.01
    """Share of the time in the air at the largest command that is worth a word."""
    often: float = 0.1
    """The same, that is bad."""
    idle: float = 0.05
    """Share of the time in the air at the smallest command that is worth a word: fast descents touch it."""
    briefest: float = 3.0
    """Time [s] of level hover, or of flight, below which nothing is said of the balance."""
    carried: float = 0.1
    """Thrust over the mean that places of rotors leave to each of them in hover at least: nobody builds a rotor that
    carries less, a turning direction that is typed wrong leaves nothing."""
    stopped: float = 1.0
    """Time [s] in the air without any thrust commanded of one motor alone, from which on the autopilot has stopped it:
    a control loop asks for none of a motor for some tenths."""
    together: float = 0.02
    """Distance of two rotors seen from above, in distances of the farthest rotor, up to which they are coaxial."""
    alike: float = 0.01
    """Largest difference of two commanded thrusts, over the mean thrust, up to which they are one command."""


MOTORS = MotorThresholds()


class Shape(StrEnum):
    """What uneven thrusts balance."""

    EVEN = "even"
    YAW = "yaw"
    COM = "centre of mass"
    ONE = "one motor"
    MIXED = "mixed"
    UNKNOWN = "places of the rotors unknown"


@dataclass(frozen=True)
class Motor:
    """A motor: `deviation` of its commanded thrust from what its place asks for, in the time of `Motors.condition`.

    A vehicle whose rotors stand evenly about its centre of mass asks for the mean of all, as one of unknown places.

    `at_most` and `at_least` are shares of the time in the air at the ends of its range; None where these are not known.
    `alike` are the rotors that are coaxial with it and commanded alike.
    """

    rotor: RotorPlace
    deviation: float
    at_most: float | None
    at_least: float | None
    alike: tuple[RotorPlace, ...] = ()


@dataclass(frozen=True)
class StoppedMotor:
    """A motor that was commanded nothing in the air, alone, from `start` to `stop` [s], the flight's end if `last`."""

    rotor: RotorPlace
    start: float
    stop: float
    last: bool


@dataclass(frozen=True)
class Motors:
    """All motors of a flight.

    `condition` is "hover", which is level, or "flight" where there was too little of it and the balance is not known,
    for `seconds` in all. `centre` is where the thrust is centred (x forward, y left; in distances of the farthest
    rotor), `yaw` the excess of the motors that turn counter-clockwise over the mean; None where the places are not
    known. `curve` is that of `Thrusts`. Where motors `stopped`, all else is of the time before.
    """

    motors: tuple[Motor, ...]
    condition: str
    seconds: float
    shape: Shape
    centre: tuple[float, float] | None
    yaw: float | None
    curve: float | None = None
    stopped: tuple[StoppedMotor, ...] = ()

    @property
    def hardest(self) -> Motor:
        """The motor that is commanded most."""
        return max(self.motors, key=lambda motor: motor.deviation)

    @property
    def unevenness(self) -> float:
        """The largest deviation, of either sign."""
        return max(abs(motor.deviation) for motor in self.motors)

    @property
    def at_most(self) -> float | None:
        """Share of the time in the air of the motor that is longest at its largest command."""
        return max((m.at_most for m in self.motors if m.at_most is not None), default=None)

    @property
    def at_least(self) -> float | None:
        """The same of the smallest command."""
        return max((m.at_least for m in self.motors if m.at_least is not None), default=None)

    @property
    def balance_level(self) -> Level:
        """How bad the imbalance is."""
        if self.unevenness < MOTORS.uneven or self.condition != "hover":  # moving flight loads motors unevenly
            return "ok"
        return "bad" if self.unevenness > MOTORS.bad else "warn"

    @property
    def saturation_level(self) -> Level:
        """How bad the saturation is."""
        most, least = self.at_most or 0.0, self.at_least or 0.0
        if most <= MOTORS.saturated and least <= MOTORS.idle:
            return "ok"
        return "bad" if most > MOTORS.often else "warn"


def motors_of(thrusts: Thrusts | None, phases: FlightPhases) -> Motors | None:
    """The motors; None where the log has no command for each, or too little time in the air."""
    if thrusts is None or not phases.phases:
        return None
    stopped = _stopped(thrusts, phases.within(thrusts.time, *AIRBORNE))
    whole = phases.until(stopped[0].start) if stopped else phases
    flown = whole.within(thrusts.time, *AIRBORNE)
    level = FlightPhases(whole.level)
    hovering = level.seconds(LEVEL) >= MOTORS.briefest
    used = level.within(thrusts.time, LEVEL) if hovering else flown
    seconds = level.seconds(LEVEL) if hovering else whole.seconds(*AIRBORNE)
    if seconds < MOTORS.briefest or used.sum() < 2 or not thrusts.share[used].mean() > 0.0:
        return None
    mean = thrusts.share[used].mean(axis=0)
    deviation = mean / mean.mean() - _asked(thrusts.rotors)
    low, high = (None, None) if thrusts.limits is None else (limit[flown].mean(axis=0) for limit in thrusts.limits)
    alike = _alike(thrusts.rotors, thrusts.share[flown] / mean.mean())
    motors = tuple(
        Motor(
            rotor,
            float(value),
            None if high is None else float(high[k]),
            None if low is None else float(low[k]),
            tuple(other for other, same in zip(thrusts.rotors, alike[k], strict=True) if same and other is not rotor),
        )
        for k, (rotor, value) in enumerate(zip(thrusts.rotors, deviation, strict=True))
    )
    shape, centre, yaw = _shape(thrusts.rotors, deviation, alike)
    return Motors(motors, "hover" if hovering else "flight", seconds, shape, centre, yaw, thrusts.curve, stopped)


def _stopped(thrusts: Thrusts, flown: Mask) -> tuple[StoppedMotor, ...]:
    """Motors that were commanded nothing, alone, in the samples (N,) in the air; the first to stop first."""
    found = []
    last = int(np.flatnonzero(flown)[-1]) if flown.any() else 0
    for k, rotor in enumerate(thrusts.rotors):
        if not thrusts.share[:, k].any():
            continue  # a column that no motor hangs on
        nothing = flown & (thrusts.share[:, k] == 0.0) & (np.count_nonzero(thrusts.share, axis=1) > 1)
        times = [(float(thrusts.time[a]), float(thrusts.time[b - 1]), b > last) for a, b in runs(nothing)]
        found += [StoppedMotor(rotor, *one) for one in times if one[1] - one[0] >= MOTORS.stopped]
    return tuple(sorted(found, key=lambda one: one.start))


def _alike(rotors: tuple[RotorPlace, ...], thrusts: Array) -> Mask:
    """Which rotors (R, R) are coaxial and commanded alike, by thrusts (N, R) over their mean; each is with itself."""
    same = np.eye(len(rotors), dtype=bool)
    places = _places(rotors)
    if places is not None:
        apart = np.hypot(*np.moveaxis(places[:, None, :2] - places[None, :, :2], -1, 0))
        for a, b in np.argwhere(apart < MOTORS.together):
            same[a, b] = np.abs(thrusts[:, a] - thrusts[:, b]).max() < MOTORS.alike
    return same


def _shape(
    rotors: tuple[RotorPlace, ...], deviation: Array, alike: Mask
) -> tuple[Shape, tuple[float, float] | None, float | None]:
    """What deviations (R,) balance, where the thrust is centred, and the excess by turning direction.

    `alike` (R, R) are the rotors that count as one.
    """
    places = _places(rotors)
    if places is None:
        even = np.abs(deviation).max() < MOTORS.uneven
        return (Shape.EVEN if even else Shape.UNKNOWN), None, None
    arms, spin = places[:, :2], places[:, 2]
    centre = (float(np.mean(deviation * arms[:, 0])), float(np.mean(deviation * arms[:, 1])))
    yaw = float(deviation[spin > 0].mean()) if (spin > 0).any() else None
    if np.abs(deviation).max() < MOTORS.uneven:
        return Shape.EVEN, centre, yaw
    explained = {
        Shape.ONE: _explained(deviation, alike[:, [int(np.argmax(deviation))]].astype(float)),
        Shape.YAW: _explained(deviation, spin[:, None]),
        Shape.COM: _explained(deviation, arms),
    }
    best = max(explained, key=lambda shape: explained[shape])
    return (best if explained[best] > MOTORS.shape else Shape.MIXED), centre, yaw


def _places(rotors: tuple[RotorPlace, ...]) -> Array | None:
    """Places and turning directions (R, 3); None where they are not all known, or of fewer than three rotors.

    Nor where no vehicle could hover with them: then they are not those of this vehicle.
    """
    places = [(rotor.x, rotor.y, rotor.spin) for rotor in rotors]
    known = np.array([place for place in places if None not in place], dtype=float)
    whole = len(known) == len(rotors) > 2
    return known if whole and _without_torque(known).min() > MOTORS.carried else None


def _asked(rotors: tuple[RotorPlace, ...]) -> Array:
    """Thrusts (R,) of mean 1 that make no torque, the least even ones of all that do not."""
    places = _places(rotors)
    return np.ones(len(rotors)) if places is None else _without_torque(places)


def _without_torque(places: Array) -> Array:
    """Thrusts (R,) of mean 1 that make no torque at places and turning directions (R, 3), as even as can be."""
    balance = np.column_stack((np.ones(len(places)), places)).T
    found = np.linalg.pinv(balance, rcond=1e-6) @ np.array([float(len(places)), 0.0, 0.0, 0.0])
    return np.asarray(found / found.mean())


def _explained(deviation: Array, columns: Array) -> float:
    """Share of the squares of deviations (R,) that columns (R, C), without their means, explain."""
    columns = columns - columns.mean(axis=0)
    left = deviation - columns @ np.linalg.lstsq(columns, deviation, rcond=None)[0]
    return 1.0 - float(left @ left) / max(float(deviation @ deviation), 1e-30)
