"""The model of a vehicle with its effects: from commands and state to the wrench that an IMU would report.

Order of the five places:

    commands -> [commands effects] -> h(u), thrusts -> [thrust effects] -> wrench about O -> [wrench effects]
             -> rigid body with [body effects] -> accelerations of O -> [sensor effects] -> reported wrench

The air is no place: [air effects] say how it moves, and effects on thrusts and wrench see the velocity through it.

The *reported* (measured) wrench is what the nominal processing makes of an IMU: with the nominal mass m and inertia
J and the nominal centre of mass,

    F_meas = m (f_O + domega x c + omega x (omega x c)),    M_meas = J domega + omega x J omega      (about c)

so that every model, whatever it believes about mass and centre of mass, is compared with one and the same measured
quantity (docs/design.md). Newton and Euler about O, for a body with mass m, inertia J_c about its centre of
mass c, wrench (F, M_O) about O and f_O the specific force at O:

    F   = m (f_O + domega x c + omega x (omega x c))
    M_O = J_c domega + omega x J_c omega + c x F
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numba import njit

from wrenchgap.flight.flight import Array
from wrenchgap.plant.actuation import actuation, rotor_wrench
from wrenchgap.plant.effects import sources
from wrenchgap.plant.effects.effect import (
    AirEffect,
    AnyEffect,
    BodyEffect,
    CommandEffect,
    Context,
    SensorEffect,
    Source,
    ThrustEffect,
    WrenchEffect,
)
from wrenchgap.plant.state import Actuation, Commands, Motion, Rates, State
from wrenchgap.plant.vehicle import Body, Vehicle


@dataclass(frozen=True)
class Provenance:
    """Where numbers come from: logs as (file name, SHA-256), when fitted (ISO 8601), with which version and command;
    `source` is the file of a user's own effect.
    """  # noqa: D205

    logs: tuple[tuple[str, str], ...] = ()
    fitted: str = ""
    version: str = ""
    method: str = ""
    source: Source | None = None


@dataclass(frozen=True)
class ModelEffect:
    """An effect with values: `theta` (P,) in the order of `effect.parameters(vehicle)`, `std` (P,) where known."""

    effect: AnyEffect
    theta: Array
    std: Array | None = None
    provenance: Provenance = field(default_factory=Provenance)

    @property
    def changed_source(self) -> str:
        """What to say where the file of a user's effect is not as it was when its values were fitted; else nothing."""
        then, now = self.provenance.source, sources().get(self.name)
        if then is None or now is None or now.sha256 == then.sha256:
            return ""
        changed = f"{now.file} is not as it was when the effect was fitted; fit it anew with wrenchgap add."
        return f"effect {self.name}: {changed}"

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name


