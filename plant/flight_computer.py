"""The flight computer: control law, compensator and allocation of the vehicle that it believes to fly.

    W_des = law(state, reference) [+ e(t)]  ->  compensator  ->  W_cmd  ->  allocation [+ a(t)]  ->  u

e and a are what a recorded computer sent beyond law and allocation (`RecordedPilot`); none in a simulation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.controller import Controller, ControllerGains
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.trajectory import Reference
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import about_origin


class Correction(Protocol):
    """What a compensator's step returns; see `compensate.Result` for each."""

    @property
    def wrench_cmd(self) -> Array: ...  # noqa: D102
    @property
    def sigma(self) -> float: ...  # noqa: D102
    @property
    def beta(self) -> float: ...  # noqa: D102
    @property
    def cost(self) -> float: ...  # noqa: D102
    @property
    def iterations(self) -> int: ...  # noqa: D102


class Compensating(Protocol):
    """`compensate.Compensator`, or anything that steps like it: from the desired wrench to the one to command."""

    def step(self, wrench_des: Array, state: State, /) -> Correction:
        """From W_des (6,) to W_cmd (6,), both in B about the believed centre of mass, once per control period.

        `state` (N = 1) is what the controller knows.
        """
        ...


@dataclass(frozen=True)
class RecordedPilot:
    """How a recorded flight computer began, and what it sent beyond our law and allocation in K periods.

    offset              e (K, 6) desired wrench beyond the law, about the believed centre of mass
    correction          (K, 6) commanded minus desired wrench: what a compensator did when the log was made
    tilt, rotor_speed   a (K, A) [rad], (K, R) [rad/s] beyond the allocation; None without rotors
    integral            (3,) of the law at the first period [rad s]
    previous_tilt       (A,) allocated one period before the first, None at the start of a log
    along_z             whether the law is that of a vehicle that pushes along its z axis only
    """

    offset: Array
    correction: Array
    tilt: Array | None
    rotor_speed: Array | None
    integral: Array
    previous_tilt: Array | None
    along_z: bool


class FlightComputer:
    """Steps once per control period; keeps what it wanted (`desired`), and the compensator's `steps`.

    `limited` counts commands that ran into a limit of the actuators, by its name.
    """

    def __init__(
        self,
        gains: ControllerGains,
        believed: Vehicle,
        compensator: Compensating | None = None,
        *,
        integral: Array | None = None,
        recorded: RecordedPilot | None = None,
    ) -> None:
        """`integral` (3,) [rad s] is the law's at the start; that of `recorded` where it is given."""
        self.controller = Controller(gains, believed)
        if recorded is not None:
            self.controller.along_z = recorded.along_z
        self.controller.reset(integral if recorded is None else recorded.integral)
        self.believed, self.compensator, self.recorded = believed, compensator, recorded
        self.allocation = Allocation(believed) if believed.has_rotors else None
        self.tilt = None if recorded is None else recorded.previous_tilt
        self.desired: list[Array] = []
        self.steps: list[Correction] = []
        self.limited = {"rotor_speed": 0, "tilt_rate": 0, "tilt_range": 0}

    def step(self, k: int, state: State, reference: Reference, dt: float) -> Commands:
        """Commands to hold for `dt` [s], period `k`, from what is known of the state (N = 1)."""
        desired = self.controller.step(state, reference, dt)
        if self.recorded is not None:
            desired = desired + self.recorded.offset[k]
        self.desired.append(desired)
        if self.compensator is not None:
            self.steps.append(self.compensator.step(desired, state))
            commanded = self.steps[-1].wrench_cmd
        else:
            commanded = desired if self.recorded is None else desired + self.recorded.correction[k]
        if self.allocation is None:
            return Commands(commanded[None])
        about_O = about_origin(self.believed.body, commanded[None])
        allocated, saturation = self.allocation.allocate(about_O, previous_tilt=self.tilt, dt=dt)
        assert allocated.tilt is not None
        self.tilt = allocated.tilt[0]
        for name in self.limited:
            self.limited[name] += getattr(saturation, name)
        sent = Commands(commanded[None], allocated.tilt, allocated.rotor_speed)
        one, r = slice(k, k + 1), self.recorded
        if r is None or r.tilt is None or r.rotor_speed is None:
            return sent
        return beyond_allocation(self.believed, sent, r.tilt[one], r.rotor_speed[one])


def beyond_allocation(vehicle: Vehicle, allocated: Commands, tilt: Array, rotor_speed: Array) -> Commands:
    """Allocated commands (N) with tilts (N, A) [rad] and rotor speeds (N, R) [rad/s] added, within the limits."""
    assert allocated.tilt is not None
    assert allocated.rotor_speed is not None
    arms, rotors = vehicle.geometry()
    return Commands(
        allocated.wrench_B,
        np.clip(allocated.tilt + tilt, arms.tilt_min, arms.tilt_max),
        np.clip(allocated.rotor_speed + rotor_speed, rotors.speed_min, rotors.speed_max),
    )
