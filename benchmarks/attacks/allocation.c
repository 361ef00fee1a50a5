/* Hammers an exported allocation with demands that no controller should make, and writes into its memory; the attack
 * `compensation` compiles it beside the export. Argument: periods. Prints the largest thrust as a share of the rotors'
 * limit THRUST_MAX, how many commands were not finite or negative, and the largest |made - asked| of ordinary demands
 * [N, Nm] that follow a demand at once. */
#include "wrenchgap_allocation.h"
#include "uniform.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static wga_real demand(void)
{
    static const wga_real odd[] = {DBL_MAX, -DBL_MAX, DBL_MIN, 5e-324, INFINITY, -INFINITY, NAN, -0.0, 1e200, -1e30};
    const double within = 2 * uniform() - 1;
    return uniform() < 0.5 ? (wga_real)(100 * within * pow(10, 20 * uniform())) : odd[(int)(uniform() * 9.999)];
}

int main(int count, char **words)
{
    const long periods = count > 1 ? atol(words[1]) : 1000;
    wga_memory memory;
    wga_command out;
    double largest = 0, off = 0;
    long wrong = 0;
    wga_reset(&memory);
    for (long k = 0; k < periods; k++) {
        const int ordinary = k % 2, spoilt = k > periods / 2 && k % 7 == 3; /* the memory in the second half */
        wga_real wrench[6] = {0, 0, (wga_real)HOVER, 0, 0, 0};
        for (int i = 0; i < 6; i++)
            if (!ordinary)
                wrench[i] = demand();
        for (size_t i = 0; spoilt && i < sizeof memory; i++)
            ((unsigned char *)&memory)[i] = (unsigned char)(256 * uniform());
        wga_allocate(&memory, wrench, &out);
        for (size_t r = 0; r < sizeof out.thrust / sizeof out.thrust[0]; r++) {
            wrong += !(out.thrust[r] >= 0 && isfinite((double)out.thrust[r]));
            largest = fmax(largest, (double)out.thrust[r] / THRUST_MAX);
        }
        for (int i = 0; i < 6; i++) {
            wrong += !isfinite((double)out.made[i]);
            if (ordinary && k <= periods / 2)
                off = fmax(off, fabs((double)(out.made[i] - wrench[i])));
        }
    }
    printf("%.9g %ld %.9g\n", largest, wrong, off);
    return 0;
}
