/* Printed from compensate/kernels.py of wrenchgap (`make generated`); not to be edited. */

enum {
    WG_ROUNDS = 100,
    WG_PULLS = 30,
    WG_PROPOSED = 0,
    WG_STATIONARY = 1,
    WG_SINGULAR = 2,
    WG_DONE = 0,
    WG_HANDED_BACK = 1,
    WG_REFUSED = 2,
    WG_COMMAND = 0,
    WG_CORRECTED = 6,
    WG_FOUND = 12,
    WG_SIGMA = 18,
    WG_BETA = 19,
    WG_COST = 20,
    WG_EVALUATIONS = 21,
    WG_ACCEPTED = 22,
    WG_LIMITED = 23
};
#define WG_TURN WG(6.283185307179586)
#define WG_SLACK WG(1e-06)
#define WG_FAR WG(10.0)
#define WG_TURN_MIN WG(0.25)
#define WG_TURN_MAX WG(4.0)
#define WG_KEPT WG(1.001)
#define WG_ILL WG(0.001)
static const wg_real wg_state_max[15] = {WG(100000000.0), WG(100000000.0), WG(100000000.0), WG(2.0), WG(2.0), WG(2.0), WG(2.0), WG(1000.0), WG(1000.0), WG(1000.0), WG(1000.0), WG(1000.0), WG(1000.0), WG(10000000000.0), WG(10000.0)};

typedef struct {
    wg_real x[WG_LIMITS];
    wg_real z[WG_LIMITS];
    wg_real u[WG_LIMITS];
    wg_real shares[6];
    wg_real wanted[6];
    wg_real pull[6];
    wg_real between[6];
} wg_reach_room;

typedef struct {
    wg_reach_room reach;
    wg_real wrench[6];
    wg_real told[WG_STATE];
    wg_real fixed[WG_SIZE(WG_FIXED)];
    wg_real xi[WG_INPUTS];
    wg_real at[WG_INPUTS];
    wg_real values[WG_OUTPUTS][WG_SIZE(WG_POINTS)];
    wg_real sums[WG_OUTPUTS];
    wg_real white[WG_SIZE(WG_POINTS)];
    wg_real mean[WG_OUTPUTS];
    wg_real slope[WG_OUTPUTS][WG_OUTPUTS];
    wg_real command[WG_OUTPUTS];
    wg_real std[WG_OUTPUTS];
    wg_real r[WG_OUTPUTS];
    wg_real A[WG_OUTPUTS][WG_OUTPUTS];
    wg_real r_at[WG_OUTPUTS];
    wg_real A_at[WG_OUTPUTS][WG_OUTPUTS];
    wg_real H[WG_OUTPUTS][WG_OUTPUTS];
    wg_real x[WG_OUTPUTS];
    wg_real trial[WG_OUTPUTS];
    wg_real best[WG_OUTPUTS];
    wg_real start[WG_OUTPUTS];
    wg_real low[WG_OUTPUTS];
    wg_real high[WG_OUTPUTS];
    wg_real ratio;
    int evaluations;
    int hard;
} wg_room;

static void wg_physics_fixed(const wg_real *told, wg_real *fixed);

static void wg_physics_moving(const wg_real *fixed, const wg_real *command, wg_real *mean, wg_real slope[WG_OUTPUTS][WG_OUTPUTS]);

static void wg_physics_sent(const wg_real *told, wg_real *actuators);

/* The value within its limits; the lower one for what is no number. */
static wg_real wg_clipped(wg_real value, wg_real low, wg_real high)
{
    wg_real above;
    above = value >= low ? value : low;
    return above <= high ? above : high;
}

/* The larger of two numbers. */
static wg_real wg_larger(wg_real a, wg_real b)
{
    return a > b ? a : b;
}

/* Limits of arms and rotors at a wrench in shares of the authority, each in shares of itself. */
static void wg_limits(const wg_real *shares, wg_real *x)
{
    for (int g = 0; g < WG_LIMITS; g++) {
        x[g] = WG(0.0);
        for (int i = 0; i < 6; i++) {
            x[g] += wg_reach_rows[g][i] * shares[i];
        }
    }
}

/* Angle by which the thrust of an arm is off the middle of its range [rad]. */
static wg_real wg_off_middle(wg_real lateral, wg_real vertical, int arm)
{
    wg_real turned;
    turned = wg_atan2(lateral, vertical) - wg_reach_middle[arm];
    return turned - WG_TURN * wg_floor(turned / WG_TURN + WG(0.5));
}

/* Whether the vehicle makes a wrench in shares of the authority with no limit met; not so for what is no number. */
static int wg_inside(const wg_real *shares, wg_real *x)
{
    wg_real thrust;
    wg_real value;
    wg_limits(shares, x);
    for (int a = 0; a < WG_TILTING; a++) {
        thrust = wg_sqrt(x[2 * a] * x[2 * a] + x[2 * a + 1] * x[2 * a + 1]);
        if (!(thrust <= WG(1.0) + WG_SLACK)) {
            return 0;
        }
        if (thrust > wg_reach_weak[a] && wg_fabs(wg_off_middle(x[2 * a], x[2 * a + 1], a)) > wg_reach_half[a] + WG_SLACK) {
            return 0;
        }
    }
    for (int k = 0; k < WG_SINGLES; k++) {
        value = x[2 * WG_TILTING + k];
        if (!(value >= wg_reach_low[k] - WG_SLACK && value <= wg_reach_high[k] + WG_SLACK)) {
            return 0;
        }
    }
    return 1;
}

