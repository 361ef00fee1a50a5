"""The flight computer: control law, compensator and allocation for the vehicle that it assumes.

    W_des = law(state, reference) [+ e(t)]  ->  compensator  ->  W_cmd  ->  allocation [+ a(t)]  ->  u

The allocation is the nominal one, or another (`Allocating`), such as the corrected one of `compensate.allocator`.

e and a are what a recorded flight computer sent beyond law and allocation (`RecordedPilot`); zero in a simulation.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.plant.allocation import LIMITS, Allocation
from wrenchgap.plant.controller import ControllerGains, control_law, next_integral, pushes_along_z_only
from wrenchgap.plant.rigid_body import NUMBERS, unpack
from wrenchgap.plant.simulation.closed_loop import Clock
from wrenchgap.plant.simulation.loop import ALWAYS, Loop, Signals, Stage
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.trajectory import Reference
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import about_origin


class Correction(Protocol):
    """The result of a step of a compensator; see `compensate.Result`."""

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


class Allocated(Protocol):
    """Thrusts (R,) [N] of the nominal rotors, and tilts (A,) [rad]."""

    @property
    def thrust(self) -> Array: ...  # noqa: D102
    @property
    def tilt(self) -> Array: ...  # noqa: D102


class Allocating(Protocol):
    """`compensate.allocator.Allocator`, or anything that steps like it."""

    def reset(self, tilt: Array, /) -> None:
        """Forget the past but for the tilts (A,) [rad] of before."""
        ...

    def step(self, wrench_B: Array, /) -> Allocated:
        """From W_cmd (6,) about the centre of mass to thrusts and tilts, once per control period."""
        ...


@dataclass(frozen=True)
class RecordedPilot:
    """Initial state of a recorded flight computer, and its commands beyond law and allocation in K periods.

    offset              e (K, 6) desired wrench beyond the law, about the believed centre of mass
    correction          (K, 6) commanded minus desired wrench: what a compensator did when the log was recorded
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
    """Law, compensator and allocation as stages of a loop, due once per control period; `steps` are the compensator's.

    Its state is the pose reading "pose" (13,) and the gyroscope "gyro" (3,), or, if not `measured`, the true state. A
    compensator is also given the reading "accelerometer" (3,), nan where no stage reads one.
    """

    def __init__(
        self,
        gains: ControllerGains,
        believed: Vehicle,
        reference: Reference,
        clock: Clock,
        *,
        compensator: Compensating | None = None,
        allocating: Allocating | None = None,
        integral: Array | None = None,
        recorded: RecordedPilot | None = None,
        measured: bool = False,
    ) -> None:
        """`reference` (K) has a sample for each period; `integral` (3,) [rad s] gives way to `recorded`'s."""
        self.gains, self.believed, self.compensator, self.measured = gains, believed, compensator, measured
        self.clock, self.steps, self.allocating = clock, list[Correction](), allocating
        self.allocation = Allocation(believed) if believed.has_rotors else None
        self.along_z = pushes_along_z_only(believed) if recorded is None else recorded.along_z
        self.signals = self._start(integral if recorded is None else recorded.integral, recorded)
        self.stages = self._stages(reference, recorded)

    def limited(self, loop: Loop) -> dict[str, int]:
        """Number of commands that met each limit of the actuators, by its name, in a loop that has run."""
        counts = loop.now("limited").astype(int).tolist()
        return {name: count for name, count in zip(LIMITS, counts, strict=True) if name != "held"}

    def _start(self, integral: Array | None, recorded: RecordedPilot | None) -> dict[str, Array]:
        signals = {"estimate": np.zeros(NUMBERS), "desired": np.zeros(6), "commanded": np.zeros(6)}
        signals |= {"integral": np.zeros(3) if integral is None else integral, "limited": np.zeros(len(LIMITS))}
        signals |= {"accelerometer": np.full(3, np.nan)} if self.compensator is not None else {}
        if self.allocation is None:
            return signals
        arms, rotors = self.believed.geometry()
        before = None if recorded is None else recorded.previous_tilt
        signals |= {"tilt": np.zeros(len(arms)), "speed": np.zeros(len(rotors))}
        signals["allocated"] = np.zeros(len(arms)) if before is None else before
        if self.allocating is not None:
            self.allocating.reset(signals["allocated"])
        return signals | {"fresh": np.array([float(before is None)])}

    def _stages(self, reference: Reference, recorded: RecordedPilot | None) -> list[Stage]:
        r, c, count = reference, self.clock, len(reference.time)
        none = np.zeros((count, 6))
        beyond = (none, none) if recorded is None else (recorded.offset, recorded.correction)
        columns = (r.position_E, r.quat_ED, r.velocity_E, r.omega_D, r.acceleration_E, r.omega_dot_D, *beyond)
        stages = [Stage("law", self._law, np.hstack(columns), c.per_command, ("desired",))]
        if self.compensator is not None:
            time = c.time[:: c.per_command]
            volts = np.full(count, np.nan) if c.voltage is None else c.voltage[:: c.per_command]
            rows = np.column_stack((time, volts))
            stages.append(Stage("compensator", self._compensate, rows, c.per_command, numpy_steps=ALWAYS))
        if self.allocation is None:
            return [*stages, Stage("command", lambda now, row: {}, np.zeros((count, 0)), c.per_command, ("commanded",))]
        more = np.zeros((count, len(self.signals["tilt"]) + len(self.signals["speed"])))
        if recorded is not None and recorded.tilt is not None and recorded.rotor_speed is not None:
            more = np.hstack((recorded.tilt, recorded.rotor_speed))
        logged, never = ("commanded", "tilt", "speed"), 0 if self.allocating is None else ALWAYS
        return [*stages, Stage("command", self._allocate, more, c.per_command, logged, numpy_steps=never)]

    def _law(self, now: Signals, row: Array) -> Signals:
        estimate = np.concatenate((now["pose"][:10], now["gyro"])) if self.measured else now["state"]
        p, q, v, w, a, dw, offset, correction = (part[None] for part in np.split(row, np.cumsum([3, 4, 3, 3, 3, 3, 6])))
        target = Reference(np.zeros(1), p, v, a, q, w, dw)
        state, integral = unpack(np.zeros(1), estimate[None]), now["integral"]
        wrench, error = control_law(self.gains, self.believed.body, state, target, integral[None], along_z=self.along_z)
        desired = (wrench + offset)[0]
        return {
            "estimate": estimate,
            "desired": desired,
            "commanded": desired + correction[0],
            "integral": next_integral(self.gains, integral, error[0], self.clock.period),
        }

    def _compensate(self, now: Signals, row: Array) -> Signals:
        assert self.compensator is not None
        state = unpack(row[:1], now["estimate"][None], None if self.clock.voltage is None else row[1:])
        state = replace(state, specific_force_B=now["accelerometer"][None])
        self.steps.append(self.compensator.step(now["desired"], state))
        return {"commanded": self.steps[-1].wrench_cmd}

    def _allocate(self, now: Signals, row: Array) -> Signals:
        assert self.allocation is not None
        tilt, speed, limited = self._allocated(now)
        sent = Commands(now["commanded"][None], tilt[None], speed[None])
        sent = beyond_allocation(self.believed, sent, row[None, : len(tilt)], row[None, len(tilt) :])
        assert sent.tilt is not None
        assert sent.rotor_speed is not None
        now = {"tilt": sent.tilt[0], "speed": sent.rotor_speed[0], "limited": now["limited"] + limited}
        return {"allocated": tilt, "fresh": np.zeros(1), **now}

    def _allocated(self, now: Signals) -> tuple[Array, Array, Array]:
        """Tilts, rotor speeds, and which limits were met, of the nominal allocation or another."""
        assert self.allocation is not None
        fresh, period, limited = now["fresh"] > 0.0, self.clock.period, np.zeros(len(LIMITS))
        if self.allocating is None:
            about_O = about_origin(self.believed.body, now["commanded"][None])[0]
            return self.allocation.step(about_O, now["allocated"], fresh, period)
        arms, rotors = self.believed.geometry()
        made = self.allocating.step(now["commanded"])
        turned, slow = self.allocation.rate_limited(made.tilt[arms.tilts], now["allocated"][arms.tilts], fresh, period)
        tilt = np.array(now["allocated"])
        tilt[arms.tilts] = np.clip(turned, arms.tilt_min[arms.tilts], arms.tilt_max[arms.tilts])
        limited[LIMITS.index("tilt_rate")] = float(slow.any())
        return tilt, np.sqrt(np.maximum(made.thrust, 0.0) / rotors.c_f), limited


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
