"""One period of the compensation, written once: numba compiles it here, and `replay.export` prints it as C99.

The functions are restricted to what both can say: arrays of the shapes that `compensate.tables` gives them, `for` over
`range`, `while`, `if`, arithmetic, `math`, calls of each other. What is `printed` goes into the exported code as it
stands; the rest is for Python alone. Physics comes as a tape (`plant.trace.tape`) that numba interprets and C has as
statements.

numba renews what it has compiled when the file changes in which the outermost function stands, and for no other: a
change of `plant.trace.tape` asks for one here.
"""

# mypy: disable-error-code="no-any-return"
# ruff: noqa: SIM110, no generators here
# Long because it is the whole step: a file for each part would be compiled stale when another changes.

import math

from wrenchgap.compensate import compiling
from wrenchgap.compensate.compiling import external, kernel, opening, printed, replaced, sums
from wrenchgap.compensate.generated.views import opened
from wrenchgap.compensate.tables import (
    LARGEST,
    Actuators,
    Compensation,
    Everything,
    Gate,
    Ints,
    Limits,
    Looked,
    Memory,
    Motion,
    Observed,
    Observer,
    Outputs,
    Points,
    Process,
    ReachRoom,
    ReachTable,
    Room,
    Row,
    Six,
    Square,
    Tape,
    Three,
    Told,
)
from wrenchgap.flight.flight import Array
from wrenchgap.plant.trace.tape import differentiate, evaluate

TURN = 2.0 * math.pi
SLACK = 1e-6
"""Share of a limit by which a wrench may be outside and still counts as reached: rounding, also of single precision."""
FAR = 10.0
"""Authorities to which a wanted wrench is cut on every axis before the nearest is looked for: beyond, it is no
demand."""
ROUNDS, PULLS = 100, 30
"""Rounds of the search for the nearest wrench, and halvings when it is pulled inside. Both are fixed, so that a period
takes a bounded time; `reach.NEAR` is what they reach."""
STATE_MAX = tuple(LARGEST.values())
TURN_MIN, TURN_MAX = 0.25, 4.0
"""Squared norm that a quaternion can have before it is none: one of zeros turns every vector to zero."""
KEPT = 1.001
"""By which what is remembered may be beyond its bounds: rounding of single precision."""
PROPOSED, STATIONARY, SINGULAR = range(3)
"""Results of `propose`."""
DONE, HANDED_BACK, REFUSED = range(3)
"""How a step ended."""
ILL = 1e-3
"""Ratio of pivots of A^T A below which A = I + dmu/dW counts as ill-conditioned: singular values apart by 30."""
COMMAND, CORRECTED, FOUND = range(0, 18, 6)
SIGMA, BETA, COST, EVALUATIONS, ACCEPTED, LIMITED, EXPECTED = range(18, 25)
"""Places in a row of results: three wrenches (6,), numbers, and last the mismatch expected before (L,) and after (L,).
LIMITED: the vehicle cannot make the demand, or the optimum."""


@printed
def clipped(value: float, low: float, high: float) -> float:
    """The value within its limits; the lower one for what is no number."""
    above = value if value >= low else low
    return above if above <= high else high


@printed
def larger(a: float, b: float) -> float:
    """The larger of two numbers."""
    return a if a > b else b


# -- what the vehicle can do (`compensate.reach`) --


@printed
def limits(r: ReachTable, shares: Six, x: Limits) -> None:
    """Limits of arms and rotors at a wrench in shares of the authority, each in shares of itself."""
    for g in range(len(x)):
        x[g] = 0.0
        for i in range(6):
            x[g] += r.rows[g, i] * shares[i]


@printed
def off_middle(r: ReachTable, lateral: float, vertical: float, arm: int) -> float:
    """Angle by which the thrust of an arm is off the middle of its range [rad]."""
    turned = math.atan2(lateral, vertical) - r.middle[arm]
    return turned - TURN * math.floor(turned / TURN + 0.5)


@printed
def inside(r: ReachTable, shares: Six, x: Limits) -> bool:
    """Whether the vehicle makes a wrench in shares of the authority with no limit met; not so for what is no number."""
    limits(r, shares, x)
    for a in range(len(r.middle)):
        thrust = math.sqrt(x[2 * a] * x[2 * a] + x[2 * a + 1] * x[2 * a + 1])
        if not thrust <= 1.0 + SLACK:
            return False
        if thrust > r.weak[a] and abs(off_middle(r, x[2 * a], x[2 * a + 1], a)) > r.half[a] + SLACK:
            return False
    for k in range(len(r.low)):
        value = x[2 * len(r.middle) + k]
        if not (value >= r.low[k] - SLACK and value <= r.high[k] + SLACK):
            return False
    return True