/* Put the nearest unknowns within the limits, each arm and rotor by itself, in place of x. */
static void wg_put_within(wg_real *x)
{
    wg_real off;
    wg_real edge;
    wg_real along;
    wg_real thrust;
    int place;
    for (int a = 0; a < WG_TILTING; a++) {
        off = wg_off_middle(x[2 * a], x[2 * a + 1], a);
        if (wg_fabs(off) > wg_reach_half[a]) {
            edge = wg_reach_middle[a] + (off > WG(0.0) ? wg_reach_half[a] : -wg_reach_half[a]);
            along = x[2 * a] * wg_sin(edge) + x[2 * a + 1] * wg_cos(edge);
            along = along > WG(0.0) ? along : WG(0.0);
            x[2 * a] = along * wg_sin(edge);
            x[2 * a + 1] = along * wg_cos(edge);
        }
        thrust = wg_sqrt(x[2 * a] * x[2 * a] + x[2 * a + 1] * x[2 * a + 1]);
        if (thrust > WG(1.0)) {
            x[2 * a] /= thrust;
            x[2 * a + 1] /= thrust;
        }
    }
    for (int k = 0; k < WG_SINGLES; k++) {
        place = 2 * WG_TILTING + k;
        x[place] = wg_clipped(x[place], wg_reach_low[k], wg_reach_high[k]);
    }
}

/* Put the nearest wrench that the vehicle can make in place of one of numbers; whether it is another one. */
static int wg_nearest(wg_reach_room *w, wg_real *wrench)
{
    wg_real least;
    wg_real most;
    wg_real middle;
    for (int i = 0; i < 6; i++) {
        w->shares[i] = wrench[i] / wg_reach_authority[i];
    }
    if (WG_SINGLES == 0 || wg_inside(w->shares, w->x)) {
        return 0;
    }
    for (int i = 0; i < 6; i++) {
        w->wanted[i] = wg_clipped(w->shares[i], -WG_FAR, WG_FAR);
        w->shares[i] = w->wanted[i];
    }
    for (int g = 0; g < WG_LIMITS; g++) {
        w->u[g] = WG(0.0);
    }
    for (int turn = 0; turn < WG_ROUNDS; turn++) {
        wg_limits(w->shares, w->x);
        for (int g = 0; g < WG_LIMITS; g++) {
            w->z[g] = w->x[g] + w->u[g];
        }
        wg_put_within(w->z);
        for (int i = 0; i < 6; i++) {
            w->pull[i] = w->wanted[i];
        }
        for (int g = 0; g < WG_LIMITS; g++) {
            w->u[g] += w->x[g] - w->z[g];
            for (int i = 0; i < 6; i++) {
                w->pull[i] += wg_reach_rows[g][i] * (w->z[g] - w->u[g]);
            }
        }
        for (int i = 0; i < 6; i++) {
            w->shares[i] = WG(0.0);
            for (int j = 0; j < 6; j++) {
                w->shares[i] += wg_reach_solve[i][j] * w->pull[j];
            }
        }
    }
    least = WG(0.0);
    if (wg_inside(w->shares, w->x)) {
        least = WG(1.0);
    } else {
        most = WG(1.0);
        for (int turn = 0; turn < WG_PULLS; turn++) {
            middle = WG(0.5) * (least + most);
            for (int i = 0; i < 6; i++) {
                w->between[i] = wg_reach_hover[i] + middle * (w->shares[i] - wg_reach_hover[i]);
            }
            if (wg_inside(w->between, w->x)) {
                least = middle;
            } else {
                most = middle;
            }
        }
    }
    for (int i = 0; i < 6; i++) {
        wrench[i] = wg_reach_authority[i] * (wg_reach_hover[i] + least * (w->shares[i] - wg_reach_hover[i]));
    }
    return 1;
}

/* Whether the numbers of a state that are looked at are such as a flight can have. */
static int wg_plausible(const int *looked, const wg_real *state)
{
    wg_real square;
    for (int i = 0; i < 15; i++) {
        if (looked[i] != 0 && !(wg_fabs(state[i]) <= wg_state_max[i])) {
            return 0;
        }
    }
    if (looked[3] != 0) {
        square = state[3] * state[3] + state[4] * state[4] + state[5] * state[5] + state[6] * state[6];
        return square >= WG_TURN_MIN && square <= WG_TURN_MAX;
    }
    return 1;
}

/* Sum of the products of count numbers, in any order. */
static wg_real wg_dot(const wg_real *a, const wg_real *b, int count)
{
    wg_real total;
    total = WG(0.0);
    for (int n = 0; n < count; n++) {
        total += a[n] * b[n];
    }
    return total;
}

