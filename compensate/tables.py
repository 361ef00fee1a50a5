"""What the compiled step works on: constants of a compensation, what it remembers, and room to work in.

Every array says its shape in its annotation. numba takes these tuples as they are; the printer of `replay.export`
makes tables and structs of C of the same annotations. Sizes:

    WG_OUTPUTS    L, components that are corrected          WG_INPUTS   D, of the process, the command's six first
    WG_POINTS     N, of the process                         WG_WHITENER numbers of C^-1, row by row
    WG_LIMITS     G, rows of the reach                      WG_TILTING  arms that tilt, WG_SINGLES other limits
    WG_ACTUATORS  tilt angles and memory of the physics     WG_STATE    what the physics is told
    WG_FIXED      what of the physics no correction changes WG_ROW      numbers of a result

and of a tape: LINES, of which SLOPED have tangents, ASKED inputs, FREE ones, RESULTS. `layout` lists it all in order;
`compensate.generated.views`, which finds the parts in one array again, is printed from it (`make generated`).
"""

import math
from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.plant.state import State

Ints = NDArray[np.int64]

Number = Annotated[Array, 1]
Count = Annotated[Ints, 1]
Flag = Annotated[Array, 1, "int"]
"""A float here, so that all that is remembered lies together; an int in C."""
Three = Annotated[Array, 3]
Six = Annotated[Array, 6]
Motion = Annotated[Array, 15]
Looked = Annotated[Ints, 15]
Outputs = Annotated[Array, "WG_OUTPUTS"]
Square = Annotated[Array, "WG_OUTPUTS", "WG_OUTPUTS"]
Rows = Annotated[Ints, "WG_OUTPUTS"]
Inputs = Annotated[Array, "WG_INPUTS"]
Points = Annotated[Array, "WG_POINTS"]
Limits = Annotated[Array, "WG_LIMITS"]
Tilting = Annotated[Array, "WG_TILTING"]
Singles = Annotated[Array, "WG_SINGLES"]
Told = Annotated[Array, "WG_STATE"]
Actuators = Annotated[Array, "WG_ACTUATORS"]
Row = Annotated[Array, "WG_ROW"]


class ReachTable(NamedTuple):
    """See `compensate.reach.Reach`."""

    rows: Annotated[Array, "WG_LIMITS", 6]
    low: Singles
    high: Singles
    middle: Tilting
    half: Tilting
    weak: Tilting
    authority: Six
    hover: Six
    solve: Annotated[Array, 6, 6]


class ReachRoom(NamedTuple):
    """Room for the search of the nearest wrench."""

    x: Limits
    z: Limits
    u: Limits
    shares: Six
    wanted: Six
    pull: Six
    between: Six


class Process(NamedTuple):
    """`plant.mismatch.Expansion`, its points by input and C^-1 row by row (the lower triangle where it is one)."""

    input_mean: Inputs
    input_scale: Inputs
    output_scale: Outputs
    coefficients: Annotated[Array, "WG_OUTPUTS", "WG_INPUTS + 1"]
    lengthscales: Annotated[Array, "WG_OUTPUTS", "WG_INPUTS"]
    points: Annotated[Array, "WG_OUTPUTS", "WG_INPUTS", "WG_POINTS"]
    alpha: Annotated[Array, "WG_OUTPUTS", "WG_POINTS"]
    whitener: Annotated[Array, "WG_OUTPUTS", "WG_WHITENER"]
    signal: Outputs
    noise: Outputs
    sigma_scale: Outputs
    triangular: int