def cross(a: Array, b: Array) -> Array:
    """Cross product a x b for (..., 3): plain expressions, several times faster than numpy's on single vectors."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), axis=-1)


def forward_dynamics(body: Body, wrench_B: Array, omega_B: Array) -> Motion:
    """Specific force at O and angular acceleration under wrenches (N, 6) about O at body rates (N, 3)."""
    force, moment = wrench_B[:, :3], wrench_B[:, 3:]
    c = body.com_B
    about_com = moment - cross(c, force)
    gyroscopic = cross(omega_B, omega_B @ body.inertia.T)
    omega_dot = (about_com - gyroscopic) @ np.linalg.inv(body.inertia).T
    specific = force / body.mass - cross(omega_dot, c) - cross(omega_B, cross(omega_B, c))
    return Motion(omega_B, omega_dot, specific)


def measured_wrench(body: Body, motion: Motion) -> Array:
    """Wrench (N, 6) about the centre of mass of `body` that explains a motion of O: the nominal IMU processing."""
    c, w = body.com_B, motion.omega_B
    force = body.mass * (motion.specific_force_B + cross(motion.omega_dot_B, c) + cross(w, cross(w, c)))
    moment = motion.omega_dot_B @ body.inertia.T + cross(w, w @ body.inertia.T)
    return np.concatenate((force, moment), axis=-1)


def about_com(body: Body, wrench_B: Array) -> Array:
    """The same wrenches (N, 6), moved from O to the centre of mass."""
    return np.concatenate((wrench_B[:, :3], wrench_B[:, 3:] - cross(body.com_B, wrench_B[:, :3])), axis=-1)


def about_origin(body: Body, wrench_B: Array) -> Array:
    """The same wrenches (N, 6), moved from the centre of mass to O."""
    return np.concatenate((wrench_B[:, :3], wrench_B[:, 3:] + cross(body.com_B, wrench_B[:, :3])), axis=-1)


_RATES = "actuator rates"


def actuator_rates(tilt: Array, speed: Array, dt: float, memory: Any = None) -> tuple[Rates, Any]:
    """Rates of the actuators by backward differences, and the memory to hand to the next call; None at the start."""
    before_tilt, before_speed, before_rate = (tilt[0], speed[0], None) if memory is None else memory
    rate = np.diff(tilt, axis=0, prepend=before_tilt[None]) / dt
    rotor_dot = np.diff(speed, axis=0, prepend=before_speed[None]) / dt
    rate_dot = np.diff(rate, axis=0, prepend=rate[:1] if before_rate is None else before_rate[None]) / dt
    if before_rate is None:  # nothing is known before the first sample: no acceleration until two rates are known
        rate_dot[:2] = 0.0
    first = memory is None and len(tilt) == 1
    return Rates(rate, rate_dot, rotor_dot), (tilt[-1], speed[-1], None if first else rate[-1])


class WrenchModel:
    """A vehicle and effects with values, ready to be evaluated on N samples or stepped with N = 1."""

    def __init__(self, vehicle: Vehicle, effects: tuple[ModelEffect, ...] = ()) -> None:
        self.vehicle = vehicle
        self.effects = tuple(sorted(effects, key=lambda e: (e.effect.order, e.name)))
        body = vehicle.body
        for item in self.effects:
            if isinstance(item.effect, BodyEffect):
                body = item.effect.apply(body, item.theta)
        self.body = body

    @cached_property
    def acting(self) -> WrenchModel:
        """The model without effects whose parameters are all zero, which have no effect."""
        there = tuple(item for item in self.effects if np.any(item.theta))
        return self if len(there) == len(self.effects) else WrenchModel(self.vehicle, there)

    @cached_property
    def dynamics(self) -> Array:
        """Mass, centre of mass, inertia and its inverse, with the body effects; the vehicle's own first three (35,)."""
        own = self.vehicle.body
        parts = (self.body.mass, self.body.com_B, self.body.inertia, np.linalg.inv(self.body.inertia))
        return np.concatenate([np.ravel(x) for x in (*parts, own.mass, own.com_B, own.inertia)])

    def context(self, state: State) -> Context:
        """Inputs of effects on thrusts and wrench in these states (N samples), with the air of the model."""
        air = [item.effect.apply(state, item.theta) for item in self.effects if isinstance(item.effect, AirEffect)]
        return Context(self.vehicle, state, np.sum(air, axis=0) if air else None)

    def command(
        self, commands: Commands, state: State, dt: float, memory: dict[str, Any] | None = None
    ) -> tuple[Commands, dict[str, Any]]:
        """Commands as they take effect, after lags, delays and offsets; `memory` is what to pass to the next call."""
        context = Context(self.vehicle, state)
        memory = {} if memory is None else dict(memory)
        for item in self.effects:
            if isinstance(item.effect, CommandEffect):
                commands, kept = item.effect.apply(commands, item.theta, context, dt, memory.get(item.name))
                memory[item.name] = kept
        return commands, memory

    def wrench(self, commands: Commands, state: State, rates: Rates | None = None) -> Array:
        """Wrench (N, 6) about O that these (effective) commands make in this state; at rest without `rates`."""
        act, rotors = self.rotors(commands, state, rates)
        return sum((self.addition(item, act, rotors, state) for item in self.added), start=rotors)

    def rotors(
        self, commands: Commands, state: State, rates: Rates | None = None, nominal: Actuation | None = None
    ) -> tuple[Actuation | None, Array]:
        """The actuation, None without rotors, and its wrench (N, 6) about O.

        `nominal` is the nominal actuation at `commands`, where it is known.
        """
        if not self.vehicle.has_rotors or commands.rotor_speed is None:
            return None, about_origin(self.vehicle.body, commands.wrench_B)
        context = self.context(state)
        act = replace(actuation(self.vehicle, commands) if nominal is None else nominal, rates=rates)
        for item in self.effects:
            if isinstance(item.effect, ThrustEffect):
                act = act.with_thrust(item.effect.apply(act, item.theta, context))
        return act, rotor_wrench(act)

    @property
    def added(self) -> tuple[ModelEffect, ...]:
        """The effects that add a wrench to that of the rotors."""
        return tuple(item for item in self.effects if isinstance(item.effect, WrenchEffect))

    def addition(self, item: ModelEffect, act: Actuation | None, rotors: Array, state: State) -> Array:
        """The wrench (N, 6) about O that one of `added` adds."""
        assert isinstance(item.effect, WrenchEffect)
        return item.effect.apply(act, rotors, item.theta, self.context(state))

    def actuate(
        self, commands: Commands, state: State, dt: float, memory: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Wrench (N, 6) about O, through all effects on commands, thrusts and wrench; and the memory."""
        commands, memory = self.command(commands, state, dt, memory)
        rates, memory = self.rates(commands, dt, memory)
        return self.wrench(commands, state, rates), memory

    def rates(
        self, commands: Commands, dt: float, memory: dict[str, Any] | None = None
    ) -> tuple[Rates | None, dict[str, Any]]:
        """Rates of the actuators under effective commands, where an effect asks for them; and the memory."""
        memory, rates = {} if memory is None else memory, None
        tilt, speed = commands.tilt, commands.rotor_speed
        if tilt is not None and speed is not None and any(item.effect.needs_rates for item in self.effects):
            rates, memory[_RATES] = actuator_rates(tilt, speed, dt, memory.get(_RATES))
        return rates, memory

    def motion(self, wrench_B: Array, omega_B: Array) -> Motion:
        """Accelerations of O under wrenches (N, 6) about O, with the body effects."""
        return forward_dynamics(self.body, wrench_B, omega_B)

    def read_imu(self, motion: Motion, state: State) -> Motion:
        """The motion of O by the nominal processing of the IMU, with the sensor effects."""
        context = Context(self.vehicle, state)
        for item in self.effects:
            if isinstance(item.effect, SensorEffect):
                motion = item.effect.apply(motion, item.theta, context)
        return motion

    def report(self, wrench_B: Array, state: State, body: Body | None = None) -> Array:
        """The measured wrench (N, 6) that this model predicts when the wrench about O is `wrench_B`.

        The nominal processing is that of the model's vehicle, or of `body`. Without effects on sensors, many samples
        are one compiled pass.
        """
        on_sensors = any(isinstance(item.effect, SensorEffect) for item in self.effects)
        if not on_sensors and _is_batch(wrench_B, state.omega_B):
            numbers = self.dynamics
            if body is not None:
                numbers = np.concatenate((numbers[:22], [body.mass], body.com_B, body.inertia.ravel()))
            wrench, omega = np.ascontiguousarray(wrench_B), np.ascontiguousarray(state.omega_B)
            return np.asarray(_reported_wrench(wrench, omega, numbers))
        motion = self.read_imu(self.motion(wrench_B, state.omega_B), state)
        return measured_wrench(self.vehicle.body if body is None else body, motion)

    def predict(self, commands: Commands, state: State, dt: float) -> Array:
        """Predicted measured wrench (N, 6) of consecutive samples `dt` [s] apart, unfiltered."""
        return self.report(self.actuate(commands, state, dt)[0], state)


def _is_batch(*arrays: Any, least: int = 64) -> bool:
    """Whether these are arrays of numbers with `least` samples: a closed loop has one, a trace no numbers."""
    return all(type(a) is np.ndarray and a.dtype == np.float64 and len(a) >= least for a in arrays)


@njit(cache=True, nogil=True)
def _cross(a, b):  # type: ignore[no-untyped-def]
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, nogil=True)
def _times(M, v):  # type: ignore[no-untyped-def]
    return (
        M[0, 0] * v[0] + M[0, 1] * v[1] + M[0, 2] * v[2],
        M[1, 0] * v[0] + M[1, 1] * v[1] + M[1, 2] * v[2],
        M[2, 0] * v[0] + M[2, 1] * v[1] + M[2, 2] * v[2],
    )


@njit(cache=True, nogil=True)
def _reported_wrench(wrench: Array, omega: Array, numbers: Array) -> Array:
    """Measured wrench (N, 6): `measured_wrench` of a believed body after `forward_dynamics` of the true one.

    `numbers` (35,) holds mass, centre of mass, inertia and its inverse of the true body, then mass, centre of mass and
    inertia of the believed one.
    """
    mass, com, inertia, inverse = numbers[0], numbers[1:4], numbers[4:13].reshape(3, 3), numbers[13:22].reshape(3, 3)
    believed_mass, believed_com, believed_inertia = numbers[22], numbers[23:26], numbers[26:35].reshape(3, 3)
    out = np.empty((len(wrench), 6))
    c, d = (com[0], com[1], com[2]), (believed_com[0], believed_com[1], believed_com[2])
    for k in range(len(wrench)):
        force = (wrench[k, 0], wrench[k, 1], wrench[k, 2])
        w = (omega[k, 0], omega[k, 1], omega[k, 2])
        arm = _cross(c, force)
        gyro = _cross(w, _times(inertia, w))
        moment = (wrench[k, 3] - arm[0] - gyro[0], wrench[k, 4] - arm[1] - gyro[1], wrench[k, 5] - arm[2] - gyro[2])
        omega_dot = _times(inverse, moment)
        euler, centripetal = _cross(omega_dot, c), _cross(w, _cross(w, c))
        euler_d, centripetal_d = _cross(omega_dot, d), _cross(w, _cross(w, d))
        torque, gyro_d = _times(believed_inertia, omega_dot), _cross(w, _times(believed_inertia, w))
        for a in range(3):
            specific = force[a] / mass - euler[a] - centripetal[a]
            out[k, a] = believed_mass * (specific + euler_d[a] + centripetal_d[a])
            out[k, 3 + a] = torque[a] + gyro_d[a]
    return out