/* exp(-row / 2) in place of a row. */
static void wg_gaussians(wg_real *row)
{
    for (int n = 0; n < WG_POINTS; n++) {
        row[n] = wg_exp(-WG(0.5) * row[n]);
    }
}

/* Input d over the lengthscale of output k. */
static wg_real wg_scaled(wg_real xi, int k, int d)
{
    return (xi - wg_process_input_mean[d]) / wg_process_input_scale[d] / wg_process_lengthscales[k][d];
}

/* exp(-1/2 |q - p_n|^2) at the inputs w.xi, in w.values (L, N), with their weighted sums. */
static void wg_evaluate_kernel(wg_room *w)
{
    int same;
    wg_real *row;
    wg_real q;
    const wg_real *column;
    wg_real apart;
    same = 1;
    for (int d = 0; d < WG_INPUTS; d++) {
        same = same && w->at[d] == w->xi[d];
    }
    if (same) {
        return;
    }
    for (int k = 0; k < WG_OUTPUTS; k++) {
        row = w->values[k];
        for (int n = 0; n < WG_POINTS; n++) {
            row[n] = WG(0.0);
        }
        for (int d = 0; d < WG_INPUTS; d++) {
            q = wg_scaled(w->xi[d], k, d);
            column = wg_process_points[k][d];
            for (int n = 0; n < WG_POINTS; n++) {
                apart = column[n] - q;
                row[n] += apart * apart;
            }
        }
        wg_gaussians(row);
        w->sums[k] = wg_dot(row, wg_process_alpha[k], WG_POINTS);
    }
    for (int d = 0; d < WG_INPUTS; d++) {
        w->at[d] = w->xi[d];
    }
}

/* Mean (L,) of the process at the inputs w.xi. */
static void wg_process_mean(wg_room *w, wg_real *mean)
{
    wg_real total;
    wg_evaluate_kernel(w);
    for (int k = 0; k < WG_OUTPUTS; k++) {
        total = wg_process_coefficients[k][0];
        for (int d = 0; d < WG_INPUTS; d++) {
            total += wg_process_coefficients[k][d + 1] * ((w->xi[d] - wg_process_input_mean[d]) / wg_process_input_scale[d]);
        }
        mean[k] = wg_process_output_scale[k] * (total + wg_process_signal[k] * w->sums[k]);
    }
}

/* Derivative of the mean at the inputs w.xi, at which it was asked for, to the corrected components (L, L). */
static void wg_process_slope(wg_room *w, wg_real slope[WG_OUTPUTS][WG_OUTPUTS])
{
    wg_real *row;
    int d;
    wg_real part;
    for (int k = 0; k < WG_OUTPUTS; k++) {
        row = w->values[k];
        for (int n = 0; n < WG_POINTS; n++) {
            w->white[n] = row[n] * wg_process_alpha[k][n];
        }
        for (int i = 0; i < WG_OUTPUTS; i++) {
            d = wg_rows[i];
            part = (wg_dot(w->white, wg_process_points[k][d], WG_POINTS) - wg_scaled(w->xi[d], k, d) * w->sums[k]) / wg_process_lengthscales[k][d];
            slope[k][i] = wg_process_output_scale[k] / wg_process_input_scale[d] * (wg_process_coefficients[k][d + 1] + wg_process_signal[k] * part);
        }
    }
}

/* Standard deviations (L,) of the watched outputs at the inputs w.xi, noise included, in w.std. */
static void wg_process_std(wg_room *w)
{
    wg_real *row;
    int place;
    int count;
    wg_real variance;
    wg_evaluate_kernel(w);
    for (int k = 0; k < WG_OUTPUTS; k++) {
        if (wg_watched[k] != 0) {
            row = w->values[k];
            place = 0;
            for (int n = 0; n < WG_POINTS; n++) {
                count = WG_PROCESS_TRIANGULAR != 0 ? n + 1 : WG_POINTS;
                w->white[n] = wg_dot(wg_process_whitener[k] + place, row, count);
                place += count;
            }
            variance = wg_process_signal[k] - wg_process_signal[k] * wg_process_signal[k] * wg_dot(w->white, w->white, WG_POINTS);
            if (variance <= WG(0.0)) {
                variance = WG(0.0);
            }
            w->std[k] = wg_process_output_scale[k] * wg_process_sigma_scale[k] * wg_sqrt(variance + wg_process_noise[k]);
        }
    }
}

