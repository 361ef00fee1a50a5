"""The corrected allocation of one demand, written once: compiled here, written as C99 and as Python by `replay.export`.

Of the thrusts that make the demand, those whose largest share of their range is least:

    min  max_g |u_g|     subject to     b = sum_g P_g u_g,    b = demand (W - bias)

which keeps the largest distance to the limits ("load balancing", Bodson and Frost, J. Guidance 34(2), 2011). Lawson's
method: weighted least squares, u_g = P_g^T y / w_g with (sum_g P_g P_g^T / w_g) y = b, whose weights are multiplied
with |u_g| in each round (Lawson, dissertation, UCLA 1961; Rice and Usow, Math. Comp. 22, 1968). Every round makes b
exactly; the first one, of equal weights, is the pseudo-inverse. There are as many rounds for every demand, and the last
one counts: a search that ended where it is near enough would let the command jump from one demand to the next.

Where the pseudo-inverse leaves enough (`calm`), it is taken: it asks for the least thrust and tilts arms the least.
A demand that is out of reach gives up torque about z first, then all of it towards hover (`found`). Restricted to what
`compensate.kernels` is restricted to.
"""

# mypy: disable-error-code="no-any-return"

import math

from wrenchgap.compensate.allocation_tables import (
    AllocationCommand,
    AllocationMemory,
    AllocationRoom,
    AllocationTable,
    Unknowns,
)
from wrenchgap.compensate.compiling import printed
from wrenchgap.compensate.tables import Six

TURN = 2.0 * math.pi
FLOOR = 1e-3
"""Least weight, of the largest: below, the system has too few digits left in single precision."""
SMALL = 1e-9
"""Rounding of double precision."""
WOUND = 1000.0
"""Tilt [rad] that a memory can hold, 159 turns one way: a single-precision number still has it to 6e-5 rad."""
SAME_ANGLE = 1e-5
"""Of single precision [rad]."""
BLEND = 0.02
"""Share by which the last round must be better than the first to count alone; where it is no better the first does."""
RAMP = 0.25
"""Of |u_g| from `calm` on, over which the largest margin takes the place of the pseudo-inverse."""
SLACK = 0.1
"""Share of the limits that torque about z is left at least: with less, commands change abruptly at the end of reach."""
MADE, BAD_DEMAND, REDUCED = range(3)
"""Status: made as asked, but for axes that no rotor drives, and what arms with hardly any thrust miss that keep their
angle (`made` says what is made); not finite, the command before is repeated; beyond the limits."""


@printed
def bounded(value: float, low: float, high: float) -> float:
    """The value within its limits; the lower one for what is no number."""
    above = value if value >= low else low
    return above if above <= high else high


@printed
def size(u: Unknowns, g: int) -> float:
    """|u_g|."""
    return math.sqrt(u[g, 0] * u[g, 0] + u[g, 1] * u[g, 1])


@printed
def weighted(t: AllocationTable, room: AllocationRoom) -> float:
    """`room.u` of least sum_g w_g |u_g|^2 that makes `room.b`, by Cholesky's method. Returns the largest |u_g|."""
    rank = len(room.y)
    for g in range(len(room.weight)):
        room.free[g] = 1.0 / room.weight[g]
    for i in range(rank):
        for j in range(i + 1):
            total = 0.0
            for g in range(len(room.weight)):
                total += room.free[g] * (t.along[i, g] * t.along[j, g] + t.across[i, g] * t.across[j, g])
            for k in range(j):
                total -= room.factor[i, k] * room.factor[j, k]
            if i == j:
                room.factor[i, i] = math.sqrt(total if total > SMALL else SMALL)
            else:
                room.factor[i, j] = total / room.factor[j, j]
    for i in range(rank):
        total = room.b[i]
        for k in range(i):
            total -= room.factor[i, k] * room.y[k]
        room.y[i] = total / room.factor[i, i]
    for i in range(rank - 1, -1, -1):
        total = room.y[i]
        for k in range(i + 1, rank):
            total -= room.factor[k, i] * room.y[k]
        room.y[i] = total / room.factor[i, i]
    largest = 0.0
    for g in range(len(room.weight)):
        room.u[g, 0] = 0.0
        room.u[g, 1] = 0.0
        for i in range(rank):
            room.u[g, 0] += t.along[i, g] * room.y[i] * room.free[g]
            room.u[g, 1] += t.across[i, g] * room.y[i] * room.free[g]
        if size(room.u, g) > largest:
            largest = size(room.u, g)
    return largest


