"""RotorPy's multirotor with what a `Truth` adds to it: the glue between somebody else's dynamics and our effects.

RotorPy (Folk, Paulos and Kumar 2023; `rotorpy.vehicles.multirotor`) has the rigid body, its quaternion kinematics,
thrust and drag torque of the rotors, parasitic drag |v| D v, rotor drag and inflow -Omega diag(k_d, k_d, k_z) v,
translational lift, the integrator (SciPy) and the IMU's change of frames. Added here: what differs from rotor to
rotor, rotors that follow at once or with two time constants, a centre of mass beside O, forces of other things.

What had to be worked around (docs/decisions/0016-field-benchmark.md): more than four rotors (`_pack_state` has room for
four, the constructor inverts a square matrix), the IMU away from the centre of mass, the gyroscope of a turned IMU.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from rotorpy.sensors.imu import Imu
from rotorpy.vehicles.multirotor import Multirotor
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from benchmarks.field.flying import RATE
from benchmarks.field.truth import Truth, thrust_factor
from benchmarks.field.vehicles import GRAVITY
from benchmarks.hidden_effects.autopilot import cross
from wrenchgap.flight.flight import Array

State = dict[str, Array]
FOUR = 4
INTEGRATOR = {"method": "RK23", "first_step": 1.0 / RATE}
"""RotorPy hands this to SciPy. Without a first step, SciPy looks for one at every tick and takes a small one: slow."""


class Craft(Multirotor):  # type: ignore[misc]
    """RotorPy's vehicle as `truth` says it was built. RotorPy's state `x`, `v` are those of the centre of mass."""

    def __init__(self, truth: Truth) -> None:
        vehicle = truth.vehicle
        params = {**vehicle.params(), **truth.params}
        places = {name: place - truth.com_B for name, place in params["rotor_pos"].items()}
        first = dict(list(places.items())[:: len(places) // FOUR])
        directions = params["rotor_directions"]
        square = {"num_rotors": FOUR, "rotor_pos": first, "rotor_directions": directions[:: len(places) // FOUR]}
        super().__init__({**params, **square}, aero=True, integrator_kwargs=INTEGRATOR)
        self.num_rotors, self.rotor_pos, self.rotor_dir = len(places), places, directions
        self.extract_geometry()
        self.g = GRAVITY
        self.weight = np.array([0.0, 0.0, -self.mass * GRAVITY])
        self.truth, self.charge, self.time = truth, 1.0, 0.0
        self.gust_torque_B = np.zeros(3)
        self.held: tuple[tuple[Array, Array], ...] = ()  # force at O and torque in B, of what is attached
        self._place, self._R = np.zeros(3), np.eye(3)
        self._arms = self.rotor_geometry
        self._imu = Imu(
            R_BS=Rotation.from_rotvec(truth.imu_rotvec).as_matrix(), gravity_vector=np.array([0, 0, -GRAVITY])
        )

    def step(self, state: State, control: dict[str, Array], t_step: float) -> State:
        """RotorPy's step; with more rotors than its state has room for, its integrator on its equations."""
        speeds = np.clip(control["cmd_motor_speeds"], self.rotor_speed_min, self.rotor_speed_max)
        if not any(self.truth.tau):
            state = {**state, "rotor_speeds": speeds.copy()}
        if self.num_rotors == FOUR:
            out: State = super().step(state, {"cmd_motor_speeds": speeds}, t_step)
        else:
            solved = solve_ivp(lambda t, s: self._s_dot_fn(t, s, speeds), (0.0, t_step), _packed(state), **INTEGRATOR)
            out = Multirotor._unpack_state(solved.y[:, -1])
            out["q"] = out["q"] / np.linalg.norm(out["q"])
        self.time += t_step
        return out

    def _s_dot_fn(self, t: float, s: Array, cmd_rotor_speeds: Array) -> Array:
        """RotorPy's derivative; where the vehicle is, for `compute_body_wrench`, and rotors with two time constants."""
        self._R = matrix(s[6:10])
        self._place = s[0:3] - self._R @ self.truth.com_B
        out: Array = super()._s_dot_fn(t, s, cmd_rotor_speeds)
        out[16:] = speed_rate(self.truth.tau, cmd_rotor_speeds, s[16:])
        return out

    def compute_body_wrench(
        self, body_rates: Array, rotor_speeds: Array, body_airspeed_vector: Array
    ) -> tuple[Array, Array]:
        """RotorPy's wrench about the centre of mass, and what the truth adds."""
        force, torque = super().compute_body_wrench(body_rates, rotor_speeds, body_airspeed_vector)
        total, twist = force, torque + self.gust_torque_B
        if self.truth.changes_thrust:
            factor = thrust_factor(self.truth, rotor_speeds, float(self._place[2]), self.charge)
            more = self.k_eta * rotor_speeds**2 * (factor - 1.0)
            x, y, _ = self._arms.T
            total = total + np.array((0.0, 0.0, more.sum()))
            twist = twist + np.array((y @ more, -x @ more, self.k_m / self.k_eta * (self.rotor_dir @ more)))
        for push in (*(p(self.time, self._place, self._R) for p in self.truth.pushes), *self.held):
            total, twist = total + push[0], twist + push[1] - cross(self.truth.com_B, push[0])
        return total, twist

    def accelerations(self, state: State) -> tuple[Array, Array]:
        """Of the centre of mass in E (3,) [m/s^2], angular in B (3,) [rad/s^2], with the rotors as fast as they are."""
        out = self._s_dot_fn(0.0, _packed(state), state["rotor_speeds"])
        return out[3:6], out[10:13]

    def imu(self, state: State) -> Array:
        """Angular rate, specific force and angular acceleration (9,) at the IMU, in its axes, without noise.

        The accelerometer's frames are RotorPy's; the lever arm is put into the acceleration before, and the gyroscope
        is turned here, since RotorPy takes neither rightly.
        """
        v_dot, w_dot = self.accelerations(state)
        w, lever = state["w"], self.truth.imu_B - self.truth.com_B
        there = v_dot + self._R @ (cross(w_dot, lever) + cross(w, cross(w, lever)))
        reading = self._imu.measurement(state, {"vdot": there, "wdot": w_dot}, with_noise=False)
        turn = self._imu.R_BS.T
        return np.concatenate((turn @ reading["gyro"], reading["accel"], turn @ w_dot))

    def placed(self, state: State, position_E: Array, velocity_E: Array) -> None:
        """Put O at a position with a velocity (3,), both in E: RotorPy's `x` and `v` in `state`."""
        R = matrix(state["q"])
        state["x"] = position_E + R @ self.truth.com_B
        state["v"] = velocity_E + R @ cross(state["w"], self.truth.com_B)

    def of_origin(self, state: State) -> tuple[Array, Array]:
        """Position and velocity (3,) of O in E: what a marker on the frame shows."""
        R = matrix(state["q"])
        return state["x"] - R @ self.truth.com_B, state["v"] - R @ cross(state["w"], self.truth.com_B)


