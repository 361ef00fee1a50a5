"""An independent engine that flies the tilt-arm hexarotor with an effect that its controller does not know.

MuJoCo integrates hull, arms, servos and whatever was hung on them (`world`); this file closes the loop at 200 Hz and
records what a real vehicle would record. Nothing here comes from `plant`: the engine is there to judge it.

    flight, truth = fly("com_offset", 0.009, "train", seed=3)
    python -m benchmarks.hidden_effects.engine --effect com_offset --trajectory train -o X.mcap

Timing: at each tick t_k the autopilot reads the true state and issues a command stamped t_k, held until t_k+1. The
gyroscope is read at t_k, the accelerometer over the physics step that ends there. Noise is white, with the levels of
`data/multibody`: 3.4 mrad/s, 0.032 m/s^2; 0.3 mm, 0.5 mrad, 5 mm/s, 5 mrad/s.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.hidden_effects.airframe import ARMS, Airframe
from benchmarks.hidden_effects.autopilot import Autopilot
from benchmarks.hidden_effects.hidden import HIDDEN
from benchmarks.hidden_effects.recording import Tracks, to_flight, write_mcap
from benchmarks.hidden_effects.trajectories import TRAJECTORIES, Reference, reference
from benchmarks.hidden_effects.world import CONTROL_RATE, Engine, Hidden
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array, Flight

Size = float | Mapping[str, Any] | None
Compensate = Callable[[Array, Array], Array]
"""From the desired wrench (6,) and the state (13,: position, quaternion, velocity, rate) to the commanded wrench."""
Allocate = Callable[[Array], tuple[Array, Array]]
"""From the commanded wrench (6,) to tilts (6,) [rad] and rotor speeds (12,) [rad/s]."""

GYRO_NOISE, ACCELEROMETER_NOISE = 3.4e-3, 3.17e-2  # rad/s and m/s^2, per sample
POSITION_NOISE, ATTITUDE_NOISE, VELOCITY_NOISE, RATE_NOISE = 3e-4, 5e-4, 5e-3, 5e-3
BATTERY_EVERY = 20  # ticks
ALWAYS = {"servo_lag": Airframe.servo_tau + Airframe.servo_inner_tau, "arm_reaction": Airframe.arm_inertia[0]}
"""The arms keep their orientation in space while the hull turns under them: about 1 % of its inertia is not felt."""


@dataclass(frozen=True)
class Truth:
    """What was really there. `answers[i]` are the catalogue names that are right for effect i, best first.

    `always` are the effects that this vehicle has even when nothing is hidden, with their sizes: naming one of them
    is no false alarm.
    States at the control ticks, free of noise: `time` (N,), `position_E`, `velocity_E`, `omega_B`,
    `specific_force_B` (N, 3; at O unless the IMU was moved), `quat_EB` (N, 4), `tilt` (N, 6), `thrust` (N, 12).
    """

    effects: tuple[str, ...]
    parameters: dict[str, dict[str, Any]]
    answers: tuple[tuple[str, ...], ...]
    always: dict[str, float]
    trajectory: str
    seed: int
    time: Array
    position_E: Array
    quat_EB: Array
    velocity_E: Array
    omega_B: Array
    specific_force_B: Array
    tilt: Array
    thrust: Array

    def summary(self) -> dict[str, Any]:
        """The part that is worth a line of JSON."""
        return {k: getattr(self, k) for k in ("effects", "parameters", "answers", "always", "trajectory", "seed")}


def fly(
    effect: str | Sequence[str] = "none",
    size: Size | Sequence[Size] = None,
    trajectory: str = "train",
    seconds: float | None = None,
    seed: int = 0,
    integral: float = 0.3,
    compensate: Compensate | None = None,
    *,
    noise: float = 1.0,
    pair_split: float = 0.0,
    crisp: bool = False,
    log: Path | None = None,
    also: Sequence[Hidden] = (),
    allocate: Allocate | None = None,
) -> tuple[Flight, Truth]:
    """Fly `trajectory` with hidden `effect`(s); deterministic for equal arguments.

    `size`: None (each effect's default), a number in the effect's unit (the rest is drawn from `seed`), or a
    mapping of its parameters; one for all or a sequence with one per effect. `compensate` turns the desired
    wrench (6,) and the state (13,) into the commanded wrench at every tick. `noise` scales all sensor noise.
    `pair_split` d swings the shares of upper and lower rotors by up to +-d, in step on all arms and against
    each other on neighbours (0.37 and 0.23 Hz), without changing the wrench: that separates effects of single
    rotors from those of pairs. `crisp` gives the vehicle servos of 2.5 ms and nearly massless arms, so that
    without a hidden effect really nothing is missing. `log` is an MCAP file to write. `also` acts on the vehicle and
    is not in the truth: its surroundings. `allocate` takes the place of the autopilot's allocation.
    Raises UsageError for an unknown name or a flight that was lost.
    """
    # Long because a tick reads as one paragraph: what is seen, what is asked for, what is recorded.
    if trajectory not in TRAJECTORIES:
        raise UsageError(f"trajectory: got {trajectory!r}, available: {', '.join(TRAJECTORIES)}")
    chosen = choose(effect, size, seed)
    ref = reference(trajectory, seconds or TRAJECTORIES[trajectory][1], CONTROL_RATE, seed)
    engine = Engine((*chosen.values(), *also), crisp)
    pilot = Autopilot(integral, 1.0 / CONTROL_RATE)
    N = len(ref.time)
    desired, commanded, tilt, speed = (np.empty((N, k)) for k in (6, 6, 6, 12))
    state, imu, actual = np.empty((N, 13)), np.empty((N, 6)), np.empty((N, 18))
    volts = np.full(N, np.nan)
    engine.reset(ref.position_E[0], ref.velocity_E[0], ref.R_ED[0], ref.omega_D[0], np.zeros(ARMS))
    battery = next((e for e in chosen.values() if hasattr(e, "voltage")), None)
    R = np.empty(9)
    rows = list(
        zip(ref.position_E, ref.velocity_E, ref.acceleration_E, ref.R_ED, ref.omega_D, ref.omega_dot_D, strict=True)
    )
    swing = 0.5 * pair_split * np.sin(2 * np.pi * np.outer(ref.time, (0.37, 0.23)))
    split = swing[:, :1] + swing[:, 1:] * (-1.0) ** np.arange(ARMS) if pair_split else None
    for k in range(N):
        state[k, :3], state[k, 3:7] = engine.position_E, engine.quat_EB
        state[k, 7:10], state[k, 10:] = engine.velocity_E, engine.omega_B
        imu[k, :3] = engine.gyro if np.any(engine.airframe.imu_rotvec) else engine.omega_B
        imu[k, 3:] = engine.specific_force
        actual[k, :6], actual[k, 6:] = engine.tilt, engine.thrusts
        mujoco.mju_quat2Mat(R, state[k, 3:7])
        desired[k] = pilot.wrench(state[k, :3], R.reshape(3, 3), state[k, 7:10], state[k, 10:], rows[k])
        commanded[k] = desired[k] if compensate is None else compensate(desired[k].copy(), state[k].copy())
        if allocate is None:
            tilt[k], speed[k] = pilot.allocate(commanded[k], None if split is None else split[k])
        else:
            tilt[k], speed[k] = allocate(commanded[k].copy())
        engine.advance(tilt[k].copy(), speed[k].copy())
        if battery is not None:
            volts[k] = battery.voltage
        if k % CONTROL_RATE == 0 and not np.linalg.norm(state[k, :3] - ref.position_E[k]) < 3.0:  # nan too
            raise UsageError(f"{'+'.join(chosen)} at size {size}: the flight was lost after {ref.time[k]:.0f} s")
    truth = Truth(
        effects=tuple(chosen),
        parameters={name: asdict(e) for name, e in chosen.items()},  # type: ignore[call-overload]
        answers=tuple(e.answers for e in chosen.values()),
        always={} if crisp else dict(ALWAYS),
        trajectory=trajectory,
        seed=seed,
        time=ref.time,
        position_E=state[:, :3],
        quat_EB=state[:, 3:7],
        velocity_E=state[:, 7:10],
        omega_B=state[:, 10:],
        specific_force_B=imu[:, 3:],
        tilt=actual[:, :6],
        thrust=actual[:, 6:],
    )
    tracks = _measured(
        ref, state, imu, volts, seed, noise, desired=desired, commanded=commanded, tilt=tilt, speed=speed
    )
    if log is not None:
        write_mcap(tracks, log)
    name = f"{'+'.join(chosen) or 'none'}.{trajectory}.{seed}"
    return to_flight(tracks, name, (f"hidden-effects engine, trajectory {trajectory}, seed {seed}",)), truth


def choose(effect: str | Sequence[str], size: Size | Sequence[Size], seed: int) -> dict[str, Hidden]:
    """The effects named, at their sizes, free parameters drawn from `seed`."""
    names = [effect] if isinstance(effect, str) else list(effect)
    names = [n for n in names if n != "none"]
    sizes = list(size) if isinstance(size, Sequence) and not isinstance(size, str) else [size] * len(names)
    for name in names:
        if name not in HIDDEN:
            raise UsageError(f"effect: got {name!r}, available: none, {', '.join(sorted(HIDDEN))}")
    if len(sizes) != len(names):
        raise UsageError(f"size: got {len(sizes)} sizes for {len(names)} effects; give one, or one each")
    return {name: _one(name, s, seed) for name, s in zip(names, sizes, strict=True)}


def _one(name: str, size: Size, seed: int) -> Hidden:
    cls = HIDDEN[name]
    if isinstance(size, Mapping):
        return cls(**size)
    rng = np.random.default_rng([seed, 11, *name.encode()])
    return cls.draw(cls.size if size is None else float(size), rng)


def _measured(
    ref: Reference, state: Array, imu: Array, volts: Array, seed: int, noise: float, **issued: Array
) -> Tracks:
    """Stamp, thin and add sensor noise. The first tick has no IMU sample: nothing had moved yet."""
    rng = np.random.default_rng([seed, 23])
    ns = np.arange(len(ref.time), dtype=np.int64) * (1_000_000_000 // CONTROL_RATE)
    level = noise * np.repeat((GYRO_NOISE, ACCELEROMETER_NOISE), 3)
    pose = state[::2].copy()
    R_EB = Rotation.from_quat(pose[:, 3:7], scalar_first=True)
    pose[:, 7:10] = R_EB.apply(pose[:, 7:10], inverse=True)
    shake = Rotation.from_rotvec(noise * ATTITUDE_NOISE * rng.normal(size=(len(pose), 3)))
    pose[:, 3:7] = (R_EB * shake).as_quat(scalar_first=True, canonical=True)
    pose[:, :3] += noise * POSITION_NOISE * rng.normal(size=(len(pose), 3))
    pose[:, 7:10] += noise * VELOCITY_NOISE * rng.normal(size=(len(pose), 3))
    pose[:, 10:] += noise * RATE_NOISE * rng.normal(size=(len(pose), 3))
    R_ED = Rotation.from_matrix(ref.R_ED)
    quat_ED, velocity_D = R_ED.as_quat(scalar_first=True, canonical=True), R_ED.apply(ref.velocity_E, inverse=True)
    picked = np.flatnonzero(np.isfinite(volts))[::BATTERY_EVERY]
    return Tracks(
        command_ns=ns,
        **issued,
        imu_ns=ns[1:],
        imu=imu[1:] + level * rng.normal(size=(len(imu) - 1, 6)),
        odometry_ns=ns[::2],
        odometry=pose,
        reference=np.hstack((ref.position_E, quat_ED, velocity_D, ref.omega_D)),
        voltage_ns=ns[picked],
        voltage=volts[picked] + noise * 0.02 * rng.normal(size=len(picked)),
    )


def main(argv: Sequence[str] | None = None) -> None:
    """Fly and write a log; one line of JSON on standard output says what was hidden."""
    parser = argparse.ArgumentParser(description="Fly the independent engine with a hidden effect and write a log.")
    parser.add_argument("--effect", nargs="*", default=["none"], help=f"none, {', '.join(HIDDEN)}")
    parser.add_argument("--size", nargs="*", type=float, help="one per effect, in its unit; default: a middling size")
    parser.add_argument("--trajectory", default="train", choices=list(TRAJECTORIES))
    parser.add_argument("--seconds", type=float)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--integral", type=float, default=0.3)
    parser.add_argument("--noise", type=float, default=1.0)
    parser.add_argument("--pair-split", type=float, default=0.0)
    parser.add_argument("--crisp", action="store_true", help="servos of 2.5 ms and nearly massless arms")
    parser.add_argument("-o", "--output", type=Path, required=True, help="log to write (.mcap)")
    a = parser.parse_args(argv)
    options = {"noise": a.noise, "pair_split": a.pair_split, "crisp": a.crisp, "log": a.output}
    _, truth = fly(a.effect, a.size, a.trajectory, a.seconds, a.seed, a.integral, **options)
    sys.stdout.write(json.dumps({"log": str(a.output), **truth.summary()}) + "\n")


if __name__ == "__main__":
    main()