@printed
def put_within(r: ReachTable, x: Limits) -> None:
    """Put the nearest unknowns within the limits, each arm and rotor by itself, in place of x."""
    for a in range(len(r.middle)):
        off = off_middle(r, x[2 * a], x[2 * a + 1], a)
        if abs(off) > r.half[a]:
            edge = r.middle[a] + (r.half[a] if off > 0.0 else -r.half[a])
            along = x[2 * a] * math.sin(edge) + x[2 * a + 1] * math.cos(edge)
            along = along if along > 0.0 else 0.0
            x[2 * a] = along * math.sin(edge)
            x[2 * a + 1] = along * math.cos(edge)
        thrust = math.sqrt(x[2 * a] * x[2 * a] + x[2 * a + 1] * x[2 * a + 1])
        if thrust > 1.0:
            x[2 * a] /= thrust
            x[2 * a + 1] /= thrust
    for k in range(len(r.low)):
        place = 2 * len(r.middle) + k
        x[place] = clipped(x[place], r.low[k], r.high[k])


@printed
def nearest(r: ReachTable, w: ReachRoom, wrench: Six) -> bool:
    """Put the nearest wrench that the vehicle can make in place of one of numbers; whether it is another one."""
    for i in range(6):
        w.shares[i] = wrench[i] / r.authority[i]
    if len(r.low) == 0 or inside(r, w.shares, w.x):
        return False
    for i in range(6):
        w.wanted[i] = clipped(w.shares[i], -FAR, FAR)
        w.shares[i] = w.wanted[i]
    for g in range(len(w.u)):
        w.u[g] = 0.0
    for _ in range(ROUNDS):
        limits(r, w.shares, w.x)
        for g in range(len(w.u)):
            w.z[g] = w.x[g] + w.u[g]
        put_within(r, w.z)
        for i in range(6):
            w.pull[i] = w.wanted[i]
        for g in range(len(w.u)):
            w.u[g] += w.x[g] - w.z[g]
            for i in range(6):
                w.pull[i] += r.rows[g, i] * (w.z[g] - w.u[g])
        for i in range(6):
            w.shares[i] = 0.0
            for j in range(6):
                w.shares[i] += r.solve[i, j] * w.pull[j]
    least = 0.0
    if inside(r, w.shares, w.x):
        least = 1.0
    else:
        most = 1.0
        for _ in range(PULLS):
            middle = 0.5 * (least + most)
            for i in range(6):
                w.between[i] = r.hover[i] + middle * (w.shares[i] - r.hover[i])
            if inside(r, w.between, w.x):
                least = middle
            else:
                most = middle
    for i in range(6):
        wrench[i] = r.authority[i] * (r.hover[i] + least * (w.shares[i] - r.hover[i]))
    return True


@printed
def plausible(looked: Looked, state: Motion) -> bool:
    """Whether the numbers of a state that are looked at are such as a flight can have."""
    for i in range(15):
        if looked[i] != 0 and not abs(state[i]) <= STATE_MAX[i]:
            return False
    if looked[3] != 0:
        square = state[3] * state[3] + state[4] * state[4] + state[5] * state[5] + state[6] * state[6]
        return square >= TURN_MIN and square <= TURN_MAX
    return True


# -- the process (`learn.process.gp`; forms in `plant.mismatch`) --


@sums
def dot(a: Array, b: Array, count: int) -> float:
    """Sum of the products of `count` numbers, in any order."""
    total = 0.0
    for n in range(count):
        total += a[n] * b[n]
    return total


@replaced(by=compiling.gaussians)
def gaussians(row: Points) -> None:
    """exp(-row / 2) in place of a row."""
    for n in range(len(row)):
        row[n] = math.exp(-0.5 * row[n])


@printed
def scaled(p: Process, xi: float, k: int, d: int) -> float:
    """Input d over the lengthscale of output k."""
    return (xi - p.input_mean[d]) / p.input_scale[d] / p.lengthscales[k, d]


