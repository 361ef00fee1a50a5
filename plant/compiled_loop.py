"""The closed loop of a simulation in compiled code (`plant.loop_kernels`): what `plant.simulate` flies by default.

The specification is `plant.closed_loop.fly` with `plant.simulate`'s own sensors and `plant.flight_computer`, in plain
numpy; a test compares whole flights. Where an effect cannot be compiled, that is what flies. The first two steps are
always plain: effects then remember all that they ever will.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.plant import loop_kernels as kernels
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.closed_loop import LOST_ATTITUDE, LOST_POSITION, Flown, Lost
from wrenchgap.plant.flight_computer import Correction
from wrenchgap.plant.loop import Loop, Result
from wrenchgap.plant.loop_kernels import Allocator, Body, Flight, Given, Law, Lines, Memory, Timing
from wrenchgap.plant.loop_program import PlantPrograms, numbers_of, traced
from wrenchgap.plant.rigid_body import pack, unpack
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.tape import Program
from wrenchgap.plant.trajectory import Reference
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.plant.wrench_model import WrenchModel

PLAIN = 2
"""Steps after which effects remember all that they ever will."""
STRETCH = 200
"""Steps between two reports of progress."""
WHAT = {kernels.LOST_STATE: "state", kernels.LOST_PLACE: "position", kernels.LOST_TURN: "attitude"}


def fly(
    plant: WrenchModel,
    start: State,
    loop: Loop,
    rng: np.random.Generator | None,
    progress: Callable[[float], None] | None = None,
) -> Result:
    """Fly from `start` (N = 1); `rng` draws the pose sensor's noise, where there is any.

    Raises Untraceable, before anything is drawn, for a plant that cannot be compiled.
    """
    flight = _Flight(plant, start, loop)
    if rng is not None:
        flight.draw(rng)
    said, count = flight.run(progress)
    if count == 0:
        raise UsageError(f"{flight.lost(said, 0)}: the flight cannot begin there; start nearer to the reference")
    if said != kernels.GOING and rng is not None:
        flight.draw_again(rng, -(-(count + 1) // loop.per_pose))
    if progress is not None:
        progress(1.0)
    return flight.result(said, count)


class _Flight:
    """The arrays of one flight, as the kernels take them."""

    def __init__(self, plant: WrenchModel, start: State, loop: Loop) -> None:
        self.plant, self.loop = plant, loop
        c = loop.clock
        steps, periods = len(c.time), -(-len(c.time) // c.per_command)
        self.allocator, shapes = _allocator(loop.believed)
        programs, remembered = _programs(plant, start, loop, shapes)
        self.step, self.gyro = _lines(programs.step), _lines(programs.gyro)
        b = plant.body
        self.body = Body(
            b.mass,
            np.array(b.com_B),
            np.array(b.inertia),
            np.array(np.linalg.inv(b.inertia), dtype=float),
            loop.gravity,
        )
        self.law, self.timing = _law(loop), _timing(loop)
        volts = np.full(steps, np.nan) if c.voltage is None else np.array(c.voltage, dtype=float)
        noise = np.zeros((-(-steps // loop.per_pose), 12))
        disturbed = np.zeros((steps, 6)) if loop.disturbance is None else np.array(loop.disturbance, order="C")
        imu = np.array(loop.errors, order="C")
        series = (np.array(c.time), volts, disturbed, imu, noise, _rows(loop.reference))
        self.given = Given(*series, *_recorded(loop, periods, shapes))
        self.memory = _memory(start, loop, shapes[0], remembered)
        poses = np.zeros((len(noise), 13))
        sent = (np.zeros((periods, 6)), np.zeros((periods, 6)), *(np.zeros((periods, n)) for n in shapes))
        self.flight = Flight(np.zeros((steps, 13)), np.zeros((steps, 6)), poses, *sent)
        self.room, self.steps = np.zeros((5, 13)), list[Correction]()

    def draw(self, rng: np.random.Generator) -> None:
        """White noise of all pose readings, in the order in which `plant.sensors.read_pose` draws it."""
        self._before = rng.bit_generator.state
        self.given.noise[:] = rng.standard_normal(self.given.noise.shape)

    def draw_again(self, rng: np.random.Generator, readings: int) -> None:
        """Leave the generator as after so many readings: the flight ended early."""
        rng.bit_generator.state = self._before
        rng.standard_normal((readings, 12))

    def run(self, progress: Callable[[float], None] | None) -> tuple[int, int]:
        """How the flight ended, and after how many steps."""
        count, n = len(self.given.time), 0
        memory = self.loop.memory
        while n < min(PLAIN, count):
            said = kernels.begin(self.timing, self.gyro, self.law, self.given, self.memory, self.flight, n, self.room)
            if said != kernels.GOING:
                return said, n
            self._compensate(n)
            kernels.send(self.timing, self.law, self.allocator, self.given, self.memory, self.flight, n)
            memory = self._plainly(n, memory)
            n += 1
        self.memory.effects[:] = numbers_of(memory)
        decided, said = False, kernels.GOING
        while n < count:
            if progress is not None:
                progress(n / count)
            last = min(n + STRETCH, count)
            said, n = kernels.stretch(
                self.timing, self.step, self.gyro, self.body, self.law, self.allocator, self.given, self.memory,
                self.flight, self.room, n, last, decided,
            )  # fmt: skip
            decided = said == kernels.WAITING
            if decided:
                self._compensate(n)
            elif said != kernels.GOING:
                return said, n
        return kernels.GOING, count

    def lost(self, said: int, n: int) -> Lost | None:
        """Why control was lost at step n."""
        if said == kernels.GOING:
            return None
        what: Any = WHAT[said]
        return Lost(float(self.given.time[n]), what, float(self.memory.lost[0]))

    def result(self, said: int, count: int) -> Result:
        """What was flown in the first `count` steps."""
        f, c = self.flight, self.loop.clock
        periods = -(-count // c.per_command)
        rotors = (f.tilt[:periods], f.speed[:periods]) if self.allocator.there else (None, None)
        disturbed = self.given.disturbance[:count]
        known = None if c.voltage is None else c.voltage[:count]
        flown = Flown(
            c, _states(c.time[:count], f.rows[:count], known), Commands(f.commanded[:periods], *rotors),
            f.wrench[:count], disturbed, self.lost(said, count),
        )  # fmt: skip
        # Where control was lost, the sensors were read once more.
        read = slice(0, count if said == kernels.GOING else count + 1, self.loop.per_pose)
        time, volts = c.time[read], None if c.voltage is None else c.voltage[read]
        limited = dict(zip(("rotor_speed", "tilt_rate", "tilt_range"), self.memory.counts[1:].tolist(), strict=True))
        return Result(
            flown, _states(time, f.poses[: len(time)], volts), f.desired[:periods], limited, tuple(self.steps)
        )

    def _compensate(self, n: int) -> None:
        """Turn the desired wrench of the period that begins at step n into a command."""
        loop, (k, inside) = self.loop, divmod(n, self.loop.clock.per_command)
        if loop.compensator is not None and not inside:
            known = unpack(float(self.given.time[n]), tuple(self.memory.known), self._voltage(n))
            self.steps.append(loop.compensator.step(self.flight.desired[k].copy(), known))
            self.flight.commanded[k] = self.steps[-1].wrench_cmd

    def _voltage(self, n: int) -> Array | None:
        return None if self.loop.clock.voltage is None else self.given.voltage[n : n + 1]

    def _plainly(self, n: int, memory: dict[str, Any] | None) -> dict[str, Any]:
        """Step n with the plant in plain numpy."""
        f, k = self.flight, n // self.loop.clock.per_command
        rotors = (f.tilt[k : k + 1].copy(), f.speed[k : k + 1].copy()) if self.allocator.there else (None, None)
        now = unpack(float(self.given.time[n]), tuple(self.memory.y), self._voltage(n))
        sent = Commands(f.commanded[k : k + 1].copy(), *rotors)
        made, memory = self.plant.actuate(sent, now, self.loop.clock.dt, memory)
        f.wrench[n] = made[0] + self.given.disturbance[n]
        kernels.move(self.body, f.wrench[n], self.memory.y, self.timing.dt, self.room)
        return memory


def _programs(plant: WrenchModel, start: State, loop: Loop, shapes: tuple[int, int]) -> tuple[PlantPrograms, int]:
    """The plant's programs, and how many numbers its effects remember."""
    there = loop.believed.has_rotors
    wrench = np.array([[0.0, 0.0, plant.body.mass * GRAVITY, 0.0, 0.0, 0.0]])
    rotors = tuple(np.zeros((1, n)) for n in shapes) if there else (None, None)
    some = Commands(wrench, *rotors)
    volts = loop.clock.voltage
    state = replace(start, voltage=None if volts is None else volts[:1])
    memory: dict[str, Any] = dict(loop.memory or {})
    with np.errstate(all="ignore"):  # rotors at rest: only the form of what is remembered counts
        for _ in range(PLAIN):
            _, memory = plant.actuate(some, state, loop.clock.dt, memory)
        programs = traced(plant, some, memory, loop.clock.dt, volts is not None)
    return programs, len(numbers_of(memory))