def matrix(quat_xyzw: Array) -> Array:
    """R_EB (3, 3) of RotorPy's quaternion, normalised; SciPy's Rotation takes longer than all the physics of a step."""
    x, y, z, w = quat_xyzw / np.sqrt(quat_xyzw @ quat_xyzw)
    return np.array(
        (
            (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
            (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
            (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
        )
    )


def speed_rate(tau: tuple[float, float], command: Array, speed: Array) -> Array:
    """RotorPy's first-order rotor, (R,) [rad/s^2], two time constants; 0 where they follow at once."""
    if not any(tau):
        return np.zeros_like(speed)
    return np.asarray((command - speed) / np.where(command > speed, *tau))


def start(truth: Truth, position_E: Array, yaw: float = 0.0) -> State:
    """RotorPy's state of a vehicle at rest with O at `position_E`, its rotors at hover speed."""
    turn = Rotation.from_euler("z", yaw)
    return {
        "x": position_E + turn.apply(truth.com_B),
        "v": np.zeros(3),
        "q": turn.as_quat(),
        "w": np.zeros(3),
        "wind": truth.wind_E.copy(),
        "rotor_speeds": np.full(truth.vehicle.rotors, truth.vehicle.hover_speed),
    }


def _packed(state: State) -> Array:
    """RotorPy's vector of a state, with as many rotors as there are."""
    return np.concatenate([state[k] for k in ("x", "v", "q", "w", "wind", "rotor_speeds")])


def as_params(truth: Truth) -> dict[str, Any]:
    """RotorPy's dictionary of the four-rotor vehicle that its controller wants to know: what is believed."""
    vehicle = truth.vehicle
    every = vehicle.rotors // FOUR
    params = vehicle.params()
    places = dict(list(params["rotor_pos"].items())[::every])
    return {**params, "num_rotors": FOUR, "rotor_pos": places, "rotor_directions": vehicle.directions[::every]}