@printed
def evaluate_kernel(p: Process, w: Room) -> None:
    """exp(-1/2 |q - p_n|^2) at the inputs w.xi, in w.values (L, N), with their weighted sums."""
    same = True
    for d in range(len(w.xi)):
        same = same and w.at[d] == w.xi[d]
    if same:
        return
    for k in range(len(w.sums)):
        row = w.values[k]
        for n in range(len(row)):
            row[n] = 0.0
        for d in range(len(w.xi)):
            q = scaled(p, w.xi[d], k, d)
            column = p.points[k, d]
            for n in range(len(row)):
                apart = column[n] - q
                row[n] += apart * apart
        gaussians(row)
        w.sums[k] = dot(row, p.alpha[k], len(row))
    for d in range(len(w.xi)):
        w.at[d] = w.xi[d]


@printed
def process_mean(p: Process, w: Room, mean: Outputs) -> None:
    """Mean (L,) of the process at the inputs w.xi."""
    evaluate_kernel(p, w)
    for k in range(len(mean)):
        total = p.coefficients[k, 0]
        for d in range(len(w.xi)):
            total += p.coefficients[k, d + 1] * ((w.xi[d] - p.input_mean[d]) / p.input_scale[d])
        mean[k] = p.output_scale[k] * (total + p.signal[k] * w.sums[k])


@printed
def process_slope(p: Process, g: Gate, w: Room, slope: Square) -> None:
    """Derivative of the mean at the inputs w.xi, at which it was asked for, to the corrected components (L, L)."""
    for k in range(len(w.sums)):
        row = w.values[k]
        for n in range(len(row)):
            w.white[n] = row[n] * p.alpha[k, n]
        for i in range(len(w.sums)):
            d = g.rows[i]
            part = (dot(w.white, p.points[k, d], len(row)) - scaled(p, w.xi[d], k, d) * w.sums[k]) / p.lengthscales[
                k, d
            ]
            slope[k, i] = p.output_scale[k] / p.input_scale[d] * (p.coefficients[k, d + 1] + p.signal[k] * part)


@printed
def process_std(p: Process, g: Gate, w: Room) -> None:
    """Standard deviations (L,) of the watched outputs at the inputs w.xi, noise included, in w.std."""
    evaluate_kernel(p, w)
    for k in range(len(w.std)):
        if g.watched[k] != 0:
            row = w.values[k]
            place = 0
            for n in range(len(row)):
                count = n + 1 if p.triangular != 0 else len(row)
                w.white[n] = dot(p.whitener[k, place:], row, count)
                place += count
            variance = p.signal[k] - p.signal[k] * p.signal[k] * dot(w.white, w.white, len(row))
            if variance <= 0.0:
                variance = 0.0
            w.std[k] = p.output_scale[k] * p.sigma_scale[k] * math.sqrt(variance + p.noise[k])


# -- the physics, a tape --


@external("fixed")
def physics_fixed(tape: Tape, told: Told, fixed: Array) -> None:
    """Work out what no correction changes."""
    for i in range(len(tape.inputs)):
        tape.value[tape.inputs[i]] = told[i]
    evaluate(tape, 0, tape.split)


@external("mean", "slope")
def physics_moving(tape: Tape, fixed: Array, command: Outputs, mean: Outputs, slope: Square) -> None:
    """Mismatch (L,) of the corrected components (L,) of a command, and its derivatives (L, L)."""
    for i in range(len(tape.free)):
        tape.value[tape.inputs[tape.free[i]]] = command[i]
    differentiate(tape)
    for i in range(len(mean)):
        mean[i] = tape.value[tape.results[i]]
        for j in range(len(mean)):
            slope[i, j] = tape.tangent[tape.results[i], j]


@external("actuators")
def physics_sent(tape: Tape, told: Told, actuators: Actuators) -> None:
    """Where a command brings the actuators."""
    for i in range(len(tape.inputs)):
        tape.value[tape.inputs[i]] = told[i]
    evaluate(tape, 0, len(tape.code))
    for i in range(len(tape.results)):
        actuators[i] = tape.value[tape.results[i]]


# -- the search: r(x) = mu(W + x) + x = 0 in a box (`compensate.lbfgs` has the equations) --


