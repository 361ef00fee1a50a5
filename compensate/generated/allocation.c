#define WGA_TURN WGA(6.283185307179586)
#define WGA_FLOOR WGA(0.001)
#define WGA_SMALL WGA(1e-09)
#define WGA_WOUND WGA(1000.0)
#define WGA_SAME_ANGLE WGA(1e-05)
#define WGA_BLEND WGA(0.02)
#define WGA_RAMP WGA(0.25)
#define WGA_SLACK WGA(0.1)

typedef struct {
    wga_real b[WGA_RANK];
    wga_real y[WGA_RANK];
    wga_real factor[WGA_RANK][WGA_RANK];
    wga_real weight[WGA_GROUPS];
    wga_real free[WGA_GROUPS];
    wga_real wanted[6];
    wga_real u[WGA_GROUPS][2];
    wga_real best[WGA_GROUPS][2];
    wga_real less[WGA_GROUPS][2];
    wga_real whole[WGA_GROUPS][2];
} wga_room;

/* Printed from compensate/allocation_kernels.py of wrenchgap. */

/* The value within its limits; the lower one for what is no number. */
static wga_real wga_bounded(wga_real value, wga_real low, wga_real high)
{
    wga_real above;
    above = value >= low ? value : low;
    return above <= high ? above : high;
}

/* |u_g|. */
static wga_real wga_size(wga_real u[WGA_GROUPS][2], int g)
{
    return wga_sqrt(u[g][0] * u[g][0] + u[g][1] * u[g][1]);
}

/* room.u of least sum_g w_g |u_g|^2 that makes room.b, by Cholesky's method. Returns the largest |u_g|. */
static wga_real wga_weighted(wga_room *room)
{
    int rank;
    wga_real total;
    wga_real largest;
    rank = WGA_RANK;
    for (int g = 0; g < WGA_GROUPS; g++) {
        room->free[g] = WGA(1.0) / room->weight[g];
    }
    for (int i = 0; i < rank; i++) {
        for (int j = 0; j < i + 1; j++) {
            total = WGA(0.0);
            for (int g = 0; g < WGA_GROUPS; g++) {
                total += room->free[g] * (wga_along[i][g] * wga_along[j][g] + wga_across[i][g] * wga_across[j][g]);
            }
            for (int k = 0; k < j; k++) {
                total -= room->factor[i][k] * room->factor[j][k];
            }
            if (i == j) {
                room->factor[i][i] = wga_sqrt(total > WGA_SMALL ? total : WGA_SMALL);
            } else {
                room->factor[i][j] = total / room->factor[j][j];
            }
        }
    }
    for (int i = 0; i < rank; i++) {
        total = room->b[i];
        for (int k = 0; k < i; k++) {
            total -= room->factor[i][k] * room->y[k];
        }
        room->y[i] = total / room->factor[i][i];
    }
    for (int i = rank - 1; i > -1; i--) {
        total = room->y[i];
        for (int k = i + 1; k < rank; k++) {
            total -= room->factor[k][i] * room->y[k];
        }
        room->y[i] = total / room->factor[i][i];
    }
    largest = WGA(0.0);
    for (int g = 0; g < WGA_GROUPS; g++) {
        room->u[g][0] = WGA(0.0);
        room->u[g][1] = WGA(0.0);
        for (int i = 0; i < rank; i++) {
            room->u[g][0] += wga_along[i][g] * room->y[i] * room->free[g];
            room->u[g][1] += wga_across[i][g] * room->y[i] * room->free[g];
        }
        if (wga_size(room->u, g) > largest) {
            largest = wga_size(room->u, g);
        }
    }
    return largest;
}

/* Copy unknowns. */
static void wga_copied(wga_real u[WGA_GROUPS][2], wga_real into[WGA_GROUPS][2])
{
    for (int g = 0; g < WGA_GROUPS; g++) {
        into[g][0] = u[g][0];
        into[g][1] = u[g][1];
    }
}

/* room.best of hover. */
static void wga_take_hover(wga_room *room)
{
    for (int g = 0; g < WGA_GROUPS; g++) {
        room->best[g][0] = wga_hover[g][0];
        room->best[g][1] = wga_hover[g][1];
    }
}