def _lines(program: Program) -> Lines:
    return Lines(np.array(program.code), np.array(program.inputs), np.array(program.results), program.start.copy())


def _law(loop: Loop) -> Law:
    g, body = loop.gains, loop.believed.body
    return Law(
        float(g.zeta_position), float(g.omega_position), np.array(g.zeta_attitude, dtype=float),
        np.array(g.omega_attitude, dtype=float), float(g.integral), float(g.integral_limit), float(g.transport),
        float(body.mass), np.array(body.com_B, dtype=float), np.array(body.inertia, dtype=float),
        loop.along_z, GRAVITY,
    )  # fmt: skip


def _recorded(
    loop: Loop, periods: int, shapes: tuple[int, int]
) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
    """What goes beyond law, compensator and allocation in each period, and where loss of control is forgiven."""
    r, none = loop.recorded, np.zeros((periods, 6))
    forgiven = np.zeros(periods, dtype=bool) if loop.forgiven is None else np.array(loop.forgiven)
    tilt, speed = (np.zeros((periods, n)) for n in shapes)
    if r is None:
        return none, none.copy(), tilt, speed, forgiven
    if r.tilt is not None and r.rotor_speed is not None:
        tilt, speed = np.array(r.tilt, order="C"), np.array(r.rotor_speed, order="C")
    return np.array(r.offset, order="C"), np.array(r.correction, order="C"), tilt, speed, forgiven