/* |r|^2 at a correction x (L,) of w.wrench, r in w.r, and dr/dx in w.A but for the slope of the process. */
static wg_real wg_residual(wg_room *w, const wg_real *x, int process)
{
    wg_real cost;
    w->evaluations += 1;
    for (int i = 0; i < WG_OUTPUTS; i++) {
        w->r[i] = x[i];
        w->command[i] = w->wrench[wg_rows[i]] + x[i];
        for (int j = 0; j < WG_OUTPUTS; j++) {
            w->A[i][j] = i == j ? WG(1.0) : WG(0.0);
        }
    }
    if (process) {
        for (int d = 0; d < 6; d++) {
            w->xi[d] = w->wrench[d];
        }
        for (int i = 0; i < WG_OUTPUTS; i++) {
            w->xi[wg_rows[i]] = w->command[i];
        }
        wg_process_mean(w, w->mean);
        for (int i = 0; i < WG_OUTPUTS; i++) {
            w->r[i] += w->mean[i];
        }
    }
    if (WG_HAS_PHYSICS != 0) {
        wg_physics_moving(w->fixed, w->command, w->mean, w->slope);
        for (int i = 0; i < WG_OUTPUTS; i++) {
            w->r[i] += w->mean[i];
            for (int j = 0; j < WG_OUTPUTS; j++) {
                w->A[i][j] += w->slope[i][j];
            }
        }
    }
    cost = WG(0.0);
    for (int i = 0; i < WG_OUTPUTS; i++) {
        cost += w->r[i] * w->r[i];
    }
    return cost;
}

/* Complete dr/dx in w.A at the point of the last residual; the last point of a search needs none. */
static void wg_add_process_slope(wg_room *w, int process)
{
    if (process) {
        wg_process_slope(w, w->slope);
        for (int i = 0; i < WG_OUTPUTS; i++) {
            for (int j = 0; j < WG_OUTPUTS; j++) {
                w->A[i][j] += w->slope[i][j];
            }
        }
    }
}

/* A^T A + damping I in w.H (its lower half), A^T r in w.trial, at w.x; components that a bound holds are fixed. A bound
 * holds a component that the cost pushes against it (projected Newton, Bertsekas 1982). Returns the largest diagonal
 * number of A^T A, or 0 where nothing is left to move. */
static wg_real wg_normal_equations(wg_room *w, wg_real damping)
{
    int count;
    wg_real largest;
    int moving;
    count = WG_OUTPUTS;
    largest = WG(0.0);
    for (int i = 0; i < count; i++) {
        w->trial[i] = WG(0.0);
        for (int k = 0; k < count; k++) {
            w->trial[i] += w->A_at[k][i] * w->r_at[k];
        }
        for (int j = 0; j < i + 1; j++) {
            w->H[i][j] = WG(0.0);
            for (int k = 0; k < count; k++) {
                w->H[i][j] += w->A_at[k][i] * w->A_at[k][j];
            }
        }
        largest = w->H[i][i] > largest ? w->H[i][i] : largest;
    }
    moving = 0;
    for (int i = 0; i < count; i++) {
        if ((w->x[i] <= w->low[i] && w->trial[i] > WG(0.0)) || (w->x[i] >= w->high[i] && w->trial[i] < WG(0.0))) {
            for (int j = 0; j < i; j++) {
                w->H[i][j] = WG(0.0);
            }
            for (int j = i + 1; j < count; j++) {
                w->H[j][i] = WG(0.0);
            }
            w->H[i][i] = largest;
            w->trial[i] = WG(0.0);
        } else if (w->trial[i] < WG(0.0) || w->trial[i] > WG(0.0)) {
            moving += 1;
        }
        w->H[i][i] += damping;
    }
    return moving > 0 ? largest : WG(0.0);
}

/* The next point of the search, in w.trial, from r and A at w.x: Newton's step where it is not held or damped. (A^T A +
 * damping I) p = -A^T r (Levenberg and Marquardt; Nocedal and Wright, "Numerical Optimization", 2nd ed., 10.3), by
 * Cholesky's factors in place. w.ratio is that of the least pivot to the largest number. */
static int wg_propose(wg_room *w, wg_real damping)
{
    int count;
    wg_real largest;
    wg_real least;
    wg_real total;
    count = WG_OUTPUTS;
    largest = wg_normal_equations(w, damping) + damping;
    if (largest == damping) {
        return WG_STATIONARY;
    }
    least = largest;
    for (int i = 0; i < count; i++) {
        for (int j = 0; j < i + 1; j++) {
            total = w->H[i][j];
            for (int k = 0; k < j; k++) {
                total -= w->H[i][k] * w->H[j][k];
            }
            if (i == j) {
                least = total < least ? total : least;
                if (!(total > WG_PIVOT * largest)) {
                    return WG_SINGULAR;
                }
                w->H[i][i] = wg_sqrt(total);
            } else {
                w->H[i][j] = total / w->H[j][j];
            }
        }
    }
    for (int i = 0; i < count; i++) {
        for (int k = 0; k < i; k++) {
            w->trial[i] -= w->H[i][k] * w->trial[k];
        }
        w->trial[i] /= w->H[i][i];
    }
    for (int i = count - 1; i > -1; i--) {
        for (int k = i + 1; k < count; k++) {
            w->trial[i] -= w->H[k][i] * w->trial[k];
        }
        w->trial[i] /= w->H[i][i];
    }
    w->ratio = least / largest;
    for (int i = 0; i < count; i++) {
        w->trial[i] = wg_clipped(w->x[i] - w->trial[i], w->low[i], w->high[i]);
    }
    return WG_PROPOSED;
}