@printed
def residual(c: Compensation, w: Room, x: Outputs, process: bool) -> float:
    """|r|^2 at a correction x (L,) of w.wrench, r in w.r, and dr/dx in w.A but for the slope of the process."""
    g = c.gate
    w.evaluations[0] += 1
    for i in range(len(x)):
        w.r[i] = x[i]
        w.command[i] = w.wrench[g.rows[i]] + x[i]
        for j in range(len(x)):
            w.A[i, j] = 1.0 if i == j else 0.0
    if process:
        for d in range(6):
            w.xi[d] = w.wrench[d]
        for i in range(len(x)):
            w.xi[g.rows[i]] = w.command[i]
        process_mean(c.process, w, w.mean)
        for i in range(len(x)):
            w.r[i] += w.mean[i]
    if g.has_physics != 0:
        physics_moving(c.physics, w.fixed, w.command, w.mean, w.slope)
        for i in range(len(x)):
            w.r[i] += w.mean[i]
            for j in range(len(x)):
                w.A[i, j] += w.slope[i, j]
    cost = 0.0
    for i in range(len(x)):
        cost += w.r[i] * w.r[i]
    return cost


@printed
def add_process_slope(c: Compensation, w: Room, process: bool) -> None:
    """Complete dr/dx in w.A at the point of the last `residual`; the last point of a search needs none."""
    if process:
        process_slope(c.process, c.gate, w, w.slope)
        for i in range(len(w.r)):
            for j in range(len(w.r)):
                w.A[i, j] += w.slope[i, j]


@printed
def normal_equations(w: Room, damping: float) -> float:
    """A^T A + damping I in w.H (its lower half), A^T r in w.trial, at w.x; components that a bound holds are fixed.

    A bound holds a component that the cost pushes against it (projected Newton, Bertsekas 1982). Returns the largest
    diagonal number of A^T A, or 0 where nothing is left to move.
    """
    count = len(w.x)
    largest = 0.0
    for i in range(count):
        w.trial[i] = 0.0
        for k in range(count):
            w.trial[i] += w.A_at[k, i] * w.r_at[k]
        for j in range(i + 1):
            w.H[i, j] = 0.0
            for k in range(count):
                w.H[i, j] += w.A_at[k, i] * w.A_at[k, j]
        largest = w.H[i, i] if w.H[i, i] > largest else largest
    moving = 0
    for i in range(count):
        if (w.x[i] <= w.low[i] and w.trial[i] > 0.0) or (w.x[i] >= w.high[i] and w.trial[i] < 0.0):
            for j in range(i):
                w.H[i, j] = 0.0
            for j in range(i + 1, count):
                w.H[j, i] = 0.0
            w.H[i, i] = largest
            w.trial[i] = 0.0
        elif w.trial[i] < 0.0 or w.trial[i] > 0.0:
            moving += 1
        w.H[i, i] += damping
    return largest if moving > 0 else 0.0


@printed
def propose(g: Gate, w: Room, damping: float) -> int:
    """The next point of the search, in w.trial, from r and A at w.x: Newton's step where it is not held or damped.

    (A^T A + damping I) p = -A^T r (Levenberg and Marquardt; Nocedal and Wright, "Numerical Optimization", 2nd ed.,
    10.3), by Cholesky's factors in place. w.ratio is that of the least pivot to the largest number.
    """
    count = len(w.x)
    largest = normal_equations(w, damping) + damping
    if largest == damping:
        return STATIONARY
    least = largest
    for i in range(count):
        for j in range(i + 1):
            total = w.H[i, j]
            for k in range(j):
                total -= w.H[i, k] * w.H[j, k]
            if i == j:
                least = total if total < least else least
                if not total > g.pivot * largest:
                    return SINGULAR
                w.H[i, i] = math.sqrt(total)
            else:
                w.H[i, j] = total / w.H[j, j]
    for i in range(count):
        for k in range(i):
            w.trial[i] -= w.H[i, k] * w.trial[k]
        w.trial[i] /= w.H[i, i]
    for i in range(count - 1, -1, -1):
        for k in range(i + 1, count):
            w.trial[i] -= w.H[k, i] * w.trial[k]
        w.trial[i] /= w.H[i, i]
    w.ratio[0] = least / largest
    for i in range(count):
        w.trial[i] = clipped(w.x[i] - w.trial[i], w.low[i], w.high[i])
    return PROPOSED


@printed
def standing_still(g: Gate, w: Room) -> bool:
    """Whether a proposal is the point that it starts from, to rounding."""
    moved = 0.0
    size = 0.0
    for i in range(len(w.x)):
        apart = abs(w.trial[i] - w.x[i])
        moved = apart if apart > moved else moved
        size = abs(w.x[i]) if abs(w.x[i]) > size else size
    return moved <= g.still * size