def _memory(start: State, loop: Loop, arms: int, remembered: int) -> Memory:
    """What changes, as it is at the start."""
    r = loop.recorded
    integral, tilt = (loop.integral, None) if r is None else (r.integral, r.previous_tilt)
    counts = np.array([tilt is not None, 0, 0, 0], dtype=np.int64)
    return Memory(
        np.array(pack(start)), np.zeros(13), np.zeros(3),
        np.zeros(3) if integral is None else np.array(integral, dtype=float),
        np.zeros(arms) if tilt is None else np.array(tilt, dtype=float),
        np.zeros(remembered), counts, np.zeros(1), np.zeros(13),
    )  # fmt: skip


def _timing(loop: Loop) -> Timing:
    c, n = loop.clock, loop.noise
    stds = (float(n.position_std), float(n.attitude_std), float(n.velocity_std), float(n.rate_std))
    due = (c.per_command, loop.per_imu, loop.per_pose, loop.measured, loop.compensator is not None)
    return Timing(c.dt, *due, *stds, LOST_POSITION, float(LOST_ATTITUDE))


def _allocator(believed: Vehicle) -> tuple[Allocator, tuple[int, int]]:
    """The allocation, and how many arms and rotors there are."""
    if not believed.has_rotors:
        none, empty, no = np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=bool)
        limits = (none, none, none, none, none)
        nothing = Allocator(False, np.zeros((0, 6)), empty, empty, none, empty, no, *limits, 0.0, np.zeros(6), none)
        return nothing, (0, 0)
    arms, rotors = believed.geometry()
    allocation = Allocation(believed)
    group_of, arm, column, strength = np.full(len(rotors), -1), [], [], []
    at = 0
    for g, (own, members) in enumerate(allocation.groups):
        group_of[members] = g
        arm.append(own)
        column.append(at)
        strength.append(float(rotors.c_f[members].sum()))
        at += 2 if arms.tilts[own] else 1
    bounds = (arms.tilt_min, arms.tilt_max, arms.tilt_rate_max, rotors.speed_min, rotors.speed_max)
    a, b, c, d, e = (np.array(bound, dtype=float) for bound in bounds)
    made = Allocator(
        True, np.array(allocation.inverse, order="C"), np.array(arm), np.array(column), np.array(strength), group_of,
        np.array(arms.tilts, dtype=bool), a, b, c, d, e, float(allocation.hold_thrust), np.zeros(6),
        np.zeros(len(arm)),
    )  # fmt: skip
    return made, (len(arms), len(rotors))


def _rows(r: Reference) -> Array:
    parts = (r.position_E, r.quat_ED, r.velocity_E, r.omega_D, r.acceleration_E, r.omega_dot_D)
    return np.ascontiguousarray(np.hstack(parts))


def _states(time: Array, table: Array, voltage: Array | None) -> State:
    return State(time, table[:, :3], table[:, 3:7], table[:, 7:10], table[:, 10:], voltage)
