"""What can be hidden in a vehicle of RotorPy's: a change of its `Truth`, and the names that are right for it.

`HIDDEN[name].change(truth, scale, rng)`; scale 1 is a typical size, relative to the vehicle's weight and arm. `answers`
are sets of the catalogue's names, best first, each of which says what is there: {payload} or {mass, com_offset}. They
are exact, or nearly: a name that only looks the same on some flights (a thrust scale is a mass where no torque shows it
to be none) belongs into the answer's class beside the true one, and must not be firm. Names are compared by family.
What no name is right for has no answers; `near` are names that are not wrong there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.field.outside import Slosh, SlungLoad, intermittent, magnet
from benchmarks.field.truth import Push, Truth
from benchmarks.field.vehicles import GRAVITY
from wrenchgap.flight.flight import Array

Change = Callable[[Truth, float, np.random.Generator], Truth]
Answers = tuple[frozenset[str], ...]


@dataclass(frozen=True)
class Hidden:
    """One thing to hide; see the module. `size` says what scale 1 is, `flying` the kinds of flying that show it."""

    change: Change
    answers: Answers
    size: str
    flying: tuple[str, ...] = ("excited", "mission", "turbulence")
    near: tuple[str, ...] = ()


HIDDEN: dict[str, Hidden] = {}


def hidden(
    answers: str, size: str, flying: str = "excited mission turbulence", near: str = ""
) -> Callable[[Change], Change]:
    """Register a function under its name. `answers`: "payload | mass com_offset"."""
    sets = tuple(frozenset(words.split()) for words in answers.split("|") if words.strip())

    def register(change: Change) -> Change:
        HIDDEN[change.__name__] = Hidden(change, sets, size, tuple(flying.split()), tuple(near.split()))
        return change

    return register


def _weight(truth: Truth) -> float:
    return truth.vehicle.mass * GRAVITY


def _direction(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


def _level(rng: np.random.Generator) -> Array:
    a = rng.uniform(-np.pi, np.pi)
    return np.array((np.cos(a), np.sin(a), 0.0))


def _moved(truth: Truth, mass: float, at: Array) -> Truth:
    """A point mass [kg] at `at` (3,) [m] from O, rigidly: mass, centre of mass, inertia about it."""
    m, c = truth.param("mass"), truth.com_B
    total = m + mass
    d = at - c
    more = m * mass / total * ((d @ d) * np.eye(3) - np.outer(d, d))
    changed = {f"I{a}{b}": truth.param(f"I{a}{b}") + more["xyz".index(a), "xyz".index(b)] for a, b in PAIRS}
    return truth.with_params(mass=total, **changed).but(com_B=(m * c + mass * at) / total)


PAIRS = ("xx", "yy", "zz", "xy", "xz", "yz")


@hidden("mass | payload | thrust_scale inertia | coaxial_loss inertia", "6 % of the mass, at the centre of mass")
def heavier(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """Heavier than weighed."""
    return truth.with_params(mass=truth.param("mass") * (1 + 0.06 * scale))


@hidden("com_offset", "6 % of the arm, any direction")
def beside(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """The centre of mass is not at O; the inertia about it is the model's."""
    return truth.but(com_B=truth.com_B + 0.06 * scale * truth.vehicle.arm * _direction(rng))