@printed
def copied(u: Unknowns, into: Unknowns) -> None:
    """Copy unknowns."""
    for g in range(len(u)):
        into[g, 0] = u[g, 0]
        into[g, 1] = u[g, 1]


@printed
def take_hover(t: AllocationTable, room: AllocationRoom) -> None:
    """`room.best` of hover."""
    for g in range(len(t.hover)):
        room.best[g, 0] = t.hover[g, 0]
        room.best[g, 1] = t.hover[g, 1]


@printed
def searched(t: AllocationTable, room: AllocationRoom) -> float:
    """`room.best`, whose largest |u_g| is about the least for `room.wanted`, and which is returned."""
    for i in range(len(room.b)):
        room.b[i] = 0.0
        for k in range(6):
            room.b[i] += t.demand[i, k] * (room.wanted[k] - t.bias[k])
    for g in range(len(room.weight)):
        room.weight[g] = 1.0
    first = weighted(t, room)
    copied(room.u, room.best)
    largest = first
    for _ in range(t.rounds):
        top = SMALL * SMALL
        for g in range(len(room.weight)):
            room.weight[g] = room.weight[g] * size(room.u, g)
            if room.weight[g] > top:
                top = room.weight[g]
        for g in range(len(room.weight)):
            room.weight[g] = bounded(room.weight[g] / top, FLOOR, 1.0)
        largest = weighted(t, room)
    gain = bounded((first - largest) / (BLEND * first + SMALL), 0.0, 1.0)
    gain = gain * bounded((first - t.calm) / RAMP, 0.0, 1.0)
    least = 0.0
    for g in range(len(room.weight)):
        room.best[g, 0] += gain * (room.u[g, 0] - room.best[g, 0])
        room.best[g, 1] += gain * (room.u[g, 1] - room.best[g, 1])
        if size(room.best, g) > least:
            least = size(room.best, g)
    return least


@printed
def way_within(start: Unknowns, end: Unknowns, limit: float) -> float:
    """Largest share s of the way from `start`, which is within, to `end` at which all |u_g| are at most `limit`."""
    share = 1.0
    for g in range(len(start)):
        along = end[g, 0] - start[g, 0]
        across = end[g, 1] - start[g, 1]
        square = along * along + across * across
        slope = start[g, 0] * along + start[g, 1] * across
        left = limit * limit - start[g, 0] * start[g, 0] - start[g, 1] * start[g, 1]
        left = left if left > 0.0 else 0.0
        root = math.sqrt(slope * slope + square * left)
        until = left / (slope + root) if slope > 0.0 else (root - slope) / (square if square > 0.0 else 1.0)
        if square > 0.0 and until < share:
            share = until
    return share


@printed
def go(room: AllocationRoom, share: float) -> None:
    """Take `room.best` so far of its way to `room.less`."""
    for g in range(len(room.weight)):
        room.best[g, 0] += share * (room.less[g, 0] - room.best[g, 0])
        room.best[g, 1] += share * (room.less[g, 1] - room.best[g, 1])


@printed
def found(t: AllocationTable, room: AllocationRoom, wrench: Six) -> int:
    """`room.best` within the limits for a finite demand: as asked, else without torque about z, then with what is left.

    What is asked without torque about z may take 1 - `SLACK` of the limits, nearer to hover if need be; from there it
    goes on towards the demand as far as the limits allow. So no command jumps where a demand leaves the reach.
    """
    for k in range(6):
        room.wanted[k] = bounded(wrench[k], -t.far[k], t.far[k])
    if searched(t, room) <= 1.0:
        return MADE
    copied(room.best, room.whole)
    room.wanted[5] = 0.0
    if searched(t, room) > 1.0 - SLACK:
        copied(room.best, room.less)
        take_hover(t, room)
        go(room, way_within(room.best, room.less, 1.0 - SLACK))
    copied(room.whole, room.less)
    go(room, way_within(room.best, room.less, 1.0))
    return REDUCED


@printed
def angle(tilt: float, before: float, low: float, high: float) -> float:
    """A tilt next to the one before, by whole turns into its range where that has its direction, else at its end."""
    near = tilt + TURN * math.floor((before - tilt) / TURN + 0.5)
    over = near - high - SAME_ANGLE
    under = low - near - SAME_ANGLE
    back = -math.floor(-over / TURN) if over > 0.0 else 0.0
    forth = -math.floor(-under / TURN) if under > 0.0 else 0.0
    other = near + TURN * (forth - back)
    inside = other >= low - SAME_ANGLE and other <= high + SAME_ANGLE
    return bounded(other if inside else near, low, high)


