/* Poses of joints anywhere in the ranges, guesses anywhere in them: what NAME_ik returns, and how long it takes.
   Compiled with -DNAME=..., -DHEADER="..."; arguments: how many poses, then the lower and upper end of every joint. */
#define _POSIX_C_SOURCE 199309L
#include HEADER

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define JOINED(a, b) a##b
#define JOIN(a, b) JOINED(a, b)
#define OF(tail) JOIN(NAME, tail)

typedef OF(_real) real;
enum { N = OF(_N) };

static unsigned long long state = 88172645463325252ULL;

static double drawn(double low, double high)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return low + (high - low) * (double)(state >> 11) / 9007199254740992.0;
}

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

int main(int count, char **arguments)
{
    const int poses = atoi(arguments[1]);
    double took = 0.0, position = 0.0, rotation = 0.0;
    int codes[5] = { 0 }, skipped = 0, elsewhere = 0, k = 0, j;
    (void)count;
    while (k < poses) {
        real q[N], guess[N], found[N], T[12], back[12];
        for (j = 0; j < N; ++j) {
            const double low = atof(arguments[2 + 2 * j]), high = atof(arguments[3 + 2 * j]);
            q[j] = (real)drawn(low, high);
            guess[j] = (real)drawn(low, high);
        }
        if (OF(_fk)(0, 0, q, T) != 0) { /* joints at which the mechanism cannot be assembled */
            ++skipped;
            continue;
        }
        {
            const double start = now();
            const int code = OF(_ik)(0, 0, T, guess, found);
            took += now() - start;
            ++codes[code];
            ++k;
            if (code == 0) {
                double p = 0.0, r = 0.0;
                const int away = OF(_fk_from)(0, 0, found, T, back) != 0;
                for (j = 0; j < 12 && !away; ++j) {
                    const double d = fabs((double)(back[j] - T[j]));
                    p = j % 4 == 3 ? fmax(p, d) : p;
                    r = j % 4 == 3 ? r : fmax(r, d);
                }
                if (away || p > 1.0) { /* another way to assemble the mechanism at these joints */
                    ++elsewhere;
                } else {
                    position = fmax(position, p);
                    rotation = fmax(rotation, r);
                }
            }
        }
    }
    printf("%d %d %d %d %d %d %g %g %g\n", codes[0], codes[1], codes[2], codes[3], skipped, elsewhere, 1e6 * took / poses,
        position, rotation);
    return 0;
}