class Gate(NamedTuple):
    """Constants of a compensation.

    rows, bound    (L,) the components that are corrected, and by how much at most [N, Nm]; `known` by the physics alone
    accept, enough  J of a solution, and J at which the search stops
    pivot, still, stalled  shares at which a pivot is none, a step none, a fall of J none
    most           evaluations of one search
    lenient        a search that does not settle is taken as it is; else the step is handed back
    watched, offset, scale, threshold, kappa, decay   see `compensate.uncertainty`
    velocity_at, rates_at, position_at, past_at       places among the inputs of the process, -1 where they are none
    lag_a, lag_b0, lag_b1                             lag of the past (`plant.mismatch_inputs`)
    looked         (15,) which numbers of the state must be such as a flight can have
    """

    rows: Rows
    bound: Outputs
    known: Outputs
    watched: Rows
    offset: Outputs
    scale: Outputs
    looked: Looked
    accept: float
    enough: float
    pivot: float
    still: float
    stalled: float
    threshold: float
    kappa: float
    decay: float
    lag_a: float
    lag_b0: float
    lag_b1: float
    most: int
    lenient: int
    has_process: int
    has_physics: int
    velocity_at: int
    rates_at: int
    position_at: int
    past_at: int


class Tape(NamedTuple):
    """`plant.trace.tape.Program` with room for values (n,) and tangents (n, L). In C: statements."""

    code: Annotated[Ints, "LINES", 4]
    inputs: Annotated[Ints, "ASKED"]
    free: Annotated[Ints, "FREE"]
    results: Annotated[Ints, "RESULTS"]
    value: Annotated[Array, "LINES"]
    tangent: Annotated[Array, "SLOPED", "WG_OUTPUTS"]
    split: int


class Compensation(NamedTuple):
    """All that does not change."""

    reach: ReachTable
    process: Process
    gate: Gate
    physics: Tape
    sent: Tape


class Memory(NamedTuple):
    """What is remembered from period to period.

    optimum, correction, known   wrenches [N, Nm]: before the gate, behind it less that of the physics, of the physics
    sent, lag_in, lag_out        the command, input and output of the lag of the past
    stage                        commands that the past has seen (0, 1, 2)
    fresh                        1 where the actuators were never commanded
    """

    optimum: Six
    correction: Six
    known: Six
    sent: Six
    lag_in: Six
    lag_out: Six
    stage: Flag
    fresh: Number
    actuators: Actuators


class Room(NamedTuple):
    """Room to work in: nothing of it outlives a step, but that Python asks for the mismatch of the last one."""

    reach: ReachRoom
    wrench: Six
    told: Told
    fixed: Annotated[Array, "WG_FIXED"]
    xi: Inputs
    at: Inputs
    values: Annotated[Array, "WG_OUTPUTS", "WG_POINTS"]
    sums: Outputs
    white: Points
    mean: Outputs
    slope: Square
    command: Outputs
    std: Outputs
    r: Outputs
    A: Square
    r_at: Outputs
    A_at: Square
    H: Square
    x: Outputs
    trial: Outputs
    best: Outputs
    start: Outputs
    low: Outputs
    high: Outputs
    ratio: Number
    evaluations: Count
    hard: Count


class Observer(NamedTuple):
    """Constants of a momentum observer (`compensate.observer`).

    gain k [rad/s], dt [s]; inertia (3, 3) [kg m^2]; torque_max (3,) largest estimate, jump (3,) torque beyond which a
    change of the rates is no motion [Nm]; late, late_part the delay, in periods; follow_a, b0, b1 (3,) the lag
    """

    inertia: Annotated[Array, 3, 3]
    torque_max: Three
    jump: Three
    follow_a: Three
    follow_b0: Three
    follow_b1: Three
    gain: float
    dt: float
    late_part: float
    late: int


class Observed(NamedTuple):
    """What an observer remembers: its estimate and integral, torques asked for, what the lag has made of them.

    momentum and found are room to work in.
    """

    estimate: Three
    integral: Three
    asked: Annotated[Array, "WG_ASKED", 3]
    made: Three
    sent_before: Three
    momentum: Three
    found: Three
    watching: Flag
    asking: Flag
    following: Flag


class Everything(NamedTuple):
    """All that a step is handed."""

    compensation: Compensation
    memory: Memory
    room: Room


class Entry(NamedTuple):
    """A number or an array among `Everything`: its `path`, whether it holds integers, its shape, () for a number."""

    path: tuple[str, ...]
    integer: bool
    shape: tuple[int | str, ...]


