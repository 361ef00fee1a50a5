"""What the experiments share: fly, open the log as a user would, measure the attitude error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.paper.plants import Plant
from wrenchgap.flight import so3
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.learn.data.opening import OpenFlight, opened
from wrenchgap.plant.controller import attitude_error
from wrenchgap.plant.simulation.simulate import physics_rate, simulate
from wrenchgap.plant.trajectory import Trajectory


@dataclass
class Watched:
    """A compensator that remembers what it answered."""

    inner: Any
    results: list[Any] = field(default_factory=list)

    def step(self, *asked: Any) -> Any:
        """The inner compensator's answer."""
        self.results.append(self.inner.step(*asked))
        return self.results[-1]


@dataclass(frozen=True)
class Flown:
    """A flight, its e_R (N, 3) [rad] as motion capture sees it at `time` (N,) [s], and the compensator's answers."""

    flight: Flight
    time: Array
    error: Array
    results: Sequence[Any]

    @property
    def lost(self) -> bool:
        """Whether the simulation ended with a loss of control."""
        return any("control was lost" in note for note in self.flight.notes)


def fly(
    plant: Plant,
    trajectory: Trajectory,
    seed: int,
    *,
    compensator: Any = None,
    integral: bool = True,
    name: str = "flight",
) -> Flown:
    """Fly with the believed vehicle's controller, with or without its integral; deterministic in `seed`."""
    gains = replace(plant.believed.controller, integral=plant.believed.controller.integral if integral else 0.0)
    believed = replace(plant.believed, controller=gains)
    watched = None if compensator is None else Watched(compensator)
    flown = simulate(
        plant.truth,
        believed,
        trajectory,
        rng=np.random.default_rng([seed, 17]),
        compensator=watched,
        physics_rate=physics_rate(believed),
        name=name,
    )
    time, error = attitude_errors(flown)
    return Flown(flown, time, error, [] if watched is None else watched.results)


def attitude_errors(flown: Flight) -> tuple[Array, Array]:
    """Times (N,) [s] of the pose readings and e_R (N, 3) [rad] there."""
    assert flown.odometry is not None
    assert flown.reference is not None
    pose, reference = flown.odometry, flown.reference
    before = pose.time <= reference.time[-1]
    quat_ED = so3.interpolate(pose.time[before], reference.time, reference.quat_ED)
    error = attitude_error(pose.quat_EB[before], quat_ED)
    return pose.time[before], error


def as_log(flown: Flown, plant: Plant) -> OpenFlight:
    """The flight as `wrenchgap learn` would open its log."""
    return opened(flown.flight, plant.believed)