@printed
def newton(c: Compensation, w: Room, process: bool) -> float:
    """Search from w.start within the box of w.low and w.high; the best point in w.x, its cost is returned.

    Newton's step is taken where it lowers the cost; else it is damped more and more. w.hard says whether A was
    ill-conditioned on the way.
    """
    g = c.gate
    count = len(w.x)
    for i in range(count):
        w.x[i] = clipped(w.start[i], w.low[i], w.high[i])
    cost = residual(c, w, w.x, process)
    used = 1
    damping = 0.0
    fresh = True
    for _ in range(2 * g.most):
        if used >= g.most or not cost > g.enough:
            break
        if fresh:
            add_process_slope(c, w, process)
            for i in range(count):
                w.r_at[i] = w.r[i]
                for j in range(count):
                    w.A_at[i, j] = w.A[i, j]
            fresh = False
        trace = 0.0
        for i in range(count):
            for j in range(count):
                trace += w.A_at[i, j] * w.A_at[i, j]
        said = propose(g, w, damping)
        if said == STATIONARY or not math.isfinite(trace):
            break
        if said == SINGULAR:
            w.hard[0] = 1
            damping = larger(10.0 * damping, 1e-6 * trace)
            continue
        if damping == 0.0 and w.ratio[0] < ILL:
            w.hard[0] = 1
        if standing_still(g, w):
            break
        after = residual(c, w, w.trial, process)
        used += 1
        if after < cost:
            stalled = cost - after <= g.stalled * cost
            cost = after
            damping = 0.1 * damping if damping > 1e-9 * trace else 0.0
            for i in range(count):
                w.x[i] = w.trial[i]
            if stalled:
                break
            fresh = True
        else:
            damping = larger(10.0 * damping, 1e-4 * trace)
    return cost


@printed
def solve(c: Compensation, w: Room, process: bool) -> float:
    """From w.start, else from zero, else no correction: the better, in w.best; its cost is returned."""
    g = c.gate
    count = len(w.best)
    elsewhere = False
    for i in range(count):
        elsewhere = elsewhere or w.start[i] < 0.0 or w.start[i] > 0.0
    w.hard[0] = 0
    cost = newton(c, w, process)
    hard = w.hard[0]
    for i in range(count):
        w.best[i] = w.x[i]
        w.start[i] = 0.0
    if not cost < g.accept and elsewhere:
        other = newton(c, w, process)
        if other < cost or not math.isfinite(cost):
            cost = other
            for i in range(count):
                w.best[i] = w.x[i]
    w.hard[0] = hard
    if not cost < g.accept:
        nothing = residual(c, w, w.start, process)
        if not cost < nothing:
            cost = nothing
            for i in range(count):
                w.best[i] = 0.0
    return cost


# -- one period --


@printed
def set_further_inputs(g: Gate, m: Memory, w: Room, state: Motion) -> None:
    """Inputs of the process beyond the command (`plant.mismatch_inputs`); the lag of the past goes on."""
    if g.velocity_at >= 0:
        x = -state[4]
        y = -state[5]
        z = -state[6]
        a = 2.0 * (y * state[9] - z * state[8])
        b = 2.0 * (z * state[7] - x * state[9])
        t = 2.0 * (x * state[8] - y * state[7])
        w.xi[g.velocity_at] = state[7] + state[3] * a + (y * t - z * b)
        w.xi[g.velocity_at + 1] = state[8] + state[3] * b + (z * a - x * t)
        w.xi[g.velocity_at + 2] = state[9] + state[3] * t + (x * b - y * a)
    if g.rates_at >= 0:
        for i in range(3):
            w.xi[g.rates_at + i] = state[10 + i]
    if g.position_at >= 0:
        for i in range(3):
            w.xi[g.position_at + i] = state[i]
    if g.past_at >= 0:
        for i in range(6):
            late = m.sent[i]
            if m.stage[0] >= 2:
                late = g.lag_a * m.lag_out[i] + g.lag_b0 * m.lag_in[i] + g.lag_b1 * m.sent[i]
            w.xi[g.past_at + i] = m.sent[i] - late
            m.lag_in[i] = m.sent[i]
            m.lag_out[i] = late
        if m.stage[0] == 1:
            m.stage[0] = 2


@printed
def prepare(c: Compensation, m: Memory, w: Room, state: Motion) -> None:
    """Work out what no correction of w.wrench changes in this state."""
    w.evaluations[0] = 0
    w.at[0] = math.nan
    if c.gate.has_physics != 0:
        for i in range(6):
            w.told[i] = w.wrench[i]
        for i in range(15):
            w.told[6 + i] = state[i]
        w.told[21] = m.fresh[0]
        for i in range(len(m.actuators)):
            w.told[22 + i] = m.actuators[i]
        physics_fixed(c.physics, w.told, w.fixed)
    if c.gate.has_process != 0:
        set_further_inputs(c.gate, m, w, state)