@hidden("inertia", "15 % of one or two principal moments", "excited")
def sluggish(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """Masses further out: along one level axis, so that the two other moments grow."""
    along, other = (("x", "y"), ("y", "x"))[int(rng.integers(2))]
    added = 0.15 * scale * truth.vehicle.inertia["xyz".index(other)]
    grown = {f"I{a}{a}": truth.param(f"I{a}{a}") + added for a in "xyz" if a != along}
    return truth.with_params(**grown)


@hidden(
    "payload | mass com_offset | mass com_offset inertia | thrust_scale com_offset | coaxial_loss com_offset",
    "8 % of the mass, below and beside",
)
def parcel(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """A parcel strapped on."""
    at = truth.vehicle.arm * (0.35 * _level(rng) + np.array((0.0, 0.0, -0.4)))
    return _moved(truth, 0.08 * scale * truth.vehicle.mass, at)


@hidden("rotor_thrust", "10 % of one rotor's thrust")
def weak_rotor(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """A damaged propeller: less thrust and less drag torque."""
    gains = truth.thrust_gains.copy()
    gains[rng.integers(len(gains))] -= 0.10 * scale
    return truth.but(gains=gains)


@hidden("thrust_scale | coaxial_loss | mass inertia", "8 % of all thrusts")
def thin_air(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """All rotors alike."""
    return truth.but(gains=truth.thrust_gains * (1 - 0.08 * scale))


@hidden("motor_lag", "30 ms (nano: 50 ms)", "excited mission")
def slow_motors(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """RotorPy's rotors, first order in the speed."""
    tau = scale * (0.05 if truth.vehicle.name == "nano" else 0.03)
    return truth.but(tau=(tau, tau))


@hidden("asymmetric_motor_lag", "25 ms up, 60 ms down", "excited")
def uneven_motors(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """Speeding up is driven, slowing down is not."""
    return truth.but(tau=(0.025 * scale, 0.06 * scale))


@hidden("thrust_curve", "dead band of 12 % of hover's command, exponent 2", "excited")
def dead_band(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """Commands that are no speeds: thrust ((s - u) / (1 - u))^2 over the hover command's s."""
    return truth.but(curve=(0.12 * scale, 2.0))


@hidden("command_delay", "20 ms (nano: 15 ms)", "excited mission")
def late(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """A queue before the motors."""
    return truth.but(delay=round(scale * (3 if truth.vehicle.name == "nano" else 4)))


@hidden("rotor_drag | body_drag", "2.5 % of the weight per m/s", "excited mission")
def rotor_drag(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """RotorPy's k_d: -Omega k_d v at each hub."""
    vehicle = truth.vehicle
    k_d = 0.025 * scale * _weight(truth) / (vehicle.rotors * vehicle.hover_speed)
    return truth.with_params(k_d=truth.param("k_d") + k_d)


@hidden("body_drag | rotor_drag", "1.2 % of the weight at 1 m/s, square", "excited mission")
def bluff_body(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """RotorPy's |v| D v, which no catalogue axis by axis has."""
    c = 0.012 * scale * _weight(truth)
    return truth.with_params(c_Dx=c, c_Dy=c * float(rng.uniform(0.7, 1.3)), c_Dz=1.6 * c)


@hidden("axial_inflow", "3 % of the weight per m/s of climb", "excited mission")
def inflow(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """RotorPy's k_z: -Omega k_z v_z at each hub, v_z with the turning hull."""
    vehicle = truth.vehicle
    return truth.with_params(k_z=0.03 * scale * _weight(truth) / (vehicle.rotors * vehicle.hover_speed))


@hidden("translational_lift", "0.8 % of the weight at 1 m/s, square", "mission")
def lift(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """RotorPy's k_h."""
    return truth.with_params(k_h=0.008 * scale * _weight(truth) / truth.vehicle.rotors)


@hidden("wind rotor_drag | wind body_drag", "3 m/s on rotors that drag", "excited mission")
def wind(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """Air that moves, and something that feels it."""
    moving = 3.0 * scale * _level(rng)
    return rotor_drag(truth.but(wind_E=truth.wind_E + moving), 1.0, rng)


@hidden("drag_torque", "30 % of the drag torque", "excited mission")
def twisting(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """Other blades."""
    return truth.with_params(k_m=truth.param("k_m") * (1 + 0.3 * scale))


@hidden("imu_misalignment", "2 deg")
def imu_turned(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """Mounted askew."""
    return truth.but(imu_rotvec=np.deg2rad(2.0 * scale) * _direction(rng))


@hidden("imu_lever_arm", "30 % of the arm", "excited")
def imu_moved(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """Mounted elsewhere."""
    return truth.but(imu_B=0.3 * scale * truth.vehicle.arm * _direction(rng))


@hidden("battery_sag | thrust_fade", "12 % of the voltage per minute, logged", "excited mission")
def battery(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """Thrust with the voltage to 1.5."""
    return truth.but(drop=0.12 * scale)


@hidden("thrust_fade | battery_sag", "12 % of the voltage per minute, not logged", "excited mission")
def fading(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """The same without the channel that would show it."""
    return truth.but(drop=0.12 * scale, shows_voltage=False)


@hidden("coaxial_loss | thrust_scale | mass inertia", "15 % of a lower rotor's thrust")
def slipstream(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """Lower rotors in the upper ones' air."""
    return truth.but(coaxial=0.15 * scale)


@hidden("ground_effect", "the law of Cheeseman and Bennett", "low")
def ground(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """One height for all rotors."""
    return truth.but(ground=scale)


def _constant(force: Array, torque: Array) -> Push:
    return lambda _time, _place, _R: (force, torque)


@hidden("constant_wrench", "5 % of the weight at 30 % of the arm, fixed to the hull", "excited mission")
def jet(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """A leaking duct."""
    force = 0.05 * scale * _weight(truth) * _direction(rng)
    torque = np.cross(0.3 * truth.vehicle.arm * _level(rng), force)
    return truth.but(pushes=(*truth.pushes, _constant(force, torque)))


@hidden("tether", "5 % of the weight from an anchor 6 m away", "excited mission")
def line(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """A long elastic line from O to the floor."""
    anchor = np.array((0.0, 0.0, 0.2)) + 6.0 * _level(rng)
    pull = 0.05 * scale * _weight(truth)

    def push(_time: float, place: Array, R: Array) -> tuple[Array, Array]:
        away = anchor - place
        length = float(np.linalg.norm(away))
        return pull * (1 + 0.1 * (length - 6.0)) * (R.T @ away) / length, np.zeros(3)

    return truth.but(pushes=(*truth.pushes, push))


@hidden("", "8 % of the mass on a rope of 0.4 to 0.7 m", near="payload tether mass thrust_scale coaxial_loss")
def slung_load(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """A pendulum."""
    mass, length = 0.08 * scale * truth.vehicle.mass, float(rng.uniform(0.4, 0.7))
    return truth.but(attached=lambda: SlungLoad(mass, length))


@hidden("", "20 % of the mass at 1 to 2 Hz, 60 % of the arm below O", near="payload")
def slosh(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """A tank."""
    mass, frequency = 0.2 * scale * truth.vehicle.mass, float(rng.uniform(1.0, 2.0))
    return truth.but(attached=lambda: Slosh(mass, frequency, 0.6 * truth.vehicle.arm))


@hidden("", "2 % of weight times arm", "excited mission")
def compass(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """A magnet in a field."""
    torque = 0.02 * scale * _weight(truth) * truth.vehicle.arm
    return truth.but(pushes=(*truth.pushes, magnet(torque, float(rng.uniform(-np.pi, np.pi)))))


@hidden("", "20 % of a rotor's hover thrust, on and off", near="rotor_thrust")
def loose_rotor(truth: Truth, scale: float, rng: np.random.Generator) -> Truth:
    """A propeller that slips now and then."""
    vehicle = truth.vehicle
    rotor = int(rng.integers(vehicle.rotors))
    push = intermittent(
        0.2 * scale * _weight(truth) / vehicle.rotors, vehicle.places_B[rotor], int(rng.integers(1 << 31))
    )
    return truth.but(pushes=(*truth.pushes, push))


def build(truth: Truth, names: tuple[str, ...], scales: tuple[float, ...], seed: int) -> Truth:
    """With everything that is hidden; what is free is drawn from `seed` and the effect's own name."""
    for name, scale in zip(names, scales, strict=True):
        truth = HIDDEN[name].change(truth, scale, np.random.default_rng([seed, 31, *name.encode()]))
    return truth
