"""A trial of a user effect on one vehicle: arguments of `apply` for a few samples in motion, and its results."""

from dataclasses import replace
from functools import cache
from typing import Any, cast

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import Array
from wrenchgap.plant import model_file
from wrenchgap.plant.actuation import actuation
from wrenchgap.plant.effects import (
    AirEffect,
    AnyEffect,
    BodyEffect,
    CommandEffect,
    Context,
    SensorEffect,
    ThrustEffect,
    WrenchEffect,
)
from wrenchgap.plant.state import Commands, Motion, Rates, State, rows
from wrenchgap.plant.vehicle import Body, Vehicle

PLACES: dict[type, tuple[type, tuple[str, ...]]] = {
    CommandEffect: (Commands, ("wrench_B", "tilt", "rotor_speed")),
    BodyEffect: (Body, ("mass", "inertia", "com_B")),
    SensorEffect: (Motion, ("omega_B", "omega_dot_B", "specific_force_B")),
    ThrustEffect: (np.ndarray, ("the thrusts",)),
    WrenchEffect: (np.ndarray, ("the added wrench",)),
    AirEffect: (np.ndarray, ("the air's velocity",)),
}
"""What `apply` returns at each place, and what its arrays are called."""


class Wrong(Exception):
    """The result of `apply` does not suit its place."""


class Trial:
    """One effect on one vehicle: arguments for `apply` on so many `samples`, and the arrays that it returns."""

    def __init__(self, effect: AnyEffect, vehicle: Vehicle, samples: int = 6) -> None:
        self.samples = samples
        self.effect = effect
        self.place = next(place for place in PLACES if isinstance(effect, place))
        self.vehicle = vehicle
        self.state, self.commands, self.motion = _flight(vehicle, samples)
        self.context = Context(vehicle, self.state)
        self.actuation = None
        if vehicle.has_rotors:
            a, r = (0.1 * np.ones((samples, len(part))) for part in vehicle.geometry())
            self.actuation = replace(actuation(vehicle, self.commands), rates=Rates(a, a, r))

    @property
    def results(self) -> tuple[str, ...]:
        """Names of the arrays that `apply` returns."""
        _, names = PLACES[self.place]
        return names[:1] if self.place is CommandEffect and not self.vehicle.has_rotors else names

    def unchanged(self) -> tuple[Array, ...]:
        """The results of `apply` without an effect."""
        if self.place in (WrenchEffect, AirEffect):
            return (np.zeros((self.samples, 6 if self.place is WrenchEffect else 3)),)
        given = self.arguments(np.zeros(0))[0]
        if self.place is ThrustEffect:
            return (given.thrust,)
        return self.arrays((given, None) if self.place is CommandEffect else given)

    def arguments(self, theta: Array, at: slice = slice(None), memory: Any = None) -> tuple[Any, ...]:
        """Arguments of `apply` for some of the samples."""
        state, act = self.state.take(at), self.actuation
        context = Context(self.vehicle, state)
        if act is not None:
            act = replace(rows(act, at), rates=rows(act.rates, at))
        given: dict[type, tuple[Any, ...]] = {
            CommandEffect: (self.commands.take(at), theta, context, 0.01, memory),
            BodyEffect: (self.vehicle.body, theta),
            AirEffect: (state, theta),
            SensorEffect: (rows(self.motion, at), theta, context),
            ThrustEffect: (act, theta, context),
            WrenchEffect: (act, self.commands.wrench_B[at], theta, context),
        }
        return given[self.place]

    def arrays(self, returned: Any) -> tuple[Array, ...]:
        """The arrays in the result of `apply`; raises Wrong for a result of another kind."""
        kind, words = PLACES[self.place][0], type(returned).__name__
        if self.place is CommandEffect:
            if not (isinstance(returned, tuple) and len(returned) == 2 and isinstance(returned[0], kind)):
                raise Wrong(f"returned {words}, expected (Commands, memory)")
            returned = returned[0]
        elif not isinstance(returned, kind):
            raise Wrong(f"returned {words}, expected {'an array' if kind is np.ndarray else kind.__name__}")
        if kind is np.ndarray:
            return (np.asarray(returned, dtype=float),)
        return tuple(np.asarray(getattr(returned, name), dtype=float) for name in self.results)

    def one_by_one(self, theta: Array) -> tuple[Array, ...]:
        """The arrays when samples come one at a time, as in a simulation."""
        memory: Any = None
        parts = []
        for k in range(self.samples):
            returned = self.effect.apply(*self.arguments(theta, slice(k, k + 1), memory))
            if self.place is CommandEffect:
                memory = cast(Any, returned)[1]
            parts.append(self.arrays(returned))
        return tuple(np.concatenate(columns) for columns in zip(*parts, strict=True))


@cache
def vehicles() -> tuple[Vehicle, Vehicle]:
    """Six tilting arms with twelve rotors; and one of which only the wrench is known."""
    shipped = model_file.load("tilt_hexarotor").vehicle
    body = replace(shipped.body, com_B=np.array([0.001, -0.002, 0.003]))
    whole = replace(shipped, name="trial", body=body, imu_position_B=np.array([0.01, 0.0, 0.02]))
    return whole, replace(whole, arms=None, rotors=None)


def _flight(vehicle: Vehicle, n: int) -> tuple[State, Commands, Motion]:
    """N samples of a vehicle that moves, turns and tilts."""
    rng = np.random.default_rng(7)
    quat = so3.exp(rng.normal(0.0, 0.5, (n, 3)))
    time = np.linspace(0.0, 0.01 * (n - 1), n, dtype=np.float64)
    omega = rng.normal(size=(n, 3))
    position = rng.normal((0.0, 0.0, 2.0), 1.0, (n, 3))
    voltage = np.linspace(16.0, 15.0, n, dtype=np.float64)
    state = State(time, position, quat, 2.0 * rng.normal(size=(n, 3)), omega, voltage)
    wrench = rng.normal((0.0, 0.0, 39.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 0.5, 0.5, 0.5), (n, 6))
    commands = Commands(wrench)
    if vehicle.has_rotors:
        arms, rotors = vehicle.geometry()
        speed = 650.0 + 50.0 * rng.normal(size=(n, len(rotors)))
        commands = Commands(wrench, 0.3 * rng.normal(size=(n, len(arms))), speed)
    return state, commands, Motion(omega, rng.normal(size=(n, 3)), rng.normal((0.0, 0.0, 9.8), 1.0, (n, 3)))