@printed
def search(c: Compensation, m: Memory, w: Room, out: Row) -> int:
    """Corrections of the physics alone, about which the bounds of the process lie, and of both."""
    g = c.gate
    for i in range(len(w.low)):
        w.low[i] = -g.bound[i]
        w.high[i] = g.bound[i]
    if g.has_process != 0 and g.has_physics != 0:
        for i in range(len(w.low)):
            w.low[i] = -g.known[i]
            w.high[i] = g.known[i]
            w.start[i] = m.known[g.rows[i]]
        alone = solve(c, w, False)
        if g.lenient == 0 and (w.hard[0] != 0 or not alone < g.accept):
            return HANDED_BACK
        for i in range(len(w.low)):
            value = w.best[i] if math.isfinite(alone) else 0.0
            m.known[g.rows[i]] = value
            w.low[i] = value - g.bound[i]
            w.high[i] = value + g.bound[i]
    for i in range(len(w.low)):
        w.start[i] = m.optimum[g.rows[i]]
    cost = solve(c, w, g.has_process != 0)
    if g.lenient == 0 and (w.hard[0] != 0 or not cost < g.accept):
        return HANDED_BACK
    for i in range(len(w.low)):
        m.optimum[g.rows[i]] = w.best[i] if math.isfinite(cost) else 0.0
    out[COST] = cost
    out[EVALUATIONS] = w.evaluations[0]
    out[ACCEPTED] = 1.0 if cost < g.accept else 0.0
    return DONE


@printed
def pass_gate(g: Gate, std: Outputs, m: Memory, wrench: Six, out: Row) -> None:
    """sigma, beta and the correction that the gate lets through (`compensate.uncertainty`), from m.optimum."""
    sigma = -math.inf
    for i in range(len(std)):
        if g.watched[i] != 0:
            normal = (std[i] - g.offset[i]) / g.scale[i]
            if not (normal <= sigma or math.isnan(sigma)):
                sigma = normal
    beta = 0.0 if math.isinf(g.threshold) else 1.0 / (1.0 + math.exp(-g.kappa * (sigma - g.threshold)))
    if not math.isfinite(sigma):
        beta = 1.0
    for i in range(6):
        m.correction[i] = g.decay * beta * m.correction[i] + (1.0 - beta) * (m.optimum[i] - m.known[i])
        out[FOUND + i] = m.optimum[i]
        out[CORRECTED + i] = m.known[i] + m.correction[i]
        out[COMMAND + i] = wrench[i] + out[CORRECTED + i]
    out[SIGMA] = sigma
    out[BETA] = beta


@printed
def mismatch(c: Compensation, w: Room, wrench: Six, found: Outputs) -> None:
    """Mismatch (L,) of a command as the models have it in this period."""
    for i in range(len(found)):
        found[i] = 0.0
        w.command[i] = wrench[c.gate.rows[i]]
    for i in range(6):
        w.told[i] = wrench[i]
    if c.gate.has_process != 0:
        for i in range(6):
            w.xi[i] = wrench[i]
        process_mean(c.process, w, found)
    if c.gate.has_physics != 0:
        physics_fixed(c.physics, w.told, w.fixed)
        physics_moving(c.physics, w.fixed, w.command, w.mean, w.slope)
        for i in range(len(found)):
            found[i] += w.mean[i]


@printed
def forget(m: Memory) -> None:
    """Forget all: before the first step, and behind a period that is none, or whose demand the vehicle cannot make."""
    for i in range(6):
        m.optimum[i] = 0.0
        m.correction[i] = 0.0
        m.known[i] = 0.0
        m.sent[i] = 0.0
        m.lag_in[i] = 0.0
        m.lag_out[i] = 0.0
    for i in range(len(m.actuators)):
        m.actuators[i] = 0.0
    m.stage[0] = 0
    m.fresh[0] = 1.0


@printed
def kept(g: Gate, m: Memory) -> bool:
    """Whether the corrections that are remembered are within their bounds, none on an axis that has no output.

    A step leaves them so; where they are not, somebody else wrote to the memory, or it was never reset.
    """
    for i in range(6):
        known = 0.0
        most = 0.0
        for k in range(len(g.rows)):
            if g.rows[k] == i:
                known = KEPT * g.known[k] if g.has_process != 0 and g.has_physics != 0 else 0.0
                most = KEPT * g.bound[k]
        if not (abs(m.known[i]) <= known and abs(m.correction[i]) <= most and abs(m.optimum[i]) <= most + known):
            return False
    return True