/* Whether a proposal is the point that it starts from, to rounding. */
static int wg_standing_still(const wg_room *w)
{
    wg_real moved;
    wg_real size;
    wg_real apart;
    moved = WG(0.0);
    size = WG(0.0);
    for (int i = 0; i < WG_OUTPUTS; i++) {
        apart = wg_fabs(w->trial[i] - w->x[i]);
        moved = apart > moved ? apart : moved;
        size = wg_fabs(w->x[i]) > size ? wg_fabs(w->x[i]) : size;
    }
    return moved <= WG_STILL * size;
}

/* Search from w.start within the box of w.low and w.high; the best point in w.x, its cost is returned. Newton's step is
 * taken where it lowers the cost; else it is damped more and more. w.hard says whether A was ill-conditioned on the
 * way. */
static wg_real wg_newton(wg_room *w, int process)
{
    int count;
    wg_real cost;
    int used;
    wg_real damping;
    int fresh;
    wg_real trace;
    int said;
    wg_real after;
    int stalled;
    count = WG_OUTPUTS;
    for (int i = 0; i < count; i++) {
        w->x[i] = wg_clipped(w->start[i], w->low[i], w->high[i]);
    }
    cost = wg_residual(w, w->x, process);
    used = 1;
    damping = WG(0.0);
    fresh = 1;
    for (int turn = 0; turn < 2 * WG_MOST; turn++) {
        if (used >= WG_MOST || !(cost > WG_ENOUGH)) {
            break;
        }
        if (fresh) {
            wg_add_process_slope(w, process);
            for (int i = 0; i < count; i++) {
                w->r_at[i] = w->r[i];
                for (int j = 0; j < count; j++) {
                    w->A_at[i][j] = w->A[i][j];
                }
            }
            fresh = 0;
        }
        trace = WG(0.0);
        for (int i = 0; i < count; i++) {
            for (int j = 0; j < count; j++) {
                trace += w->A_at[i][j] * w->A_at[i][j];
            }
        }
        said = wg_propose(w, damping);
        if (said == WG_STATIONARY || !isfinite(trace)) {
            break;
        }
        if (said == WG_SINGULAR) {
            w->hard = 1;
            damping = wg_larger(WG(10.0) * damping, WG(1e-06) * trace);
            continue;
        }
        if (damping == WG(0.0) && w->ratio < WG_ILL) {
            w->hard = 1;
        }
        if (wg_standing_still(w)) {
            break;
        }
        after = wg_residual(w, w->trial, process);
        used += 1;
        if (after < cost) {
            stalled = cost - after <= WG_STALLED * cost;
            cost = after;
            damping = damping > WG(1e-09) * trace ? WG(0.1) * damping : WG(0.0);
            for (int i = 0; i < count; i++) {
                w->x[i] = w->trial[i];
            }
            if (stalled) {
                break;
            }
            fresh = 1;
        } else {
            damping = wg_larger(WG(10.0) * damping, WG(0.0001) * trace);
        }
    }
    return cost;
}

/* From w.start, else from zero, else no correction: the better, in w.best; its cost is returned. */
static wg_real wg_solve(wg_room *w, int process)
{
    int count;
    int elsewhere;
    wg_real cost;
    int hard;
    wg_real other;
    wg_real nothing;
    count = WG_OUTPUTS;
    elsewhere = 0;
    for (int i = 0; i < count; i++) {
        elsewhere = elsewhere || w->start[i] < WG(0.0) || w->start[i] > WG(0.0);
    }
    w->hard = 0;
    cost = wg_newton(w, process);
    hard = w->hard;
    for (int i = 0; i < count; i++) {
        w->best[i] = w->x[i];
        w->start[i] = WG(0.0);
    }
    if (!(cost < WG_ACCEPT) && elsewhere) {
        other = wg_newton(w, process);
        if (other < cost || !isfinite(cost)) {
            cost = other;
            for (int i = 0; i < count; i++) {
                w->best[i] = w->x[i];
            }
        }
    }
    w->hard = hard;
    if (!(cost < WG_ACCEPT)) {
        nothing = wg_residual(w, w->start, process);
        if (!(cost < nothing)) {
            cost = nothing;
            for (int i = 0; i < count; i++) {
                w->best[i] = WG(0.0);
            }
        }
    }
    return cost;
}