def layout(kind: Any, path: tuple[str, ...] = ()) -> Iterator[Entry]:
    """Every number and array of a tuple, in order; sizes of a tape behind its path."""
    for name, hint in get_type_hints(kind, include_extras=True).items():
        here = (*path, name)
        if hint in (int, float):
            yield Entry(here, hint is int, ())
        elif not hasattr(hint, "__metadata__"):
            yield from layout(hint, here)
        else:
            sizes = [size for size in hint.__metadata__ if size != "int"]
            named = [f"{path[-1].upper()}_{s}" if isinstance(s, str) and not s.startswith("WG_") else s for s in sizes]
            yield Entry(here, get_args(hint)[0] == Ints, tuple(named))


LINE = 8
"""Numbers of a line of the processor's cache: what begins with one is fetched in fewer pieces."""
ENTRIES = tuple(layout(Everything))
SIZES = tuple(dict.fromkeys(s for entry in ENTRIES for s in entry.shape if isinstance(s, str) and "+" not in s))
"""Names of the sizes, with which the integers begin."""


def packed(compensation: Compensation, sizes: dict[str, int]) -> tuple[Array, Ints]:
    """Copies of a compensation, and room for the rest, in one array of numbers and one of integers.

    numba unpacks sixty arrays in the time of two steps.
    """
    totals = {False: LINE, True: len(SIZES)}
    for entry in ENTRIES:
        twice = 1 + (entry.path[0] == "memory")  # what it was before a step
        totals[entry.integer] += twice * -(-math.prod(_sizes(entry, sizes)) // LINE) * LINE
    room = np.zeros(totals[False])
    start = -(room.ctypes.data // room.itemsize) % LINE
    numbers, counts = room[start:], np.zeros(totals[True], dtype=np.int64)
    counts[: len(SIZES)] = [sizes[name] for name in SIZES]
    ends = {False: 0, True: len(SIZES)}
    for entry in ENTRIES:
        size = math.prod(_sizes(entry, sizes))
        if entry.path[0] == "compensation":
            value: Any = compensation
            for name in entry.path[1:]:
                value = getattr(value, name)
            array = counts if entry.integer else numbers
            array[ends[entry.integer] :][:size] = np.ravel(value)
        ends[entry.integer] += -(-size // LINE) * LINE
    return numbers, counts


def _sizes(entry: Entry, sizes: dict[str, int]) -> list[int]:
    return [s if isinstance(s, int) else sizes[s.removesuffix(" + 1")] + s.endswith(" + 1") for s in entry.shape]


# -- the state as a row of numbers, an input of a step --

LARGEST = {
    **{f"position_{k}": 1e8 for k in "xyz"},
    **{f"quat_{k}": 2.0 for k in "wxyz"},
    **{f"velocity_{k}": 1e3 for k in "xyz"},
    **{f"omega_{k}": 1e3 for k in "xyz"},
    "time": 1e10,
    "voltage": 1e4,
}
"""Largest numbers that the state of a flight can have; beyond is a fault. In E and B, in SI units: geocentric positions
and the time of day fit in."""
STATE = tuple(LARGEST)
"""Names of the state's numbers, in their order."""
IMPLAUSIBLE = "the state is not finite, or none that a flight can have: no correction"


def rows_of(states: State) -> Array:
    """States (K, 15) as `STATE`; nan for a voltage that is not known."""
    voltage = np.full(len(states.time), np.nan) if states.voltage is None else states.voltage
    parts = (states.position_E, states.quat_EB, states.velocity_E, states.omega_B)
    return np.hstack([*parts, states.time[:, None], voltage[:, None]])


def state_row(state: State) -> Array:
    """The first of the states (15,)."""
    voltage = [math.nan] if state.voltage is None else state.voltage[:1]
    parts = (state.position_E[0], state.quat_EB[0], state.velocity_E[0], state.omega_B[0], state.time[:1], voltage)
    return np.concatenate(parts)


def looked_at(moves: bool, *, powered: bool) -> Ints:
    """Which numbers of a state (15,) must be such as a flight can have: of all the motion, or none; the voltage."""
    return np.array([moves] * (len(STATE) - 1) + [powered], dtype=np.int64)