/* room.best, whose largest |u_g| is about the least for room.wanted, and which is returned. */
static wga_real wga_searched(wga_room *room)
{
    wga_real first;
    wga_real largest;
    wga_real top;
    wga_real gain;
    wga_real least;
    for (int i = 0; i < WGA_RANK; i++) {
        room->b[i] = WGA(0.0);
        for (int k = 0; k < 6; k++) {
            room->b[i] += wga_demand[i][k] * (room->wanted[k] - wga_bias[k]);
        }
    }
    for (int g = 0; g < WGA_GROUPS; g++) {
        room->weight[g] = WGA(1.0);
    }
    first = wga_weighted(room);
    wga_copied(room->u, room->best);
    largest = first;
    for (int turn = 0; turn < WGA_ROUNDS; turn++) {
        top = WGA_SMALL * WGA_SMALL;
        for (int g = 0; g < WGA_GROUPS; g++) {
            room->weight[g] = room->weight[g] * wga_size(room->u, g);
            if (room->weight[g] > top) {
                top = room->weight[g];
            }
        }
        for (int g = 0; g < WGA_GROUPS; g++) {
            room->weight[g] = wga_bounded(room->weight[g] / top, WGA_FLOOR, WGA(1.0));
        }
        largest = wga_weighted(room);
    }
    gain = wga_bounded((first - largest) / (WGA_BLEND * first + WGA_SMALL), WGA(0.0), WGA(1.0));
    gain = gain * wga_bounded((first - WGA_CALM) / WGA_RAMP, WGA(0.0), WGA(1.0));
    least = WGA(0.0);
    for (int g = 0; g < WGA_GROUPS; g++) {
        room->best[g][0] += gain * (room->u[g][0] - room->best[g][0]);
        room->best[g][1] += gain * (room->u[g][1] - room->best[g][1]);
        if (wga_size(room->best, g) > least) {
            least = wga_size(room->best, g);
        }
    }
    return least;
}

/* Largest share s of the way from start, which is within, to end at which all |u_g| are at most limit. */
static wga_real wga_way_within(wga_real start[WGA_GROUPS][2], wga_real end[WGA_GROUPS][2], wga_real limit)
{
    wga_real share;
    wga_real along;
    wga_real across;
    wga_real square;
    wga_real slope;
    wga_real left;
    wga_real root;
    wga_real until;
    share = WGA(1.0);
    for (int g = 0; g < WGA_GROUPS; g++) {
        along = end[g][0] - start[g][0];
        across = end[g][1] - start[g][1];
        square = along * along + across * across;
        slope = start[g][0] * along + start[g][1] * across;
        left = limit * limit - start[g][0] * start[g][0] - start[g][1] * start[g][1];
        left = left > WGA(0.0) ? left : WGA(0.0);
        root = wga_sqrt(slope * slope + square * left);
        until = slope > WGA(0.0) ? left / (slope + root) : (root - slope) / (square > WGA(0.0) ? square : WGA(1.0));
        if (square > WGA(0.0) && until < share) {
            share = until;
        }
    }
    return share;
}

/* Take room.best so far of its way to room.less. */
static void wga_go(wga_room *room, wga_real share)
{
    for (int g = 0; g < WGA_GROUPS; g++) {
        room->best[g][0] += share * (room->less[g][0] - room->best[g][0]);
        room->best[g][1] += share * (room->less[g][1] - room->best[g][1]);
    }
}

/* room.best within the limits for a finite demand: as asked, else without torque about z, then with what is left. What
 * is asked without torque about z may take 1 - SLACK of the limits, nearer to hover if need be; from there it goes on
 * towards the demand as far as the limits allow. So no command jumps where a demand leaves the reach. */
static int wga_found(wga_room *room, const wga_real *wrench)
{
    for (int k = 0; k < 6; k++) {
        room->wanted[k] = wga_bounded(wrench[k], -wga_far[k], wga_far[k]);
    }
    if (wga_searched(room) <= WGA(1.0)) {
        return WGA_MADE;
    }
    wga_copied(room->best, room->whole);
    room->wanted[5] = WGA(0.0);
    if (wga_searched(room) > WGA(1.0) - WGA_SLACK) {
        wga_copied(room->best, room->less);
        wga_take_hover(room);
        wga_go(room, wga_way_within(room->best, room->less, WGA(1.0) - WGA_SLACK));
    }
    wga_copied(room->whole, room->less);
    wga_go(room, wga_way_within(room->best, room->less, WGA(1.0)));
    return WGA_REDUCED;
}

/* A tilt next to the one before, by whole turns into its range where that has its direction, else at its end. */
static wga_real wga_angle(wga_real tilt, wga_real before, wga_real low, wga_real high)
{
    wga_real near;
    wga_real over;
    wga_real under;
    wga_real back;
    wga_real forth;
    wga_real other;
    int inside;
    near = tilt + WGA_TURN * wga_floor((before - tilt) / WGA_TURN + WGA(0.5));
    over = near - high - WGA_SAME_ANGLE;
    under = low - near - WGA_SAME_ANGLE;
    back = over > WGA(0.0) ? -wga_floor(-over / WGA_TURN) : WGA(0.0);
    forth = under > WGA(0.0) ? -wga_floor(-under / WGA_TURN) : WGA(0.0);
    other = near + WGA_TURN * (forth - back);
    inside = other >= low - WGA_SAME_ANGLE && other <= high + WGA_SAME_ANGLE;
    return wga_bounded(inside ? other : near, low, high);
}