/* Inputs of the process beyond the command (plant.mismatch_inputs); the lag of the past goes on. */
static void wg_set_further_inputs(wg_memory *m, wg_room *w, const wg_real *state)
{
    wg_real x;
    wg_real y;
    wg_real z;
    wg_real a;
    wg_real b;
    wg_real t;
    wg_real late;
    if (WG_VELOCITY_AT >= 0) {
        x = -state[4];
        y = -state[5];
        z = -state[6];
        a = WG(2.0) * (y * state[9] - z * state[8]);
        b = WG(2.0) * (z * state[7] - x * state[9]);
        t = WG(2.0) * (x * state[8] - y * state[7]);
        w->xi[WG_VELOCITY_AT] = state[7] + state[3] * a + (y * t - z * b);
        w->xi[WG_VELOCITY_AT + 1] = state[8] + state[3] * b + (z * a - x * t);
        w->xi[WG_VELOCITY_AT + 2] = state[9] + state[3] * t + (x * b - y * a);
    }
    if (WG_RATES_AT >= 0) {
        for (int i = 0; i < 3; i++) {
            w->xi[WG_RATES_AT + i] = state[10 + i];
        }
    }
    if (WG_POSITION_AT >= 0) {
        for (int i = 0; i < 3; i++) {
            w->xi[WG_POSITION_AT + i] = state[i];
        }
    }
    if (WG_PAST_AT >= 0) {
        for (int i = 0; i < 6; i++) {
            late = m->sent[i];
            if (m->stage >= 2) {
                late = WG_LAG_A * m->lag_out[i] + WG_LAG_B0 * m->lag_in[i] + WG_LAG_B1 * m->sent[i];
            }
            w->xi[WG_PAST_AT + i] = m->sent[i] - late;
            m->lag_in[i] = m->sent[i];
            m->lag_out[i] = late;
        }
        if (m->stage == 1) {
            m->stage = 2;
        }
    }
}

/* Work out what no correction of w.wrench changes in this state. */
static void wg_prepare(wg_memory *m, wg_room *w, const wg_real *state)
{
    w->evaluations = 0;
    w->at[0] = WG_NAN;
    if (WG_HAS_PHYSICS != 0) {
        for (int i = 0; i < 6; i++) {
            w->told[i] = w->wrench[i];
        }
        for (int i = 0; i < 15; i++) {
            w->told[6 + i] = state[i];
        }
        w->told[21] = m->fresh;
        for (int i = 0; i < WG_ACTUATORS; i++) {
            w->told[22 + i] = m->actuators[i];
        }
        wg_physics_fixed(w->told, w->fixed);
    }
    if (WG_HAS_PROCESS != 0) {
        wg_set_further_inputs(m, w, state);
    }
}

/* Corrections of the physics alone, about which the bounds of the process lie, and of both. */
static int wg_search(wg_memory *m, wg_room *w, wg_real *out)
{
    wg_real alone;
    wg_real value;
    wg_real cost;
    for (int i = 0; i < WG_OUTPUTS; i++) {
        w->low[i] = -wg_bound[i];
        w->high[i] = wg_bound[i];
    }
    if (WG_HAS_PROCESS != 0 && WG_HAS_PHYSICS != 0) {
        for (int i = 0; i < WG_OUTPUTS; i++) {
            w->low[i] = -wg_known[i];
            w->high[i] = wg_known[i];
            w->start[i] = m->known[wg_rows[i]];
        }
        alone = wg_solve(w, 0);
        if (WG_LENIENT == 0 && (w->hard != 0 || !(alone < WG_ACCEPT))) {
            return WG_HANDED_BACK;
        }
        for (int i = 0; i < WG_OUTPUTS; i++) {
            value = isfinite(alone) ? w->best[i] : WG(0.0);
            m->known[wg_rows[i]] = value;
            w->low[i] = value - wg_bound[i];
            w->high[i] = value + wg_bound[i];
        }
    }
    for (int i = 0; i < WG_OUTPUTS; i++) {
        w->start[i] = m->optimum[wg_rows[i]];
    }
    cost = wg_solve(w, WG_HAS_PROCESS != 0);
    if (WG_LENIENT == 0 && (w->hard != 0 || !(cost < WG_ACCEPT))) {
        return WG_HANDED_BACK;
    }
    for (int i = 0; i < WG_OUTPUTS; i++) {
        m->optimum[wg_rows[i]] = isfinite(cost) ? w->best[i] : WG(0.0);
    }
    out[WG_COST] = cost;
    out[WG_EVALUATIONS] = w->evaluations;
    out[WG_ACCEPTED] = cost < WG_ACCEPT ? WG(1.0) : WG(0.0);
    return WG_DONE;
}

/* sigma, beta and the correction that the gate lets through (compensate.uncertainty), from m.optimum. */
static void wg_pass_gate(const wg_real *std, wg_memory *m, const wg_real *wrench, wg_real *out)
{
    wg_real sigma;
    wg_real normal;
    wg_real beta;
    sigma = -WG_INFINITY;
    for (int i = 0; i < WG_OUTPUTS; i++) {
        if (wg_watched[i] != 0) {
            normal = (std[i] - wg_offset[i]) / wg_scale[i];
            if (!(normal <= sigma || isnan(sigma))) {
                sigma = normal;
            }
        }
    }
    beta = isinf(WG_THRESHOLD) ? WG(0.0) : WG(1.0) / (WG(1.0) + wg_exp(-WG_KAPPA * (sigma - WG_THRESHOLD)));
    if (!isfinite(sigma)) {
        beta = WG(1.0);
    }
    for (int i = 0; i < 6; i++) {
        m->correction[i] = WG_DECAY * beta * m->correction[i] + (WG(1.0) - beta) * (m->optimum[i] - m->known[i]);
        out[WG_FOUND + i] = m->optimum[i];
        out[WG_CORRECTED + i] = m->known[i] + m->correction[i];
        out[WG_COMMAND + i] = wrench[i] + out[WG_CORRECTED + i];
    }
    out[WG_SIGMA] = sigma;
    out[WG_BETA] = beta;
}

