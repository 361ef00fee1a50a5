"""An independent engine that flies the tilt-arm hexarotor with an effect that its controller does not know.

MuJoCo integrates hull, arms, servos and whatever was hung on them; this file closes the loop at 200 Hz and records
what a real vehicle would record. Nothing here comes from `plant`: the engine is there to judge it.

    flight, truth = fly("com_offset", 0.009, "train", seed=3)
    python -m benchmarks.hidden_effects.engine --effect com_offset --trajectory train -o X.mcap

Timing: at each tick t_k the autopilot reads the true state and issues a command stamped t_k, held until t_k+1. The
gyroscope is read at t_k, the accelerometer over the physics step that ends there. Noise is white, with the levels of
`data/multibody`: 3.4 mrad/s, 0.032 m/s^2; 0.3 mm, 0.5 mrad, 5 mm/s, 5 mrad/s.
"""

# Long because the judge is read at once: the vehicle, the loop that flies it, and the sensors that record it.

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.hidden_effects.airframe import ARMS, C_F, HOVER_SPEED, ROTORS, Airframe
from benchmarks.hidden_effects.autopilot import Autopilot
from benchmarks.hidden_effects.hidden import HIDDEN, Hidden
from benchmarks.hidden_effects.recording import Tracks, to_flight, write_mcap
from benchmarks.hidden_effects.trajectories import TRAJECTORIES, Reference, reference
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Flight

Array = NDArray[np.float64]
Size = float | Mapping[str, Any] | None
Compensate = Callable[[Array, Array], Array]
"""From the desired wrench (6,) and the state (13,: position, quaternion, velocity, rate) to the commanded wrench."""

CONTROL_RATE = 200  # Hz
STEPS_PER_TICK = 4
GYRO_NOISE, ACCELEROMETER_NOISE = 3.4e-3, 3.17e-2  # rad/s and m/s^2, per sample
POSITION_NOISE, ATTITUDE_NOISE, VELOCITY_NOISE, RATE_NOISE = 3e-4, 5e-4, 5e-3, 5e-3
BATTERY_EVERY = 20  # ticks
CRISP = partial(Airframe, arm_inertia=(3.4e-5, 3.0e-5, 2.0e-5), servo_tau=2e-3, servo_inner_tau=5e-4, servo_rate=50.0)
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
        return {
            "effects": list(self.effects),
            "parameters": self.parameters,
            "answers": [list(a) for a in self.answers],
            "always": self.always,
            "trajectory": self.trajectory,
            "seed": self.seed,
        }