@printed
def finish(c: Compensation, m: Memory, w: Room, out: Row) -> None:
    """From m.optimum to a command that the vehicle can make (LIMITED where it is another), and what is remembered.

    Nothing is, behind a command that was limited, or an optimum that is none.
    """
    g = c.gate
    for i in range(len(w.std)):
        w.std[i] = 0.0
    if g.has_process != 0:
        for i in range(6):
            w.xi[i] = w.wrench[i] + m.optimum[i]
        process_std(c.process, g, w)
    pass_gate(g, w.std, m, w.wrench, out)
    if nearest(c.reach, w.reach, out[COMMAND:]):
        out[LIMITED] = 1.0
    if g.has_physics != 0:
        for i in range(6):
            w.told[i] = out[COMMAND + i]
        physics_sent(c.sent, w.told, m.actuators)
        m.fresh[0] = 0.0
    m.stage[0] = m.stage[0] if m.stage[0] > 1 else 1
    for i in range(6):
        m.sent[i] = out[COMMAND + i]
    if out[LIMITED] != 0.0 or not math.isfinite(out[COST]):
        forget(m)


@printed
def refuse(m: Memory, w: Room, out: Row) -> None:
    """The result of a period whose state is none that a flight can have: the desired wrench, no correction."""
    for i in range(6):
        out[COMMAND + i] = w.wrench[i]
        out[CORRECTED + i] = 0.0
        out[FOUND + i] = 0.0
    out[SIGMA] = 0.0
    out[BETA] = 1.0
    out[COST] = math.nan
    out[EVALUATIONS] = 0.0
    out[ACCEPTED] = 0.0
    forget(m)


@printed
def period(c: Compensation, m: Memory, w: Room, wrench: Six, state: Motion, out: Row) -> int:
    """One period, from the desired wrench to a row of results."""
    for i in range(6):
        w.wrench[i] = wrench[i]
    out[LIMITED] = 1.0 if nearest(c.reach, w.reach, w.wrench) else 0.0
    if not plausible(c.gate.looked, state):
        refuse(m, w, out)
        return REFUSED
    prepare(c, m, w, state)
    if search(c, m, w, out) == HANDED_BACK:
        return HANDED_BACK
    finish(c, m, w, out)
    return DONE


# -- the momentum observer (`compensate.observer` has the equations) --


@printed
def torque_made(o: Observer, s: Observed, axis: int) -> float:
    """The torque about an axis that the vehicle is taken to make now, late and with a lag, of those asked for [Nm]."""
    sent = (1.0 - o.late_part) * s.asked[o.late, axis] + o.late_part * s.asked[o.late + 1, axis]
    made = sent
    if s.following[0] != 0:
        made = o.follow_a[axis] * s.made[axis] + o.follow_b0[axis] * s.sent_before[axis] + o.follow_b1[axis] * sent
    s.sent_before[axis] = sent
    s.made[axis] = made
    return made


@printed
def observe(o: Observer, s: Observed, omega: Three) -> None:
    """The estimate from the body rates [rad/s]: d_hat = k [L - integral (H(M_asked) - omega x L + d_hat) dt], bounded.

    Where the change of the rates asks for a torque beyond `jump`, no vehicle turns like that: the estimate is held.
    """
    for i in range(3):
        s.momentum[i] = 0.0
        for j in range(3):
            s.momentum[i] += o.inertia[i, j] * omega[j]
    if s.watching[0] != 0:
        motion = True
        for i in range(3):
            j = (i + 1) % 3
            k = (i + 2) % 3
            turning = omega[j] * s.momentum[k] - omega[k] * s.momentum[j]
            change = o.dt * (torque_made(o, s, i) - turning + s.estimate[i])
            s.found[i] = o.gain * (s.momentum[i] - s.integral[i] - change)
            torque = s.estimate[i] + (s.found[i] - s.estimate[i]) / (o.gain * o.dt)
            motion = motion and abs(torque) <= o.jump[i]
        s.following[0] = 1
        if not motion:
            s.watching[0] = 0
            s.following[0] = 0
            return
        for i in range(3):
            s.estimate[i] = clipped(s.found[i], -o.torque_max[i], o.torque_max[i])
    for i in range(3):
        s.integral[i] = s.momentum[i] - s.estimate[i] / o.gain  # beyond the bounds it would wind up
    s.watching[0] = 1