@printed
def sent(t: AllocationTable, room: AllocationRoom, m: AllocationMemory, out: AllocationCommand) -> bool:
    """The command of `room.best`, within all limits, and what it makes; whether it is what was found."""
    same = True
    out.margin[0] = 1.0
    for k in range(6):
        out.made[k] = t.made_bias[k]
    for g in range(len(room.weight)):
        along = t.centre[g] + t.half[g] * room.best[g, 0]
        across = t.half[g] * room.best[g, 1]
        thrust = math.sqrt(along * along + across * across) if t.tilting[g] == 1 else along
        kept = bounded(thrust, t.low[g], t.high[g])
        left = 1.0 - size(room.best, g)
        if left < out.margin[0]:
            out.margin[0] = left if left > 0.0 else 0.0
        if t.tilting[g] == 1:
            a = t.arm[g]
            wanted = math.atan2(across, along)
            before = m.last_tilt[a]
            turned = angle(wanted, before, t.tilt_min[a], t.tilt_max[a])
            out.tilt[a] = turned if thrust >= t.weak[g] else bounded(before, t.tilt_min[a], t.tilt_max[a])
            along = kept * math.cos(out.tilt[a])
            across = kept * math.sin(out.tilt[a])
            off = out.tilt[a] - wanted
            off = off - TURN * math.floor(off / TURN + 0.5)
            same = same and not (abs(off) > 2.0 * SAME_ANGLE and thrust >= t.weak[g])
        else:
            along = kept
        same = same and abs(kept - thrust) <= 1e-6 * t.half[g]
        room.weight[g] = kept
        for k in range(6):
            out.made[k] += t.made_along[k, g] * along + t.made_across[k, g] * across
    for r in range(len(out.thrust)):
        out.thrust[r] = bounded(t.share[r] * room.weight[t.owner[r]], t.least[r], t.most[r])
    return same


@printed
def kept(m: AllocationMemory, out: AllocationCommand) -> None:
    """Remember a command."""
    for r in range(len(out.thrust)):
        m.last_thrust[r] = out.thrust[r]
    for a in range(len(out.tilt)):
        m.last_tilt[a] = out.tilt[a]
    for k in range(6):
        m.last_made[k] = out.made[k]


@printed
def hovering(t: AllocationTable, room: AllocationRoom, m: AllocationMemory, out: AllocationCommand) -> None:
    """Forget the past: the command before is that of hover, with arms at rest."""
    for a in range(len(out.tilt)):
        m.last_tilt[a] = 0.0
        out.tilt[a] = bounded(0.0, t.tilt_min[a], t.tilt_max[a])
    take_hover(t, room)
    if not sent(t, room, m, out):
        out.margin[0] = 0.0
    kept(m, out)


@printed
def answered(t: AllocationTable, room: AllocationRoom, m: AllocationMemory, wrench: Six, out: AllocationCommand) -> int:
    """The command for a demand about the centre of mass; one that is not finite repeats the command of before.

    A memory that is none, as after an upset, is forgotten: a number that is not finite, an arm wound beyond `WOUND`.
    """
    finite = True
    for k in range(6):
        finite = finite and math.isfinite(wrench[k])
    remembered = True
    for r in range(len(out.thrust)):
        remembered = remembered and math.isfinite(m.last_thrust[r])
    for a in range(len(out.tilt)):
        remembered = remembered and abs(m.last_tilt[a]) <= WOUND  # not of NaN either
    for k in range(6):
        remembered = remembered and math.isfinite(m.last_made[k])
    if not remembered:
        hovering(t, room, m, out)
    for a in range(len(out.tilt)):
        out.tilt[a] = bounded(m.last_tilt[a], t.tilt_min[a], t.tilt_max[a])
    if not finite:
        for r in range(len(out.thrust)):
            out.thrust[r] = bounded(m.last_thrust[r], t.least[r], t.most[r])
        for k in range(6):
            out.made[k] = m.last_made[k]
        out.margin[0] = 0.0
        out.status[0] = BAD_DEMAND
        return BAD_DEMAND
    status = found(t, room, wrench)
    if not sent(t, room, m, out):
        status = REDUCED
    kept(m, out)
    out.status[0] = status
    return status
