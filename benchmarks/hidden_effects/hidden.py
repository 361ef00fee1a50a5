"""What can be hidden in a flight: one small class per effect, built physically where MuJoCo can build it.

None of the formulas is the catalogue's: masses are real masses, ropes are tendons, play is a gap between two joints,
the wake is a widening smooth top hat. A class has its parameters as fields [SI], `draw(size, rng)` to choose them for
a size and a seed, and overrides what it touches:

    build    the airframe, before the flight
    start    once, when the flight begins
    command  tilt (6,) [rad] and rotor speed (12,) [rad/s] commands, every physics step
    thrust   the twelve thrusts [N], every physics step
    push     forces and torques, through `Engine.push` and `Engine.twist`, every physics step

`answers` are the names of the project's catalogue that are right for it, best first; `("unknown",)` for what is not
in it. `unit` says what a plain `size` means; `size` is the default. `shows_on` is the trajectory that excites the
effect, and `needs_split` says that it shows only where the two rotors of a pair differ (`pair_split` of `engine.fly`).
"""

# Long because it is one list of small classes with one base, read like a catalogue.

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Self, TypeVar, dataclass_transform

import numpy as np

from benchmarks.hidden_effects.airframe import (
    C_F,
    GRAVITY,
    HOVER_SPEED,
    INERTIA,
    MASS,
    RADIUS,
    SPEED_MAX,
    TWIST,
    Airframe,
)
from benchmarks.hidden_effects.world import Engine, Hidden
from wrenchgap.flight.flight import Array

H = TypeVar("H", bound=Hidden)
AIR = 1.2
"""Density [kg/m^3]."""
DISC = np.pi * RADIUS**2
HOVER_THRUST = MASS * GRAVITY / 12


HIDDEN: dict[str, type[Hidden]] = {}
"""Every hidden effect by name."""


@dataclass_transform()
def hidden(name: str) -> Callable[[type[H]], type[H]]:
    """Class decorator: make a dataclass, register under `name`."""

    def register(cls: type[H]) -> type[H]:
        HIDDEN[name] = dataclass(cls)
        return cls

    return register


