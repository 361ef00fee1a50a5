/* Hammers an exported compensation with demands that no controller should make; the attack `compensation` compiles it
 * beside the export. Arguments: draws, seed. Prints one line:
 *
 *   draws, largest |command| and |correction| in shares of their bounds, largest difference of the command for an ordinary
 *   demand behind a draw that was refused from that of a fresh start, how many draws were refused
 *
 * and to standard error every thousandth command, for Python to allocate. */
#include "wrenchgap_compensator.h"
#include "uniform.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static const double authority[6] = AUTHORITY, most[6] = CORRECTION_MAX, hover = HOVER;

static wg_real nasty(double usual, int kind)
{
#ifdef WG_FLOAT
    static const wg_real odd[] = {FLT_MAX, -FLT_MAX, FLT_MIN, 1e-45F, INFINITY, -INFINITY, NAN, -0.0F, 1e30F, -1e20F};
#else
    static const wg_real odd[] = {DBL_MAX, -DBL_MAX, DBL_MIN, 5e-324, INFINITY, -INFINITY, NAN, -0.0, 1e200, -1e30};
#endif
    const double within = 2 * uniform() - 1;
    switch (kind) {
    case 0: return (wg_real)(usual * within);
    case 1: return (wg_real)(usual * within * 3);
    case 2: return (wg_real)(usual * within * pow(10, 30 * uniform()));
    case 3: return (wg_real)(usual * within * pow(10, -40 * uniform()));
    default: return odd[(int)(uniform() * 9.999)];
    }
}

static void ordinary(wg_input *in)
{
    static const wg_input none;
    *in = none;
    in->wrench_desired[2] = (wg_real)hover;
    for (int i = 0; i < 3; i++)
        in->wrench_desired[3 + i] = (wg_real)(0.01 * authority[3 + i] * (2 * uniform() - 1));
    in->quat_EB[0] = 1;
    in->position_E[2] = 2;
    in->voltage = 15;
}

int main(int count, char **words)
{
    const long draws = count > 1 ? atol(words[1]) : 1000;
    double command = 0, correction = 0, apart = 0;
    long refused = 0;
    wg_memory m, fresh;
    wg_input in;
    wg_output out, again;
    seed = count > 2 ? (uint64_t)atol(words[2]) * 77777 + 1 : 1;
    wg_reset(&m);
    for (long k = 0; k < draws; k++) {
        ordinary(&in);
        const int wrench = (int)(uniform() * 5), state = uniform() < 0.3 ? (int)(uniform() * 5) : -1;
        for (int i = 0; i < 6; i++)
            in.wrench_desired[i] = nasty(authority[i], uniform() < 0.7 ? wrench : 0);
        for (int i = 0; i < 6; i++)
            in.feedback[i] = uniform() < 0.02 ? nasty(authority[i], wrench) : 0;
        if (state >= 0) {
            for (int i = 0; i < 3; i++) {
                in.velocity_E[i] = nasty(10, state);
                in.omega_B[i] = nasty(5, state);
                in.position_E[i] = nasty(100, state);
            }
            for (int i = 0; i < 4; i++)
                in.quat_EB[i] = nasty(1, state);
            in.time = nasty(1000, state);
            in.voltage = nasty(20, state);
        }
        const int status = wg_step(&m, &in, &out);
        for (int i = 0; i < 6; i++) {
            const double one = fabs((double)out.wrench_cmd[i]) / authority[i];
            const double two = fabs((double)out.correction[i]) / (most[i] > 0 ? most[i] : 1e-30);
            command = one <= command ? command : one; /* nan stays */
            correction = two <= correction ? correction : two;
        }
        if (k % 1000 == 0) {
            for (int i = 0; i < 6; i++)
                fprintf(stderr, "%.17g ", (double)out.wrench_cmd[i]);
            fprintf(stderr, "\n");
        }
        if (status != WG_OK && status != WG_NOT_ACCEPTED) {
            refused++;
            ordinary(&in);
            wg_reset(&fresh);
#if WG_OBSERVER
            for (int i = 0; i < 3; i++)
                fresh.estimate[i] = m.estimate[i];
#endif
            for (int later = refused % 64 == 0 ? 8 : 1; later > 0; later--) { /* lag and delay show later */
                wg_step(&m, &in, &out);
                wg_step(&fresh, &in, &again);
                for (int i = 0; i < 6; i++) {
                    const double off = fabs((double)out.wrench_cmd[i] - (double)again.wrench_cmd[i]);
                    apart = off <= apart ? apart : off;
                }
            }
        }
    }
    printf("%ld %.9g %.9g %.9g %ld\n", draws, command, correction, apart, refused);
    return 0;
}
