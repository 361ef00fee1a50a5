"""The controller: RotorPy's SE3 (Lee, Leok and McClamroch 2010) on the believed vehicle, with integrals where told."""

from __future__ import annotations

from typing import Any

import numpy as np
from rotorpy.controllers.quadrotor_control import SE3Control

from benchmarks.field.craft import as_params
from benchmarks.field.truth import Truth
from benchmarks.field.vehicles import GRAVITY
from wrenchgap.flight.flight import Array

POSITION_INTEGRAL, ATTITUDE_INTEGRAL = 1.2, 0.8
"""1/s^3 and 1/s."""
SOFTER = 0.7
"""Gains of the controller with integrals, over those of the other."""


class Pilot:
    """Thrust and torque (4,) [N, Nm] from RotorPy's state of O and flat outputs; holds the integrals."""

    def __init__(self, truth: Truth, dt: float, integral: bool) -> None:
        self._control = SE3Control(as_params(truth))
        self._control.g = GRAVITY
        self._inertia = np.array(truth.vehicle.inertia)
        self._dt, self._integral = dt, integral
        self._position_sum, self._attitude_sum = np.zeros(3), np.zeros(3)
        if integral:
            self._control.kp_att *= SOFTER
            self._control.kd_att *= SOFTER
            self._control.kp_pos = self._control.kp_pos * SOFTER

    def wrench(self, time: float, state: dict[str, Array], flat: dict[str, Any]) -> Array:
        """RotorPy's command; the position's integral enters as an acceleration, the attitude's as a torque."""
        if self._integral:
            self._position_sum += self._dt * (state["x"] - flat["x"])
            flat = {**flat, "x_ddot": flat["x_ddot"] - POSITION_INTEGRAL * self._position_sum}
        found = self._control.update(time, state, flat)
        torque = found["cmd_moment"]
        if self._integral:
            self._attitude_sum = np.clip(self._attitude_sum + self._dt * found["cmd_w"], -20.0, 20.0)
            torque = torque + self._inertia * ATTITUDE_INTEGRAL * self._attitude_sum
        return np.concatenate(((found["cmd_thrust"],), torque))