@printed
def remember_asked(s: Observed, torque: Three) -> None:
    """Remember the torque that the vehicle is to make; the first counts for all before it."""
    for k in range(len(s.asked) - 1, -1, -1):
        for i in range(3):
            s.asked[k, i] = s.asked[k - 1, i] if k > 0 and s.asking[0] != 0 else torque[i]
    s.asking[0] = 1


@printed
def stop_watching(s: Observed) -> None:
    """What the vehicle does in this period is not known: the estimate stays, and nothing else is remembered."""
    s.watching[0] = 0
    s.asking[0] = 0
    s.following[0] = 0


@printed
def take_back(r: ReachTable, w: ReachRoom, s: Observed, wanted: Six, command: Six, correction: Six) -> None:
    """Take from the estimate what the vehicle could not make of it, for a demand that it can make; at most all of it.

    An estimate that was held as it is would make every demand unreachable for ever.
    """
    for i in range(6):
        w.shares[i] = wanted[i] / r.authority[i]
    if not inside(r, w.shares, w.x):
        return
    for i in range(3):
        left = wanted[3 + i] + correction[3 + i] - command[3 + i]
        if s.estimate[i] >= 0.0:
            s.estimate[i] = clipped(left, 0.0, s.estimate[i])
        else:
            s.estimate[i] = clipped(left, s.estimate[i], 0.0)


@printed
def estimate_kept(o: Observer, s: Observed) -> bool:
    """Whether the estimate is within its bounds, as `observe` leaves it."""
    for i in range(3):
        if not abs(s.estimate[i]) <= o.torque_max[i]:
            return False
    return True


# -- for Python alone --


@kernel
def _advance(
    e: Everything, flat: Array, before: Array, wrenches: Array, states: Array, out: Array, expects: bool
) -> int:
    c, m, w = e.compensation, e.memory, e.room
    count = len(w.r)
    for k in range(len(wrenches)):
        for i in range(len(flat)):
            before[i] = flat[i]
        said = period(c, m, w, wrenches[k], states[k], out[k])
        if said == HANDED_BACK:
            for i in range(len(flat)):
                flat[i] = before[i]
            return k
        for i in range(EXPECTED, out.shape[1]):
            out[k, i] = 0.0
        if expects and said == DONE:
            mismatch(c, w, w.wrench, out[k, EXPECTED : EXPECTED + count])
            mismatch(c, w, out[k, :6], out[k, EXPECTED + count :])
    return len(wrenches)


@opening
def advance(numbers: Array, counts: Ints, wrenches: Array, states: Array, out: Array, expects: bool) -> int:
    """Steps through wrenches (K, 6) with states (K, 15) until the end, or one that is handed back; how many are done.

    `numbers` and `counts` are a `tables.packed` compensation. `out` (K, 24 + 2 L) has the results, with the mismatch
    expected of the desired wrench, as far as the vehicle can make it, and of the sent command where `expects`. What is
    remembered is as it was before a step that is handed back.
    """
    everything, flat, before = opened(numbers, counts)
    return _advance(everything, flat, before, wrenches, states, out, expects)


@kernel
def begin(c: Compensation, m: Memory, w: Room, wrench: Array, state: Array) -> bool:
    """`prepare` for a step whose optimum is to be found elsewhere; whether its demand was limited."""
    for i in range(6):
        w.wrench[i] = wrench[i]
    limited = nearest(c.reach, w.reach, w.wrench)
    prepare(c, m, w, state)
    return limited


@kernel
def end(c: Compensation, m: Memory, w: Room, out: Array, expects: bool) -> None:
    """`finish` of that step."""
    count = len(w.r)
    finish(c, m, w, out)
    if expects:
        mismatch(c, w, w.wrench, out[EXPECTED : EXPECTED + count])
        mismatch(c, w, out[:6], out[EXPECTED + count :])


@kernel
def linearise(c: Compensation, w: Room, x: Array, process: bool) -> None:
    """R and dr/dx at a correction x (L,), in w.r and w.A."""
    residual(c, w, x, process)
    add_process_slope(c, w, process)


@kernel
def is_inside(r: ReachTable, w: ReachRoom, wrench: Array) -> bool:
    """Whether the vehicle makes a wrench (6,) [N, Nm] with no limit met."""
    for i in range(6):
        w.shares[i] = wrench[i] / r.authority[i]
    return inside(r, w.shares, w.x)