/* The command of room.best, within all limits, and what it makes; whether it is what was found. */
static int wga_sent(wga_room *room, const wga_memory *m, wga_command *out)
{
    int same;
    wga_real along;
    wga_real across;
    wga_real thrust;
    wga_real kept;
    wga_real left;
    int a;
    wga_real wanted;
    wga_real before;
    wga_real turned;
    wga_real off;
    same = 1;
    out->margin = WGA(1.0);
    for (int k = 0; k < 6; k++) {
        out->made[k] = wga_made_bias[k];
    }
    for (int g = 0; g < WGA_GROUPS; g++) {
        along = wga_centre[g] + wga_half[g] * room->best[g][0];
        across = wga_half[g] * room->best[g][1];
        thrust = wga_tilting[g] == 1 ? wga_sqrt(along * along + across * across) : along;
        kept = wga_bounded(thrust, wga_low[g], wga_high[g]);
        left = WGA(1.0) - wga_size(room->best, g);
        if (left < out->margin) {
            out->margin = left > WGA(0.0) ? left : WGA(0.0);
        }
        if (wga_tilting[g] == 1) {
            a = wga_arm[g];
            wanted = wga_atan2(across, along);
            before = m->last_tilt[a];
            turned = wga_angle(wanted, before, wga_tilt_min[a], wga_tilt_max[a]);
            out->tilt[a] = thrust >= wga_weak[g] ? turned : wga_bounded(before, wga_tilt_min[a], wga_tilt_max[a]);
            along = kept * wga_cos(out->tilt[a]);
            across = kept * wga_sin(out->tilt[a]);
            off = out->tilt[a] - wanted;
            off = off - WGA_TURN * wga_floor(off / WGA_TURN + WGA(0.5));
            same = same && !(wga_fabs(off) > WGA(2.0) * WGA_SAME_ANGLE && thrust >= wga_weak[g]);
        } else {
            along = kept;
        }
        same = same && wga_fabs(kept - thrust) <= WGA(1e-06) * wga_half[g];
        room->weight[g] = kept;
        for (int k = 0; k < 6; k++) {
            out->made[k] += wga_made_along[k][g] * along + wga_made_across[k][g] * across;
        }
    }
    for (int r = 0; r < WGA_ROTORS; r++) {
        out->thrust[r] = wga_bounded(wga_share[r] * room->weight[wga_owner[r]], wga_least[r], wga_most[r]);
    }
    return same;
}

/* Remember a command. */
static void wga_kept(wga_memory *m, const wga_command *out)
{
    for (int r = 0; r < WGA_ROTORS; r++) {
        m->last_thrust[r] = out->thrust[r];
    }
    for (int a = 0; a < WGA_ARMS; a++) {
        m->last_tilt[a] = out->tilt[a];
    }
    for (int k = 0; k < 6; k++) {
        m->last_made[k] = out->made[k];
    }
}

/* Forget the past: the command before is that of hover, with arms at rest. */
static void wga_hovering(wga_room *room, wga_memory *m, wga_command *out)
{
    for (int a = 0; a < WGA_ARMS; a++) {
        m->last_tilt[a] = WGA(0.0);
        out->tilt[a] = wga_bounded(WGA(0.0), wga_tilt_min[a], wga_tilt_max[a]);
    }
    wga_take_hover(room);
    if (!wga_sent(room, m, out)) {
        out->margin = WGA(0.0);
    }
    wga_kept(m, out);
}

/* The command for a demand about the centre of mass; one that is not finite repeats the command of before. A memory
 * that is none, as after an upset, is forgotten: a number that is not finite, an arm wound beyond WOUND. */
static int wga_answered(wga_room *room, wga_memory *m, const wga_real *wrench, wga_command *out)
{
    int finite;
    int remembered;
    int status;
    finite = 1;
    for (int k = 0; k < 6; k++) {
        finite = finite && isfinite(wrench[k]);
    }
    remembered = 1;
    for (int r = 0; r < WGA_ROTORS; r++) {
        remembered = remembered && isfinite(m->last_thrust[r]);
    }
    for (int a = 0; a < WGA_ARMS; a++) {
        remembered = remembered && wga_fabs(m->last_tilt[a]) <= WGA_WOUND;
    }
    for (int k = 0; k < 6; k++) {
        remembered = remembered && isfinite(m->last_made[k]);
    }
    if (!remembered) {
        wga_hovering(room, m, out);
    }
    for (int a = 0; a < WGA_ARMS; a++) {
        out->tilt[a] = wga_bounded(m->last_tilt[a], wga_tilt_min[a], wga_tilt_max[a]);
    }
    if (!finite) {
        for (int r = 0; r < WGA_ROTORS; r++) {
            out->thrust[r] = wga_bounded(m->last_thrust[r], wga_least[r], wga_most[r]);
        }
        for (int k = 0; k < 6; k++) {
            out->made[k] = m->last_made[k];
        }
        out->margin = WGA(0.0);
        out->status = WGA_BAD_DEMAND;
        return WGA_BAD_DEMAND;
    }
    status = wga_found(room, wrench);
    if (!wga_sent(room, m, out)) {
        status = WGA_REDUCED;
    }
    wga_kept(m, out);
    out->status = status;
    return status;
}