class Engine:
    """One vehicle in MuJoCo with its hidden effects; `step` advances it under held actuator commands."""

    def __init__(self, effects: Sequence[Hidden] = (), crisp: bool = False) -> None:
        self.airframe = CRISP() if crisp else Airframe()
        for effect in effects:
            effect.build(self.airframe)
        self.step = 1.0 / (CONTROL_RATE * STEPS_PER_TICK)
        self.model = self.airframe.compile(self.step)
        self.data = mujoco.MjData(self.model)
        self._hull = self._body("hull")
        self._arm = [self._body(f"arm{a}") for a in range(ARMS)]
        self._hubs = np.array([self._id(mujoco.mjtObj.mjOBJ_SITE, f"hub{r}") for r in range(ROTORS)])
        joints = [self._id(mujoco.mjtObj.mjOBJ_JOINT, f"tilt{a}") for a in range(ARMS)]
        driven = (
            [self._id(mujoco.mjtObj.mjOBJ_JOINT, f"gear{a}") for a in range(ARMS)] if self.airframe.play else joints
        )
        self._tilt_q, self._tilt_v = self.model.jnt_qposadr[joints], self.model.jnt_dofadr[joints]
        self._servo_q = self.model.jnt_qposadr[driven]
        self.speed = np.full(ROTORS, HOVER_SPEED)
        self.thrusts = C_F * self.speed**2
        self._effects = tuple(effects)
        self._command = [e for e in effects if type(e).command is not Hidden.command]
        self._thrust = [e for e in effects if type(e).thrust is not Hidden.thrust]
        self._push = [e for e in effects if type(e).push is not Hidden.push]

    def reset(self, position_E: Array, velocity_E: Array, R_EB: Array, omega_B: Array, tilt: Array) -> None:
        """Put the vehicle somewhere, arms at `tilt`, and start the effects."""
        mujoco.mj_resetData(self.model, self.data)
        q, v = self.data.qpos, self.data.qvel
        q[:3], v[:3], v[3:6] = position_E, velocity_E, omega_B
        q[3:7] = Rotation.from_matrix(R_EB).as_quat(scalar_first=True)
        q[self._tilt_q] = tilt
        q[self._servo_q] = tilt
        self.speed[:] = HOVER_SPEED
        mujoco.mj_forward(self.model, self.data)
        for effect in self._effects:
            effect.start(self)

    def advance(self, tilt_command: Array, speed_command: Array, steps: int = STEPS_PER_TICK) -> None:
        """Integrate `steps` physics steps under held commands."""
        data, frame = self.data, self.airframe
        for _ in range(steps):
            tilt, speed = tilt_command, speed_command
            for effect in self._command:
                tilt, speed = effect.command(self, tilt, speed)
            if frame.motor_tau:
                lag = 2 * HOVER_SPEED * frame.motor_tau
                self.speed = np.maximum(self.speed + self.step * (speed - self.speed) * (speed + self.speed) / lag, 0.0)
            else:
                self.speed = speed
            thrust = C_F * self.speed**2
            for effect in self._thrust:
                thrust = effect.thrust(self, thrust)
            self.thrusts = thrust
            data.ctrl[:ROTORS] = thrust
            rate = (tilt - data.qpos[self._servo_q]) / frame.servo_tau
            data.ctrl[ROTORS:] = np.minimum(np.maximum(rate, -frame.servo_rate), frame.servo_rate)
            if self._push:
                data.xfrc_applied[:] = 0.0
                for effect in self._push:
                    effect.push(self)
            mujoco.mj_step(self.model, data)

    # What effects look at (see `hidden.World`); poses are those of the last physics step.

    @property
    def time(self) -> float:
        """Seconds since reset."""
        return float(self.data.time)

    @property
    def tilt(self) -> Array:
        """(6,) true tilt."""
        return np.asarray(self.data.qpos[self._tilt_q])

    @property
    def tilt_rate(self) -> Array:
        """(6,) true tilt rate."""
        return np.asarray(self.data.qvel[self._tilt_v])

    @property
    def R_EB(self) -> Array:
        """(3, 3) attitude."""
        return np.asarray(self.data.xmat[self._hull].reshape(3, 3))

    @property
    def position_E(self) -> Array:
        """(3,) of O."""
        return np.asarray(self.data.qpos[:3])

    @property
    def quat_EB(self) -> Array:
        """(4,) scalar first, unit."""
        return np.asarray(self.data.qpos[3:7])

    @property
    def velocity_E(self) -> Array:
        """(3,) of O."""
        return np.asarray(self.data.qvel[:3])

    @property
    def omega_B(self) -> Array:
        """(3,)."""
        return np.asarray(self.data.qvel[3:6])

    @property
    def hubs_E(self) -> Array:
        """(12, 3) rotor hubs."""
        return np.asarray(self.data.site_xpos[self._hubs])

    @property
    def normals_E(self) -> Array:
        """(12, 3) thrust directions."""
        return np.asarray(self.data.site_xmat[self._hubs][:, 2::3])

    @property
    def hub_velocity_E(self) -> Array:
        """(12, 3) with the hull's motion (the arms' own turning moves the hubs by less than 0.3 m/s)."""
        x, y, z = self.R_EB @ self.omega_B
        turning = np.array(((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)))  # r @ turning = omega x r
        return np.asarray(self.velocity_E + (self.hubs_E - self.position_E) @ turning)

    def push(self, force_E: Array, at_E: Array) -> None:
        """Push the hull with forces (3,) or (n, 3), at points of the same shape."""
        force, lever = np.atleast_2d(force_E), np.atleast_2d(at_E) - self.data.xipos[self._hull]
        moment = lever.T @ force
        self.data.xfrc_applied[self._hull, :3] += force.sum(0)
        self.twist(np.array((moment[1, 2] - moment[2, 1], moment[2, 0] - moment[0, 2], moment[0, 1] - moment[1, 0])))

    def twist(self, torque_E: Array) -> None:
        """Twist the hull."""
        self.data.xfrc_applied[self._hull, 3:] += torque_E

    def twist_arms(self, torques_E: Array) -> None:
        """Twist the six arms, (6, 3)."""
        self.data.xfrc_applied[self._arm, 3:] += torques_E

    @property
    def specific_force(self) -> Array:
        """(3,) at the IMU, in its own axes, over the last physics step."""
        return np.asarray(self.data.sensordata[:3])

    @property
    def gyro(self) -> Array:
        """(3,) in the IMU's own axes."""
        return np.asarray(Rotation.from_rotvec(-self.airframe.imu_rotvec).apply(self.omega_B))

    def _body(self, name: str) -> int:
        return self._id(mujoco.mjtObj.mjOBJ_BODY, name)

    def _id(self, kind: Any, name: str) -> int:
        return int(mujoco.mj_name2id(self.model, kind, name))


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
) -> tuple[Flight, Truth]:
    """Fly `trajectory` with hidden `effect`(s); deterministic for equal arguments.

    `size`: None (each effect's default), a number in the effect's unit (the rest is drawn from `seed`), or a
    mapping of its parameters; one for all or a sequence with one per effect. `compensate` turns the desired
    wrench (6,) and the state (13,) into the commanded wrench at every tick. `noise` scales all sensor noise.
    `pair_split` d swings the shares of upper and lower rotors by up to +-d, in step on all arms and against
    each other on neighbours (0.37 and 0.23 Hz), without changing the wrench: that separates effects of single
    rotors from those of pairs. `crisp` gives the vehicle servos of 2.5 ms and nearly massless arms, so that
    without a hidden effect really nothing is missing.
    Raises UsageError for an unknown name or a flight that was lost.
    """
    tracks, truth = _fly(effect, size, trajectory, seconds, seed, integral, compensate, noise, pair_split, crisp)
    return to_flight(tracks, _name(truth), (f"hidden-effects engine, trajectory {trajectory}, seed {seed}",)), truth


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


