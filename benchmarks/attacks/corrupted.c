/* Overwrites numbers of a compensation's memory, or all of it, at random, and flies on: `corrupted DRAWS SEED` prints the
 * largest command and correction as shares of their bounds. Built with AUTHORITY and CORRECTION_MAX as hammer.c is. */
#include "wrenchgap_compensator.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static unsigned long long state;

static double uniform(void)
{
    state = state * 6364136223846793005ULL + 1442695040888963407ULL;
    return (double)(state >> 11) / 9007199254740992.0;
}

static wg_real odd(void)
{
    const double size[] = {NAN, INFINITY, -INFINITY, 1e300, -1e30, 5, -0.5, 1e-310, 0};
    return (wg_real)size[(int)(9 * uniform())];
}

int main(int count, char **words)
{
    const double authority[] = AUTHORITY, most[] = CORRECTION_MAX;
    const int draws = count > 1 ? atoi(words[1]) : 1000;
    double worst[2] = {0, 0};
    wg_memory memory;
    wg_input in = {0};
    wg_output out;
    state = count > 2 ? (unsigned long long)atoi(words[2]) : 1;
    in.quat_EB[0] = 1;
    in.voltage = 15;
    wg_reset(&memory);
    for (int k = 0; k < draws; k++) {
        wg_real *const places[] = {memory.optimum, memory.correction, memory.known, memory.sent, memory.lag_in, memory.lag_out};
        in.wrench_desired[2] = (wg_real)(HOVER * (1 + 0.05 * uniform()));
        in.wrench_desired[3 + k % 3] = (wg_real)(0.05 * authority[3 + k % 3] * (uniform() - 0.5));
        if (k % 3 == 0)
            places[(int)(6 * uniform())][(int)(6 * uniform())] = odd();
        if (k % 50 == 0)
            for (unsigned i = 0; i < sizeof memory; i++)
                ((unsigned char *)&memory)[i] = (unsigned char)(256 * uniform());
        wg_step(&memory, &in, &out);
        for (int i = 0; i < 6; i++) {
            const double share[] = {fabs((double)out.wrench_cmd[i]) / authority[i],
                                    most[i] > 0 ? fabs((double)out.correction[i]) / most[i] : fabs((double)out.correction[i])};
            for (int j = 0; j < 2; j++)
                if (!(share[j] <= worst[j]))
                    worst[j] = isfinite(share[j]) ? share[j] : INFINITY;
        }
    }
    printf("%.9g %.9g\n", worst[0], worst[1]);
    return 0;
}
