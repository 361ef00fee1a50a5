"""The vehicle in MuJoCo, stepped under held commands, and the base of what may be hidden in it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import ClassVar, Self

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.hidden_effects.airframe import ARMS, C_F, HOVER_SPEED, ROTORS, Airframe
from wrenchgap.flight.flight import Array

CONTROL_RATE = 200  # Hz
STEPS_PER_TICK = 4
CRISP = partial(Airframe, arm_inertia=(3.4e-5, 3.0e-5, 2.0e-5), servo_tau=2e-3, servo_inner_tau=5e-4, servo_rate=50.0)


class Hidden:
    """Base of every hidden effect: does nothing."""

    answers: ClassVar[tuple[str, ...]] = ()
    unit: ClassVar[str] = ""
    size: ClassVar[float] = 1.0
    shows_on: ClassVar[str] = "train"
    needs_split: ClassVar[bool] = False

    @classmethod
    def draw(cls, size: float, rng: np.random.Generator) -> Self:
        """The effect at `size`, its first parameter; whatever else is free is drawn from `rng`."""
        return cls(size)  # type: ignore[call-arg]

    def build(self, airframe: Airframe) -> None:
        """Change the airframe in place."""

    def start(self, world: Engine) -> None:
        """Prepare for one flight."""

    def command(self, world: Engine, tilt: Array, speed: Array) -> tuple[Array, Array]:
        """What the actuators receive."""
        return tilt, speed

    def thrust(self, world: Engine, thrust: Array) -> Array:
        """What the rotors really give."""
        return thrust

    def push(self, world: Engine) -> None:
        """Other forces."""


class Engine:
    """One vehicle in MuJoCo with its hidden effects; `step` advances it under held actuator commands."""

    def __init__(self, effects: Sequence[Hidden] = (), crisp: bool = False) -> None:
        self.airframe = CRISP() if crisp else Airframe()
        for effect in effects:
            effect.build(self.airframe)
        self.step = 1.0 / (CONTROL_RATE * STEPS_PER_TICK)
        self.model = self.airframe.compile(self.step)
        self.data = mujoco.MjData(self.model)
        self._hull = self.model.body("hull").id
        self._arm = [self.model.body(f"arm{a}").id for a in range(ARMS)]
        self._hubs = np.array([self.model.site(f"hub{r}").id for r in range(ROTORS)])
        joints = [self.model.joint(f"tilt{a}").id for a in range(ARMS)]
        driven = [self.model.joint(f"gear{a}").id for a in range(ARMS)] if self.airframe.play else joints
        self._tilt_q, self._tilt_v = self.model.jnt_qposadr[joints], self.model.jnt_dofadr[joints]
        self._servo_q = self.model.jnt_qposadr[driven]
        q, v = self.data.qpos, self.data.qvel  # views, as all of these: they follow what MuJoCo does
        self.position_E, self.quat_EB, self.velocity_E, self.omega_B = q[:3], q[3:7], v[:3], v[3:6]  # of O
        self.R_EB = self.data.xmat[self._hull].reshape(3, 3)
        self.specific_force = self.data.sensordata[:3]  # at the IMU, in its own axes, over the last physics step
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

    # What effects look at; poses are those of the last physics step.

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
    def gyro(self) -> Array:
        """(3,) in the IMU's own axes."""
        return np.asarray(Rotation.from_rotvec(-self.airframe.imu_rotvec).apply(self.omega_B))