def _name(truth: Truth) -> str:
    return f"{'+'.join(truth.effects) or 'none'}.{truth.trajectory}.{truth.seed}"


def _fly(
    effect: str | Sequence[str],
    size: Size | Sequence[Size],
    trajectory: str,
    seconds: float | None,
    seed: int,
    integral: float,
    compensate: Compensate | None,
    noise: float,
    pair_split: float,
    crisp: bool,
) -> tuple[Tracks, Truth]:
    """The loop of `fly`; the numbers are still as the log holds them."""
    # Long because a tick reads as one paragraph: what is seen, what is asked for, what is recorded.
    if trajectory not in TRAJECTORIES:
        raise UsageError(f"trajectory: got {trajectory!r}, available: {', '.join(TRAJECTORIES)}")
    chosen = choose(effect, size, seed)
    ref = reference(trajectory, seconds or TRAJECTORIES[trajectory][1], CONTROL_RATE, seed)
    engine = Engine(tuple(chosen.values()), crisp)
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
        imu[k, :3], imu[k, 3:] = (
            engine.gyro if np.any(engine.airframe.imu_rotvec) else engine.omega_B,
            engine.specific_force,
        )
        actual[k, :6], actual[k, 6:] = engine.tilt, engine.thrusts
        mujoco.mju_quat2Mat(R, state[k, 3:7])
        desired[k] = pilot.wrench(state[k, :3], R.reshape(3, 3), state[k, 7:10], state[k, 10:], rows[k])
        commanded[k] = desired[k] if compensate is None else compensate(desired[k].copy(), state[k].copy())
        tilt[k], speed[k] = pilot.allocate(commanded[k], None if split is None else split[k])
        engine.advance(tilt[k].copy(), speed[k].copy())
        if battery is not None:
            volts[k] = battery.voltage
        if k % CONTROL_RATE == 0 and not _controlled(state[k], ref, k):
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
    return _measured(ref, desired, commanded, tilt, speed, state, imu, volts, seed, noise), truth


def _controlled(state: Array, ref: Reference, k: int) -> bool:
    """Within 3 m of the reference, and finite."""
    return bool(np.linalg.norm(state[:3] - ref.position_E[k]) < 3.0)


def _measured(
    ref: Reference,
    desired: Array,
    commanded: Array,
    tilt: Array,
    speed: Array,
    state: Array,
    imu: Array,
    volts: Array,
    seed: int,
    noise: float,
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
    reference_rows = np.hstack(
        (
            ref.position_E,
            R_ED.as_quat(scalar_first=True, canonical=True),
            R_ED.apply(ref.velocity_E, inverse=True),
            ref.omega_D,
        )
    )
    known = np.isfinite(volts)
    picked = np.flatnonzero(known)[::BATTERY_EVERY]
    return Tracks(
        command_ns=ns,
        desired=desired,
        commanded=commanded,
        tilt=tilt,
        speed=speed,
        imu_ns=ns[1:],
        imu=imu[1:] + level * rng.normal(size=(len(imu) - 1, 6)),
        odometry_ns=ns[::2],
        odometry=pose,
        reference=reference_rows,
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
    tracks, truth = _fly(
        a.effect, a.size, a.trajectory, a.seconds, a.seed, a.integral, None, a.noise, a.pair_split, a.crisp
    )
    write_mcap(tracks, a.output)
    sys.stdout.write(json.dumps({"log": str(a.output), **truth.summary()}) + "\n")


if __name__ == "__main__":
    main()