def _direction(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


def _vector(xyz: Array) -> tuple[float, float, float]:
    return float(xyz[0]), float(xyz[1]), float(xyz[2])


@dataclass
class Vector(Hidden):
    """Base of what is a vector of length `size`, drawn in any direction."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """Any direction."""
        return cls(*_vector(size * _direction(rng)))

    @property
    def xyz(self) -> Array:
        """(3,)."""
        return np.array((self.x, self.y, self.z))


# ---------------------------------------------------------------- mass properties


@hidden("com_offset")
class ComOffset(Vector):
    """The hull (frame, battery, computer) sits beside the middle: r_total = r_hull m_hull / m."""

    answers = ("com_offset",)
    unit, size = "m, distance of the centre of mass from O", 0.009

    def build(self, airframe: Airframe) -> None:
        """Shift the hull; nothing else moves, and the mass stays."""
        airframe.hull_shift = airframe.hull_shift + self.xyz * MASS / airframe.hull()[0]


@hidden("inertia")
class Inertia(Hidden):
    """Pairs of masses at +-0.28 m on the body axes, taken from the middle: dJ = (sy + sz, sx + sz, sx + sy)."""

    answers = ("inertia",)
    unit, size = "largest relative change of a principal moment", 0.15
    sx: float = 0.0  # kg m^2, added second moment along x
    sy: float = 0.0
    sz: float = 0.0
    REACH: ClassVar[float] = 0.28

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """Any mix of the three axes."""
        s = rng.dirichlet((1.0, 1.0, 1.0))
        change = np.array((s[1] + s[2], s[0] + s[2], s[0] + s[1])) / INERTIA
        return cls(*_vector(s * size / change.max()))

    def build(self, airframe: Airframe) -> None:
        """Six small masses; the total stays."""
        for axis, moment in enumerate((self.sx, self.sy, self.sz)):
            for sign in (1, -1):
                airframe.ballast.append((moment / (2 * self.REACH**2) + 1e-6, sign * self.REACH * np.eye(3)[axis]))


@hidden("mass")
class Mass(Hidden):
    """The vehicle is heavier than weighed; the addition sits at O."""

    answers = ("mass", "thrust_scale", "coaxial_loss")
    unit, size = "relative", 0.04
    relative: float = 0.04

    def build(self, airframe: Airframe) -> None:
        """Heavier hull."""
        airframe.mass *= 1 + self.relative


@hidden("payload")
class Payload(Hidden):
    """A box strapped rigidly under the hull: mass, centre of mass and inertia together."""

    answers = ("payload",)
    unit, size = "kg", 0.25
    mass: float = 0.25
    x: float = 0.05
    y: float = -0.03
    z: float = -0.10

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """Somewhere below."""
        return cls(size, *_vector(np.array((*rng.uniform(-0.08, 0.08, 2), rng.uniform(-0.14, -0.06)))))

    def build(self, airframe: Airframe) -> None:
        """Extra, not taken from the hull."""
        airframe.mass += self.mass
        airframe.ballast.append((self.mass, np.array((self.x, self.y, self.z))))


@hidden("heavy_arms")
class HeavyArms(Hidden):
    """More inertia about the tilt axes: arms and hull exchange more angular momentum. The total stays as stated."""

    answers = ("arm_reaction",)
    unit, size = "kg m^2 per arm", 2e-3
    added: float = 2e-3

    def build(self, airframe: Airframe) -> None:
        """Like a disc across the arm: half as much about y and z."""
        x, y, z = airframe.arm_inertia
        airframe.arm_inertia = (x + self.added, y + self.added / 2, z + self.added / 2)


# ---------------------------------------------------------------- actuators


@hidden("servo_lag")
class ServoLag(Hidden):
    """A softer position loop in every servo."""

    answers = ("servo_lag", "command_delay")
    unit, size = "s, more than the ideal 15 ms", 0.045
    added: float = 0.045

    def build(self, airframe: Airframe) -> None:
        """Lower the loop gain 1/tau."""
        airframe.servo_tau += self.added


@hidden("motor_lag")
class MotorLag(Hidden):
    """Rotors with inertia, driven by the torque that would hold the commanded speed: dOmega ~ Omega_cmd^2 - Omega^2."""

    answers = ("motor_lag", "command_delay")
    unit, size = "s at hover speed", 0.04
    tau: float = 0.04

    def build(self, airframe: Airframe) -> None:
        """The engine integrates the speeds."""
        airframe.motor_tau = self.tau


@hidden("command_delay")
class CommandDelay(Hidden):
    """A queue between controller and actuators."""

    answers = ("command_delay",)
    unit, size = "s", 0.025
    delay: float = 0.025

    def start(self, world: Engine) -> None:
        """An empty queue gives the first command at once."""
        self._queue: deque[tuple[Array, Array]] = deque(maxlen=round(self.delay / world.step) + 1)

    def command(self, world: Engine, tilt: Array, speed: Array) -> tuple[Array, Array]:
        """The oldest in the queue."""
        self._queue.append((tilt, speed))
        return self._queue[0]


@hidden("tilt_offset")
class TiltOffset(Hidden):
    """Rotor pairs mounted turned about their arms [rad]."""

    answers = ("tilt_offset",)
    unit, size = "deg, rms over the arms", 1.0
    per_arm: tuple[float, ...] = (0.0,) * 6

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """A common part and one per arm."""
        angles = rng.normal() + rng.normal(size=6)
        angles *= np.deg2rad(size) / np.sqrt((angles**2).mean())
        return cls(tuple(float(a) for a in angles))

    def build(self, airframe: Airframe) -> None:
        """Turn the hub sites."""
        airframe.tilt_zero = airframe.tilt_zero + np.array(self.per_arm)


@hidden("backlash")
class Backlash(Hidden):
    """Real play: a servo turns a gear, the arm follows only where the gap closes; friction holds it in between."""

    answers = ("backlash",)
    unit, size = "deg, whole gap", 1.0
    gap: float = 0.0175

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """As told."""
        return cls(float(np.deg2rad(size)))

    def build(self, airframe: Airframe) -> None:
        """Two joints per arm and a limited coupling."""
        airframe.play = self.gap


@hidden("droop")
class Droop(Hidden):
    """Servos that give way under load: the arm turns by an angle proportional to its pair's thrust."""

    answers = ("arm_twist", "tilt_offset")
    unit, size = "deg at hover thrust", 1.5
    angle: float = 0.026

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """As told."""
        return cls(float(np.deg2rad(size)))

    def command(self, world: Engine, tilt: Array, speed: Array) -> tuple[Array, Array]:
        """Soft under thrust, all the same way round."""
        load = (speed**2).reshape(6, 2).sum(1) / (2 * HOVER_SPEED**2)
        return tilt - self.angle * load, speed


# ---------------------------------------------------------------- rotor thrusts


@hidden("weak_rotor")
class WeakRotor(Hidden):
    """One damaged rotor gives less thrust and less drag torque."""

    answers = ("rotor_thrust",)
    unit, size = "fraction of its thrust that is lost", 0.15
    rotor: int = 3
    loss: float = 0.15

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """Any rotor."""
        return cls(int(rng.integers(12)), size)

    def thrust(self, world: Engine, thrust: Array) -> Array:
        """Scale one."""
        out = thrust.copy()
        out[self.rotor] *= 1 - self.loss
        return out


@hidden("thin_air")
class ThinAir(Hidden):
    """All rotors in air of another density."""

    answers = ("thrust_scale", "coaxial_loss", "mass")
    unit, size = "relative density that is missing", 0.08
    missing: float = 0.08

    def thrust(self, world: Engine, thrust: Array) -> Array:
        """Thrust and drag torque go with density."""
        return thrust * (1 - self.missing)


@hidden("coaxial_loss")
class CoaxialLoss(Hidden):
    """The lower rotor works in the upper's slipstream: loses size * 2 r / (1 + r), r = T_up / T_low."""

    answers = ("coaxial_loss", "thrust_scale", "mass")
    unit, size = "fraction of the lower thrust at equal speeds", 0.15
    loss: float = 0.15

    def thrust(self, world: Engine, thrust: Array) -> Array:
        """More when the upper works harder."""
        out = thrust.copy()
        up, low = thrust[0::2], thrust[1::2]
        out[1::2] = low * (1 - self.loss * 2 * up / (up + low + 1e-9))
        return out


@hidden("wake")
class Wake(Hidden):
    """Rotor pairs in their neighbours' wake, a smooth top hat that widens downstream.

    loss of pair i = 1 - prod_j (1 - k sqrt(T_j / T_i) R / w(s) / (1 + (rho / w(s))^4)),  w(s) = 0.8 R + 0.12 s

    at the distance s > 0 down pair j's axis and rho off it; the square root is bounded by 1.6.
    """

    answers = ("rotor_interference",)
    unit, size = "k, fraction lost in the middle of an equal neighbour's wake", 0.22
    k: float = 0.22

    def thrust(self, world: Engine, thrust: Array) -> Array:
        """Every pair against every other."""
        hubs = world.hubs_E
        centre = 0.5 * (hubs[0::2] + hubs[1::2])
        axis = world.normals_E[0::2]
        apart = centre[:, None, :] - centre[None, :, :]  # to i from j
        down = -(apart * axis[None]).sum(-1)
        off2 = (apart**2).sum(-1) - down**2
        width = 0.8 * RADIUS + 0.12 * np.maximum(down, 0.0)
        pair = thrust[0::2] + thrust[1::2] + 1e-6
        ratio = np.minimum(np.sqrt(pair[None, :] / pair[:, None]), 1.6)
        loss = self.k * ratio * (RADIUS / width) / (1 + (off2 / width**2) ** 2)
        onset = 1 / (1 + np.exp(-(down - 0.03) / 0.01))  # nothing upstream
        keep = 1 - np.minimum(loss * onset, 0.9)
        np.fill_diagonal(keep, 1.0)
        return np.asarray(thrust * np.repeat(keep.prod(1), 2))


@hidden("blockage")
class Blockage(Hidden):
    """Wakes that blow on the booms of other arms: each boom is three pieces at 0.12, 0.20 and 0.28 m from O.

    A piece in the middle of pair j's wake is pushed along -n_j with `share` / 3 of T_j; one that is rho off the middle
    with 1 / (1 + (rho / 1.3 R)^4) of that.
    """

    answers = ("downwash_blockage", "rotor_interference")
    unit, size = "share of a pair's thrust that presses on a boom squarely in its wake", 0.15
    share: float = 0.15

    def push(self, world: Engine) -> None:
        """Six wakes on eighteen pieces."""
        centre = 0.5 * (world.hubs_E[0::2] + world.hubs_E[1::2])
        axis = world.normals_E[0::2]
        origin = world.position_E
        pieces = origin + np.concatenate([(centre - origin) * (r / 0.30) for r in (0.12, 0.20, 0.28)])
        apart = pieces[None] - centre[:, None]
        down = -(apart * axis[:, None]).sum(-1)
        off2 = ((apart**2).sum(-1) - down**2) / (1.3 * RADIUS) ** 2
        overlap = 1 / ((1 + off2**2) * (1 + np.exp((0.03 - down) / 0.01)))
        overlap[np.arange(18) % 6 == np.arange(6)[:, None]] = 0.0  # its own boom is part of its own thrust
        pair = C_F * (world.speed**2).reshape(6, 2).sum(1)
        world.push(-(self.share / 3 * overlap * pair[:, None]).T @ axis, pieces)


@hidden("ground")
class Ground(Hidden):
    """Rotors near the floor gain thrust: T (1 + size exp(-z / 2R)), each at its own height."""

    answers = ("ground_effect",)
    unit, size = "gain at zero height", 0.3
    shows_on = "low"
    gain: float = 0.3

    def thrust(self, world: Engine, thrust: Array) -> Array:
        """By the hub's height."""
        return thrust * (1 + self.gain * np.exp(-np.maximum(world.hubs_E[:, 2], 0.0) / (2 * RADIUS)))


@hidden("battery")
class Battery(Hidden):
    """A battery that empties, with inner resistance: thrust goes with (V / V_full)^1.5; V is recorded."""

    answers = ("battery_sag", "thrust_scale")
    unit, size = "relative voltage drop over 60 s of hover", 0.10
    drop: float = 0.10
    FULL: ClassVar[float] = 25.2
    RESISTANCE: ClassVar[float] = 0.012

    def start(self, world: Engine) -> None:
        """Full."""
        self._charge, self.voltage = 1.0, self.FULL

    def thrust(self, world: Engine, thrust: Array) -> Array:
        """Current goes with induced power, sum T^1.5."""
        load = float((np.maximum(thrust, 0.0) ** 1.5).sum()) / (12 * HOVER_THRUST**1.5)
        self._charge -= world.step / 60 * load
        self.voltage = self.FULL * (1 - self.drop * (1 - self._charge)) - self.RESISTANCE * 40 * load
        return np.asarray(thrust * (self.voltage / self.FULL) ** 1.5)


@hidden("inflow")
class Inflow(Hidden):
    """Axial speed changes thrust as in momentum theory at fixed power: T (sqrt(1 + u^2) - u), u = size v_n / 2 v_i."""

    answers = ("axial_inflow",)
    unit, size = "strength (1: momentum theory)", 1.0
    strength: float = 1.0

    def thrust(self, world: Engine, thrust: Array) -> Array:
        """Per rotor, with the speed of its own hub."""
        climb = (world.hub_velocity_E * world.normals_E).sum(1)
        u = 0.5 * self.strength * climb / np.sqrt(np.maximum(thrust, 0.3) / (2 * AIR * DISC))
        return np.asarray(thrust * (np.sqrt(1 + u * u) - u))


@hidden("edgewise")
class Edgewise(Hidden):
    """Fresh air from the side lifts: T (1 + size v_t^2 / (v_t^2 + 4 v_i^2))."""

    answers = ("translational_lift",)
    unit, size = "relative gain at high speed", 0.4
    shows_on = "fast"
    gain: float = 0.4

    def thrust(self, world: Engine, thrust: Array) -> Array:
        """Per rotor."""
        v, n = world.hub_velocity_E, world.normals_E
        v_t2 = (v**2).sum(1) - (v * n).sum(1) ** 2
        v_i2 = np.maximum(thrust, 0.3) / (2 * AIR * DISC)
        return np.asarray(thrust * (1 + self.gain * v_t2 / (v_t2 + 4 * v_i2)))


@hidden("stall")
class Stall(Hidden):
    """Blades that stall: thrust flattens above hover, and is a little more below it: another thrust curve."""

    answers = ("thrust_curve",)
    unit, size = "relative loss at full speed", 0.25
    loss: float = 0.25

    def thrust(self, world: Engine, thrust: Array) -> Array:
        """Linear in the thrust itself."""
        return np.asarray(thrust * (1 - self.loss * (thrust - HOVER_THRUST) / (C_F * SPEED_MAX**2 - HOVER_THRUST)))


# ---------------------------------------------------------------- forces


def _drag(world: Engine, areas: tuple[float, float, float], airspeed_E: Array) -> None:
    R = world.R_EB
    v = R.T @ airspeed_E
    world.push(R @ (-0.5 * AIR * np.array(areas) * np.abs(v) * v), world.position_E + 0.03 * R[:, 2])


@hidden("body_drag")
class BodyDrag(Hidden):
    """Three flat plates, -1/2 rho A_k |v_k| v_k along each body axis, acting 30 mm above O."""

    answers = ("body_drag",)
    unit, size = "m^2, drag area along x", 0.15
    shows_on = "fast"
    area_x: float = 0.15
    area_y: float = 0.15
    area_z: float = 0.25

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """Another side, a larger bottom."""
        return cls(size, size * float(rng.uniform(0.7, 1.3)), size * float(rng.uniform(1.3, 1.9)))

    def push(self, world: Engine) -> None:
        """Through the air."""
        _drag(world, (self.area_x, self.area_y, self.area_z), world.velocity_E)


@hidden("wind")
class Wind(Hidden):
    """A steady wind with slow gusts on plates of 0.12, 0.12, 0.2 m^2."""

    answers = ("wind", "tether", "constant_wrench", "body_drag")
    unit, size = "m/s", 4.0
    speed: float = 4.0
    heading: float = 0.7

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """From anywhere."""
        return cls(size, float(rng.uniform(-np.pi, np.pi)))

    def push(self, world: Engine) -> None:
        """Gusts of a quarter of the speed, 5 and 9 s."""
        gust = 1 + 0.15 * np.sin(2 * np.pi * world.time / 9.1) + 0.1 * np.sin(2 * np.pi * world.time / 5.3 + 1)
        wind = self.speed * gust * np.array((np.cos(self.heading), np.sin(self.heading), 0.0))
        _drag(world, (0.12, 0.12, 0.20), world.velocity_E - wind)


@hidden("paddle")
class Paddle(Hidden):
    """Turning is braked: torque -size omega sqrt(|omega|^2 + 0.3^2)."""

    answers = ("rotational_drag",)
    unit, size = "Nm s^2", 0.05
    brake: float = 0.05

    def push(self, world: Engine) -> None:
        """Between linear and quadratic."""
        w = world.omega_B
        world.twist(world.R_EB @ (-self.brake * w * np.sqrt(w @ w + 0.09)))


@hidden("flapping")
class Flapping(Hidden):
    """Discs lean back in edgewise flow: in-plane force -T tan(a), a = size v_t / (Omega R)."""

    answers = ("rotor_drag", "body_drag")
    unit, size = "rad per unit advance ratio", 2.0
    slope: float = 2.0

    def push(self, world: Engine) -> None:
        """At the hubs."""
        v, n = world.hub_velocity_E, world.normals_E
        edge = v - (v * n).sum(1, keepdims=True) * n
        world.push(-(self.slope * C_F / RADIUS * world.speed)[:, None] * edge, world.hubs_E)


@hidden("tether")
class Tether(Hidden):
    """A long elastic line from a point of the hull to a far anchor: MuJoCo's spatial tendon."""

    answers = ("tether", "constant_wrench")
    unit, size = "N, pull at the start", 1.0
    pull: float = 1.0
    anchor: tuple[float, float, float] = (10.0, 5.0, 0.0)
    at: tuple[float, float, float] = (0.06, 0.03, -0.04)
    STIFFNESS: ClassVar[float] = 0.05

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """An anchor 12 m away, mostly sideways; anywhere on the hull's rim."""
        side, rim = rng.uniform(-np.pi, np.pi, 2)
        anchor = (12 * np.cos(side), 12 * np.sin(side), float(rng.uniform(-6, 6)))
        return cls(size, _vector(np.array(anchor)), _vector(np.array((0.09 * np.cos(rim), 0.09 * np.sin(rim), -0.05))))

    def build(self, airframe: Airframe) -> None:
        """Two sites and a spring."""
        length = float(np.linalg.norm(np.array(self.anchor) - np.array((0.0, 0.0, 1.6)) - np.array(self.at)))
        rest = length - self.pull / self.STIFFNESS
        airframe.extra_world.append(f'<site name="anchor" pos="{" ".join(map(str, self.anchor))}"/>')
        airframe.extra_bodies.append(f'<site name="knot" pos="{" ".join(map(str, self.at))}"/>')
        airframe.extra_tendons.append(
            f'<spatial stiffness="{self.STIFFNESS}" springlength="{rest}">'
            '<site site="anchor"/><site site="knot"/></spatial>'
        )


@hidden("fan")
class Fan(Vector):
    """A steady force fixed in E on the hull's middle."""

    answers = ("constant_wrench", "tether", "wind")
    unit, size = "N", 0.8

    def push(self, world: Engine) -> None:
        """Always the same."""
        world.push(self.xyz, world.position_E)


@hidden("jet")
class Jet(Hidden):
    """A steady push fixed to the hull, off its middle: force and torque constant in B."""

    answers = ("constant_wrench",)
    unit, size = "N", 0.8
    force: tuple[float, float, float] = (0.6, 0.4, 0.3)
    at: tuple[float, float, float] = (0.1, -0.2, 0.05)

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """Any direction, 0.2 m off."""
        return cls(_vector(size * _direction(rng)), _vector(0.2 * _direction(rng)))

    def push(self, world: Engine) -> None:
        """In body axes."""
        R = world.R_EB
        world.push(R @ np.array(self.force), world.position_E + R @ np.array(self.at))


@hidden("drag_torque")
class DragTorque(Hidden):
    """Blades with another torque-to-thrust ratio; shows only where the two rotors of a pair differ."""

    answers = ("drag_torque",)
    unit, size = "relative", 0.3
    needs_split = True
    relative: float = 0.3

    def build(self, airframe: Airframe) -> None:
        """More twist per thrust."""
        airframe.kappa *= 1 + self.relative


@hidden("gyroscopic")
class Gyroscopic(Hidden):
    """Rotors with angular momentum h = -s J_r Omega n: the arm feels -omega x h and -s' J_r dOmega."""

    answers = ("rotor_gyroscopic",)
    unit, size = "kg m^2 per rotor", 6e-5
    needs_split = True
    inertia: float = 6e-5

    def start(self, world: Engine) -> None:
        """Turning."""
        self._last: Array | None = None

    def push(self, world: Engine) -> None:
        """Pairs nearly cancel."""
        n = world.normals_E
        spin = -self.inertia * TWIST
        change = np.zeros(12) if self._last is None else spin * (world.speed - self._last) / world.step
        self._last = world.speed.copy()
        h = ((spin * world.speed)[:, None] * n).reshape(6, 2, 3).sum(1)
        outward = world.hubs_E[0::2] + world.hubs_E[1::2] - 2 * world.position_E
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        turn = world.R_EB @ world.omega_B + world.tilt_rate[:, None] * outward
        world.twist_arms(-np.cross(turn, h) - (change[:, None] * n).reshape(6, 2, 3).sum(1))


# ---------------------------------------------------------------- sensors


@hidden("imu_turned")
class ImuTurned(Vector):
    """The IMU is mounted turned by a small rotation vector [rad]."""

    answers = ("imu_misalignment",)
    unit, size = "deg", 1.5
    x: float = 0.0
    y: float = 0.026
    z: float = 0.0

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """About any axis."""
        return super().draw(np.deg2rad(size), rng)

    def build(self, airframe: Airframe) -> None:
        """Turn its site."""
        airframe.imu_rotvec = self.xyz


@hidden("imu_moved")
class ImuMoved(Vector):
    """The IMU is not at O [m]."""

    answers = ("imu_lever_arm",)
    unit, size = "m", 0.04

    def build(self, airframe: Airframe) -> None:
        """Move its site."""
        airframe.imu_position = self.xyz


# ---------------------------------------------------------------- not in the catalogue


@hidden("slung_load")
class SlungLoad(Hidden):
    """A mass on a light rod from a ball joint under the hull: a pendulum, carried in addition to the stated mass."""

    answers = ("unknown", "payload", "tether")
    unit, size = "kg", 0.2
    mass: float = 0.2
    length: float = 0.5

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """Some length."""
        return cls(size, float(rng.uniform(0.35, 0.7)))

    def build(self, airframe: Airframe) -> None:
        """A body on a ball joint."""
        airframe.extra_bodies.append(
            f'<body pos="0 0 -0.05"><joint type="ball" damping="0.003"/>'
            f'<inertial pos="0 0 {-self.length}" mass="{self.mass}" diaginertia="1e-4 1e-4 1e-4"/></body>'
        )


@hidden("slosh")
class Slosh(Hidden):
    """A part of the hull's mass moves on springs in the plane z = 0 (a half-filled tank)."""

    answers = ("unknown", "payload")
    unit, size = "kg", 0.3
    mass: float = 0.3
    frequency: float = 1.2  # Hz

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """1 to 2 Hz."""
        return cls(size, float(rng.uniform(1.0, 2.0)))

    def build(self, airframe: Airframe) -> None:
        """Two slides with springs, 15 % damped."""
        k = self.mass * (2 * np.pi * self.frequency) ** 2
        c = 2 * 0.15 * np.sqrt(k * self.mass)
        joints = "".join(
            f'<joint type="slide" axis="{axis}" stiffness="{k}" damping="{c}" springref="0"/>'
            for axis in ("1 0 0", "0 1 0")
        )
        airframe.extra_hull_mass += self.mass
        airframe.extra_bodies.append(
            f'<body>{joints}<inertial pos="0 0 0" mass="{self.mass}" diaginertia="1e-5 1e-5 1e-5"/></body>'
        )


@hidden("compass")
class Compass(Hidden):
    """A magnet in the hull and a field in the room: torque m_B x R^T b_E, which depends on heading and attitude."""

    answers = ("unknown",)
    unit, size = "Nm, largest torque", 0.25
    shows_on = "turn"
    moment: float = 0.25
    heading: float = 0.5
    inclination: float = -0.5

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """A field from anywhere, the magnet along body x."""
        return cls(size, float(rng.uniform(-np.pi, np.pi)), float(rng.uniform(-0.8, 0.8)))

    def push(self, world: Engine) -> None:
        """Magnet along body x."""
        i = self.inclination
        field = np.array((np.cos(i) * np.cos(self.heading), np.cos(i) * np.sin(self.heading), np.sin(i)))
        world.twist(self.moment * np.cross(world.R_EB[:, 0], field))


@hidden("resonance")
class Resonance(Hidden):
    """A weakly damped mast: part of the hull's mass on a sprung ball joint. Held still it would change nothing."""

    answers = ("unknown",)
    unit, size = "kg", 0.10
    mass: float = 0.10
    frequency: float = 1.5  # Hz
    length: float = 0.25

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """1.2 to 1.8 Hz; a heavy mast is short, or the hull could not make up for its inertia."""
        return cls(size, float(rng.uniform(1.2, 1.8)), min(0.25, float(np.sqrt(0.0062 / size))))

    def build(self, airframe: Airframe) -> None:
        """Upright above O, 3 % damped; the hull is lowered and thinned so that the totals stay as stated."""
        inertia = self.mass * self.length**2
        k = inertia * (2 * np.pi * self.frequency) ** 2 + self.mass * GRAVITY * self.length
        c = 2 * 0.03 * np.sqrt(k * inertia)
        airframe.extra_hull_mass += self.mass
        lowered = self.mass * self.length / airframe.hull()[0]
        airframe.hull_shift = airframe.hull_shift - np.array((0.0, 0.0, lowered))
        moved = inertia + airframe.hull()[0] * lowered**2
        airframe.hull_inertia_less = airframe.hull_inertia_less + np.array((moved, moved, 0.0))
        airframe.extra_bodies.append(
            f'<body><joint type="ball" stiffness="{k}" damping="{c}"/>'
            f'<inertial pos="0 0 {self.length}" mass="{self.mass}" diaginertia="1e-5 1e-5 1e-5"/></body>'
        )


@hidden("ringing")
class Ringing(Hidden):
    """Servos whose velocity loop is too slow for their position loop: they overshoot and ring at some hertz."""

    answers = ("unknown", "servo_lag")
    unit, size = "s, time constant of the velocity loop", 0.10
    inner: float = 0.10

    def build(self, airframe: Airframe) -> None:
        """Damping ratio sqrt(outer / inner) / 2."""
        airframe.servo_inner_tau = self.inner


@hidden("heating")
class Heating(Hidden):
    """Motors that lose thrust as they warm up: T (1 - size (1 - exp(-t / 12 s))), no voltage recorded."""

    answers = ("battery_sag", "thrust_fade", "thrust_scale")
    unit, size = "relative loss when hot", 0.08
    loss: float = 0.08

    def thrust(self, world: Engine, thrust: Array) -> Array:
        """By time alone."""
        return np.asarray(thrust * (1 - self.loss * (1 - np.exp(-world.time / 12.0))))
