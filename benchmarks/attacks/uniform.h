/* Numbers of chance, the same on every machine: xorshift64* (Vigna, ACM Trans. Math. Softw. 42 (4), 2016). */
#ifndef UNIFORM_H
#define UNIFORM_H

#include <stdint.h>

static uint64_t seed = 1;

static double uniform(void) /* 0 to 1 */
{
    seed ^= seed >> 12;
    seed ^= seed << 25;
    seed ^= seed >> 27;
    return (double)(seed * 2685821657736338717ULL >> 11) / 9007199254740992.0;
}

#endif