/* Mismatch (L,) of a command as the models have it in this period. */
static void wg_mismatch(wg_room *w, const wg_real *wrench, wg_real *found)
{
    for (int i = 0; i < WG_OUTPUTS; i++) {
        found[i] = WG(0.0);
        w->command[i] = wrench[wg_rows[i]];
    }
    for (int i = 0; i < 6; i++) {
        w->told[i] = wrench[i];
    }
    if (WG_HAS_PROCESS != 0) {
        for (int i = 0; i < 6; i++) {
            w->xi[i] = wrench[i];
        }
        wg_process_mean(w, found);
    }
    if (WG_HAS_PHYSICS != 0) {
        wg_physics_fixed(w->told, w->fixed);
        wg_physics_moving(w->fixed, w->command, w->mean, w->slope);
        for (int i = 0; i < WG_OUTPUTS; i++) {
            found[i] += w->mean[i];
        }
    }
}

/* Forget all: before the first step, and behind a period that is none, or whose demand the vehicle cannot make. */
static void wg_forget(wg_memory *m)
{
    for (int i = 0; i < 6; i++) {
        m->optimum[i] = WG(0.0);
        m->correction[i] = WG(0.0);
        m->known[i] = WG(0.0);
        m->sent[i] = WG(0.0);
        m->lag_in[i] = WG(0.0);
        m->lag_out[i] = WG(0.0);
    }
    for (int i = 0; i < WG_ACTUATORS; i++) {
        m->actuators[i] = WG(0.0);
    }
    m->stage = 0;
    m->fresh = WG(1.0);
}

/* Whether the corrections that are remembered are within their bounds, none on an axis that has no output. A step
 * leaves them so; where they are not, somebody else wrote to the memory, or it was never reset. */
static int wg_kept(const wg_memory *m)
{
    wg_real known;
    wg_real most;
    for (int i = 0; i < 6; i++) {
        known = WG(0.0);
        most = WG(0.0);
        for (int k = 0; k < WG_OUTPUTS; k++) {
            if (wg_rows[k] == i) {
                known = WG_HAS_PROCESS != 0 && WG_HAS_PHYSICS != 0 ? WG_KEPT * wg_known[k] : WG(0.0);
                most = WG_KEPT * wg_bound[k];
            }
        }
        if (!(wg_fabs(m->known[i]) <= known && wg_fabs(m->correction[i]) <= most && wg_fabs(m->optimum[i]) <= most + known)) {
            return 0;
        }
    }
    return 1;
}

/* From m.optimum to a command that the vehicle can make (LIMITED where it is another), and what is remembered. Nothing
 * is, behind a command that was limited, or an optimum that is none. */
static void wg_finish(wg_memory *m, wg_room *w, wg_real *out)
{
    for (int i = 0; i < WG_OUTPUTS; i++) {
        w->std[i] = WG(0.0);
    }
    if (WG_HAS_PROCESS != 0) {
        for (int i = 0; i < 6; i++) {
            w->xi[i] = w->wrench[i] + m->optimum[i];
        }
        wg_process_std(w);
    }
    wg_pass_gate(w->std, m, w->wrench, out);
    if (wg_nearest(&w->reach, out + WG_COMMAND)) {
        out[WG_LIMITED] = WG(1.0);
    }
    if (WG_HAS_PHYSICS != 0) {
        for (int i = 0; i < 6; i++) {
            w->told[i] = out[WG_COMMAND + i];
        }
        wg_physics_sent(w->told, m->actuators);
        m->fresh = WG(0.0);
    }
    m->stage = m->stage > 1 ? m->stage : 1;
    for (int i = 0; i < 6; i++) {
        m->sent[i] = out[WG_COMMAND + i];
    }
    if (out[WG_LIMITED] != WG(0.0) || !isfinite(out[WG_COST])) {
        wg_forget(m);
    }
}

/* The result of a period whose state is none that a flight can have: the desired wrench, no correction. */
static void wg_refuse(wg_memory *m, const wg_room *w, wg_real *out)
{
    for (int i = 0; i < 6; i++) {
        out[WG_COMMAND + i] = w->wrench[i];
        out[WG_CORRECTED + i] = WG(0.0);
        out[WG_FOUND + i] = WG(0.0);
    }
    out[WG_SIGMA] = WG(0.0);
    out[WG_BETA] = WG(1.0);
    out[WG_COST] = WG_NAN;
    out[WG_EVALUATIONS] = WG(0.0);
    out[WG_ACCEPTED] = WG(0.0);
    wg_forget(m);
}

