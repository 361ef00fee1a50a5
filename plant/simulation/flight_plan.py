"""Plans of simulated flights: the believed model, effects hidden from it, the trajectory."""

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Flight
from wrenchgap.flight.stamps import interpolated
from wrenchgap.plant.controller import pushes_along_z_only
from wrenchgap.plant.effect_values import with_hidden
from wrenchgap.plant.effects import require_force
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import content_hash, tool_version
from wrenchgap.plant.simulation.simulate import physics_rate, simulate
from wrenchgap.plant.trajectory import TRAJECTORIES, Trajectory, named
from wrenchgap.plant.trajectory.file import TrajectoryFile, load


@dataclass(frozen=True)
class Plan:
    """A flight to simulate."""

    believed: Model
    trajectory: str  # a name, or a file of `wrenchgap design`
    duration: float | None = None  # [s]; None: that of the trajectory
    excitation: float = 0.0  # in usual ones
    seed: int = 0
    integral: bool | None = None  # whether the controller has one; None: as in the model file
    hidden: tuple[str, ...] = ()  # effects of the truth that the controller does not know, e.g. `com_offset=x:0.004`


def prepare(
    plan: Plan, min_duration: float = 0.0, max_duration: float = 3600.0, max_excitation: float = 1000.0
) -> tuple[Model, Model, Trajectory]:
    """True and believed vehicle, and trajectory; raises UsageError, for other durations [s] too, or ModelError.

    The largest excitation is in usual ones: 100 m to and fro.
    """
    if not 0.0 <= plan.excitation <= max_excitation:
        raise UsageError(f"--excitation {plan.excitation:g}: expected 0 to {max_excitation:g}; 1 is usual")
    if plan.seed < 0:
        raise UsageError(f"--seed {plan.seed}: expected a whole number that is not negative")
    if plan.duration is not None and not min_duration <= plan.duration <= max_duration:
        raise UsageError(f"--duration {plan.duration:g}: expected {min_duration:g} to {max_duration:g} s")
    file = trajectory_file(plan)
    trajectory = named(plan.trajectory, plan.duration, plan.excitation, plan.seed) if file is None else file.trajectory
    if plan.duration is None and trajectory.duration > max_duration:
        raise UsageError(
            f"{plan.trajectory}: lasts {trajectory.duration:g} s; expected at most {max_duration:g} s, or a part of it "
            "by --duration"
        )
    believed = plan.believed
    if plan.integral is not None:
        size = (believed.controller.integral or 0.3) if plan.integral else 0.0
        believed = replace(believed, controller=replace(believed.controller, integral=size))
    truth = with_hidden(plan.believed, plan.hidden)
    require_force([e.name for e in truth.effects])
    physics_rate(believed)  # raises where the rates do not fit
    return truth, believed, trajectory


def trajectory_path(text: str) -> Path | None:
    """The file that a text names, None for the name of a trajectory."""
    return None if text in TRAJECTORIES or not (text.endswith(".toml") or os.sep in text) else Path(text)


def trajectory_file(plan: Plan) -> TrajectoryFile | None:
    """The file that the plan's trajectory names, None for a name; UsageError where it cannot be flown so."""
    text = plan.trajectory
    if (path := trajectory_path(text)) is None:
        return None
    file = load(path)
    if plan.duration is not None or plan.excitation:
        option = "--duration" if plan.duration is not None else "--excitation"
        raise UsageError(f"{option}: {Path(text).name} sets its own duration and excitation; leave {option} out")
    if pushes_along_z_only(plan.believed.vehicle) and not file.trajectory.follows_thrust:
        raise UsageError(
            f"{Path(text).name}: asks for an attitude of its own, but {plan.believed.vehicle.name} can only push along "
            "its z axis; design a flight for it with `wrenchgap design`"
        )
    return file


def designed_for(plan: Plan) -> str:
    """The vehicle for which a file of `design` was made; empty for the name of a trajectory."""
    file = trajectory_file(plan)
    return "" if file is None else file.vehicle


def fly(plan: Plan, *, name: str = "simulation", progress: Callable[[float], None] | None = None) -> Flight:
    """The flight of a plan; the same plan gives the same flight."""
    truth, believed, trajectory = prepare(plan)
    rng, rate = np.random.default_rng(plan.seed), physics_rate(believed)
    return simulate(truth, believed, trajectory, rng=rng, physics_rate=rate, progress=progress, name=name)


def provenance(plan: Plan) -> dict[str, str]:
    """The source of a log, without the hidden effects."""
    file = trajectory_file(plan)
    return {
        "made_by": f"wrenchgap {tool_version()} simulate",
        "model": plan.believed.name,
        "model_sha256": content_hash(plan.believed),
        "trajectory": plan.trajectory,
        **({} if file is None else {"trajectory_sha256": file.sha256}),
        "duration": "default" if plan.duration is None else f"{plan.duration:g}",
        "excitation": f"{plan.excitation:g}",
        "seed": str(plan.seed),
        "integral": "as in the model" if plan.integral is None else "on" if plan.integral else "off",
    }


@dataclass(frozen=True)
class Summary:
    """Duration and largest tilt of a flight, and its rms errors against the reference."""

    duration_s: float
    tilt_max_deg: float
    position_error_rms_m: float
    attitude_error_rms_deg: float


def summary(flown: Flight) -> Summary:
    """Summary of a flight by its odometry."""
    assert flown.odometry is not None
    assert flown.reference is not None
    odometry, reference = flown.odometry, flown.reference
    target = interpolated(odometry.time, reference.time, reference.position_E)
    quat_ED = so3.interpolate(odometry.time, reference.time, reference.quat_ED)
    error = so3.log(so3.multiply(so3.conjugate(quat_ED), odometry.quat_EB))
    return Summary(
        duration_s=float(odometry.time[-1]),
        tilt_max_deg=float(np.degrees(so3.tilt_angle(odometry.quat_EB).max())),
        position_error_rms_m=float(np.sqrt(np.mean(np.sum((odometry.position_E - target) ** 2, axis=1)))),
        attitude_error_rms_deg=float(np.degrees(np.sqrt(np.mean(np.sum(error**2, axis=1))))),
    )