/* One period, from the desired wrench to a row of results. */
static int wg_period(wg_memory *m, wg_room *w, const wg_real *wrench, const wg_real *state, wg_real *out)
{
    for (int i = 0; i < 6; i++) {
        w->wrench[i] = wrench[i];
    }
    out[WG_LIMITED] = wg_nearest(&w->reach, w->wrench) ? WG(1.0) : WG(0.0);
    if (!wg_plausible(wg_looked, state)) {
        wg_refuse(m, w, out);
        return WG_REFUSED;
    }
    wg_prepare(m, w, state);
    if (wg_search(m, w, out) == WG_HANDED_BACK) {
        return WG_HANDED_BACK;
    }
    wg_finish(m, w, out);
    return WG_DONE;
}

#if WG_OBSERVER

/* The torque about an axis that the vehicle is taken to make now, late and with a lag, of those asked for [Nm]. */
static wg_real wg_torque_made(wg_memory *s, int axis)
{
    wg_real sent;
    wg_real made;
    sent = (WG(1.0) - WG_OBSERVER_LATE_PART) * s->asked[WG_OBSERVER_LATE][axis] + WG_OBSERVER_LATE_PART * s->asked[WG_OBSERVER_LATE + 1][axis];
    made = sent;
    if (s->following != 0) {
        made = wg_observer_follow_a[axis] * s->made[axis] + wg_observer_follow_b0[axis] * s->sent_before[axis] + wg_observer_follow_b1[axis] * sent;
    }
    s->sent_before[axis] = sent;
    s->made[axis] = made;
    return made;
}

/* The estimate from the body rates [rad/s]: d_hat = k [L - integral (H(M_asked) - omega x L + d_hat) dt], bounded.
 * Where the change of the rates asks for a torque beyond jump, no vehicle turns like that: the estimate is held. */
static void wg_observe(wg_memory *s, const wg_real *omega)
{
    int motion;
    int j;
    int k;
    wg_real turning;
    wg_real change;
    wg_real torque;
    for (int i = 0; i < 3; i++) {
        s->momentum[i] = WG(0.0);
        for (int j = 0; j < 3; j++) {
            s->momentum[i] += wg_observer_inertia[i][j] * omega[j];
        }
    }
    if (s->watching != 0) {
        motion = 1;
        for (int i = 0; i < 3; i++) {
            j = (i + 1) % 3;
            k = (i + 2) % 3;
            turning = omega[j] * s->momentum[k] - omega[k] * s->momentum[j];
            change = WG_OBSERVER_DT * (wg_torque_made(s, i) - turning + s->estimate[i]);
            s->found[i] = WG_OBSERVER_GAIN * (s->momentum[i] - s->integral[i] - change);
            torque = s->estimate[i] + (s->found[i] - s->estimate[i]) / (WG_OBSERVER_GAIN * WG_OBSERVER_DT);
            motion = motion && wg_fabs(torque) <= wg_observer_jump[i];
        }
        s->following = 1;
        if (!motion) {
            s->watching = 0;
            s->following = 0;
            return;
        }
        for (int i = 0; i < 3; i++) {
            s->estimate[i] = wg_clipped(s->found[i], -wg_observer_torque_max[i], wg_observer_torque_max[i]);
        }
    }
    for (int i = 0; i < 3; i++) {
        s->integral[i] = s->momentum[i] - s->estimate[i] / WG_OBSERVER_GAIN;
    }
    s->watching = 1;
}

/* Remember the torque that the vehicle is to make; the first counts for all before it. */
static void wg_remember_asked(wg_memory *s, const wg_real *torque)
{
    for (int k = WG_ASKED - 1; k > -1; k--) {
        for (int i = 0; i < 3; i++) {
            s->asked[k][i] = k > 0 && s->asking != 0 ? s->asked[k - 1][i] : torque[i];
        }
    }
    s->asking = 1;
}

/* What the vehicle does in this period is not known: the estimate stays, and nothing else is remembered. */
static void wg_stop_watching(wg_memory *s)
{
    s->watching = 0;
    s->asking = 0;
    s->following = 0;
}

/* Take from the estimate what the vehicle could not make of it, for a demand that it can make; at most all of it. An
 * estimate that was held as it is would make every demand unreachable for ever. */
static void wg_take_back(wg_reach_room *w, wg_memory *s, const wg_real *wanted, const wg_real *command, const wg_real *correction)
{
    wg_real left;
    for (int i = 0; i < 6; i++) {
        w->shares[i] = wanted[i] / wg_reach_authority[i];
    }
    if (!wg_inside(w->shares, w->x)) {
        return;
    }
    for (int i = 0; i < 3; i++) {
        left = wanted[3 + i] + correction[3 + i] - command[3 + i];
        if (s->estimate[i] >= WG(0.0)) {
            s->estimate[i] = wg_clipped(left, WG(0.0), s->estimate[i]);
        } else {
            s->estimate[i] = wg_clipped(left, s->estimate[i], WG(0.0));
        }
    }
}

/* Whether the estimate is within its bounds, as observe leaves it. */
static int wg_estimate_kept(const wg_memory *s)
{
    for (int i = 0; i < 3; i++) {
        if (!(wg_fabs(s->estimate[i]) <= wg_observer_torque_max[i])) {
            return 0;
        }
    }
    return 1;
}

#endif
