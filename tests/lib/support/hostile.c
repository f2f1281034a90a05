/* Hostile input to every function of generated C. Compiled with -DNAME=<machine> and NAME_kin.c, NAME_batch.c and NAME_state.c,
   where there are; the tests write limits.h: LOW, HIGH (joint ranges with the tolerance), START, WIDTH (of what is in them),
   REACH (mm), UNIT (of each joint, that is a mm there), POSITION, ROTATION (promised), BRANCHES (0: no ik_all),
   CLOSED (whether the chain is), POINTED (the tool's axis that NAME_point points; -1: there is none).

       hostile ROUNDS [INVERSE [ALL [MANY]]]: functions that search are called in one of so many rounds

   Prints "function code count" lines; says on stderr what breaks a promise, and then returns 1. */
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define TEXT_(a) #a
#define TEXT(a) TEXT_(a)
#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define OF(tail) JOIN(NAME, tail)
#include TEXT(OF(_kin.h))
#if OF(_HAS_BATCH)
#include TEXT(OF(_batch.h))
#endif
#if OF(_HAS_STATE)
#include TEXT(OF(_state.h))
#endif

#include "limits.h"

typedef OF(_real) real;
enum { N = OF(_N), NP = OF(_NP), NZ = OF(_NZ), ROOM = BRANCHES > 0 ? BRANCHES * N : 1 };
enum { FK, FK_FROM, IK, JAC, COMPENSATE, FK_N, IK_N, COMPENSATE_N, IK_ALL, POINT, STATE_INIT, STATE_UPDATE,
    FUNCTIONS };
static const char *const names[FUNCTIONS] = { "fk", "fk_from", "ik", "jac", "compensate", "fk_n", "ik_n", "compensate_n",
    "ik_all", "point", "state_init", "state_update" };
static const int single = sizeof(real) == 4;

static long counts[FUNCTIONS][5];
static long round_number, broken;

/* ---- numbers ---- */

static uint64_t state = 88172645463325252u;

static unsigned below(unsigned n)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (unsigned)((state >> 33) % n);
}

static double between(double low, double high)
{
    return low + (high - low) * (double)below(1u << 30) / (double)(1u << 30);
}

static real hostile(void)
{
    const double huge = single ? 1e38 : 1e300, small = single ? 1e-42 : 1e-310;
    const double odd[] = { NAN, INFINITY, -INFINITY, huge, -huge, small, -small, -0.0, single ? FLT_MAX : DBL_MAX, 1e30, -1e30,
        1e18, -1e10, 123456.789, -98765.4, 1e5 + 1, 1000 * 3.14159265358979, 0.5, -1, 4e9, -4e9 };
    return (real)odd[below(sizeof odd / sizeof *odd)];
}

static void joints(real *q)
{
    const unsigned kind = below(8);
    int j;
    for (j = 0; j < N; ++j) {
        q[j] = (real)between(fmax(LOW[j], START[j] - 0.5 * WIDTH[j]), fmin(HIGH[j], START[j] + 0.5 * WIDTH[j]));
        q[j] = kind == 1 ? hostile() : kind == 2 ? (real)(q[j] * 100) : kind == 3 ? 0 : q[j];
    }
    if (kind == 4) {
        q[below(N)] = hostile();
    }
}

static void rotation(real *T)
{
    double a[4], n = 0;
    int i;
    for (i = 0; i < 4; ++i) {
        a[i] = between(-1, 1);
        n += a[i] * a[i];
    }
    for (i = 0; i < 3; ++i) {
        const int j1 = (i + 1) % 3, j2 = (i + 2) % 3;
        T[4 * i + i] = (real)(1 - 2 * (a[j1] * a[j1] + a[j2] * a[j2]) / n);
        T[4 * i + j1] = (real)(2 * (a[i] * a[j1] - a[3] * a[j2]) / n);
        T[4 * i + j2] = (real)(2 * (a[i] * a[j2] + a[3] * a[j1]) / n);
        T[4 * i + 3] = (real)between(-REACH, REACH);
    }
}

static void pose(const real *p, const real *z, real *T)
{
    const unsigned kind = below(12);
    real q[N];
    int i, j;
    for (j = 0; j < N; ++j) {
        q[j] = (real)between(fmax(LOW[j], START[j] - 0.5 * WIDTH[j]), fmin(HIGH[j], START[j] + 0.5 * WIDTH[j]));
    }
    rotation(T);
    if (kind == 0) {
        return;
    }
    if (OF(_fk)(p, z, q, T) != 0) {
        (void)OF(_fk)(NULL, NULL, q, T);
    }
    if (kind == 1) {
        T[below(12)] = hostile();
    } else if (kind == 2) {
        for (i = 0; i < 12; ++i) {
            T[i] = hostile();
        }
    } else if (kind == 3) { /* nearly a rotation, or not so nearly */
        const double size = pow(10, between(-12, -1));
        for (i = 0; i < 12; ++i) {
            T[i] += (real)(i % 4 < 3 ? between(-size, size) : 0);
        }
    } else if (kind == 4) { /* a reflection */
        for (i = 0, j = (int)below(3); i < 3; ++i) {
            T[4 * i + j] = -T[4 * i + j];
        }
    } else if (kind == 5) { /* out of reach */
        const real far = (real)pow(10, between(0.2, 30));
        for (i = 0; i < 3; ++i) {
            T[4 * i + 3] *= far;
        }
    } else if (kind == 6) {
        memset(T, 0, 12 * sizeof *T);
    }
}

/* Parameters or drivers in room, or NULL. */
static const real *constants(const real *usual, int n, real *room)
{
    const unsigned kind = below(16);
    int i;
    for (i = 0; i < n; ++i) {
        const double bent = usual[i] * (1 + between(-1e-3, 1e-3));
        room[i] = (real)(kind == 1 ? 0 : kind == 2 ? -usual[i] : kind == 3 ? 1e30 : kind == 4 ? usual[i] * 0.1 : bent);
        room[i] = kind == 5 ? hostile() : room[i];
    }
    if (kind == 6 || kind == 7) {
        room[below((unsigned)n)] = hostile();
    }
    return kind < 10 && (OF(_HAS_P) || usual != OF(_p0)) ? room : NULL;
}

/* ---- promises ---- */

static void expect(int holds, int function, const char *what, double value)
{
    if (!holds && ++broken <= 12) {
        fprintf(stderr, "round %ld, %s: %s (%.6g)\n", round_number, names[function], what, value);
    }
}

static int all_finite(const real *v, int n)
{
    int i, finite = 1;
    for (i = 0; i < n; ++i) {
        finite &= isfinite(v[i]) != 0;
    }
    return finite;
}

static void count(int function, int code)
{
    expect(code >= 0 && code <= 4, function, "return code", code);
    counts[function][code >= 0 && code <= 4 ? code : 4]++;
}

static void untouched(int function, int code, const real *out, const real *before, int n)
{
    expect(code == 0 || memcmp(out, before, (size_t)n * sizeof *out) == 0, function, "output changed, code", code);
    expect(code != 0 || all_finite(out, n), function, "output not finite, code", code);
}

static void in_ranges(int function, const real *q)
{
    int j;
    for (j = 0; j < N; ++j) {
        expect(q[j] >= LOW[j] && q[j] <= HIGH[j], function, "joint out of its range", (double)q[j]);
    }
}

static double largest_of(const real *v, int n)
{
    double largest = 0;
    int i;
    for (i = 0; i < n; ++i) {
        largest = fmax(largest, fabs((double)v[i]));
    }
    return largest;
}

/* Whether constants are not those of a machine as it may be built. */
static int absurd(const real *v, const real *usual, int n)
{
    int i, far = 0;
    for (i = 0; v && i < n; ++i) {
        far |= !(fabs((double)v[i] - (double)usual[i]) <= 0.01 * fabs((double)usual[i]));
    }
    return far;
}

/* Adds what it does to the pose (mm, rad) that joints, and rods beside them, are no better than their last digits: much
   where a hexapod is nearly singular. */
static void add_rounding(const real *p, const real *z, const real *q, double *position, double *angle)
{
    const double eps = single ? FLT_EPSILON : DBL_EPSILON;
    real J[6 * N];
    int i, j;
    for (i = 0; OF(_jac)(p, z, q, J) == 0 && i < 6; ++i) {
        for (j = 0; j < N; ++j) {
            const double size = fabs((double)q[j]) + (CLOSED ? REACH * UNIT[j] : 0);
            *(i < 3 ? position : angle) += 4 * eps * size * fabs((double)J[N * i + j]);
        }
    }
}

/* Whether forward kinematics at q meets what ASKED counts of T (x y z, turns about the tool's axes, its direction) within the promised tolerance, and the rounding of numbers larger than the machine. */
static void meets(int function, const real *p, const real *z, const real *q, const real *T)
{
    const double size = fmax(largest_of(p ? p : OF(_p0), NP), largest_of(T, 12)) - REACH;
    const double angle = fmax(largest_of(q, N), largest_of(p ? p : OF(_p0), NP));
    const double eps = single ? FLT_EPSILON : DBL_EPSILON;
    real out[12];
    double E[3], R[9], trace = 0, apart;
    double position = POSITION + 64 * eps * fmax(size, 0) * fmax(1, angle / 10), turn = ROTATION + 64 * eps * fmax(angle / 10 - 1, 0);
    int i, j, k, code;
    if (CLOSED && (absurd(p, OF(_p0), NP) || absurd(z, OF(_z0), NZ))) {
        return; /* such loops may be closed in many ways */
    }
    code = OF(_fk_from)(p, z, q, T, out);
    expect(code == 0, function, "no forward kinematics at a solution, code", code);
    if (code != 0) {
        return;
    }
    add_rounding(p, z, q, &position, &turn);
    for (i = 0; i < 3; ++i) {
        for (j = 0; j < 3; ++j) {
            R[3 * i + j] = 0;
            for (k = 0; k < 3; ++k) {
                R[3 * i + j] += (double)T[4 * k + i] * (double)out[4 * k + j];
            }
        }
        E[i] = ASKED[i] * ((double)T[4 * i + 3] - (double)out[4 * i + 3]);
        trace += R[4 * i];
    }
    apart = sqrt(E[0] * E[0] + E[1] * E[1] + E[2] * E[2]);
    expect(apart <= position, function, "position apart, mm", apart);
    E[0] = ASKED[3] * 0.5 * (R[7] - R[5]);
    E[1] = ASKED[4] * 0.5 * (R[2] - R[6]);
    E[2] = ASKED[5] * 0.5 * (R[3] - R[1]);
    for (i = 0; i < 3; ++i) { /* the direction of the axis z, x or y */
        if (ASKED[6 + i]) {
            for (k = (i + 2) % 3, j = 0; j < 3; ++j) {
                E[j] = j == k ? 0 : R[3 * j + k];
            }
            expect(R[4 * k] > 0, function, "the other way round", R[4 * k]);
        }
    }
    apart = sqrt(E[0] * E[0] + E[1] * E[1] + E[2] * E[2]);
    expect(apart <= turn && (trace > 2.9 || !(ASKED[3] && ASKED[4] && ASKED[5])), function, "rotation apart, rad", apart);
}

/* ---- one call each, into blocks of exactly their size ---- */

static real *block(int n)
{
    real *out = malloc((size_t)n * sizeof *out);
    if (!out) {
        exit(2);
    }
    memset(out, 0xA5, (size_t)n * sizeof *out);
    return out;
}

static void quick_row(const real *p, const real *z, const real *given_q, const real *given_T)
{
    real *q = block(N), *T = block(12), *out_T = block(12), *J = block(6 * N), *before = block(6 * N);
    int code;
    memcpy(q, given_q, N * sizeof *q);
    memcpy(T, given_T, 12 * sizeof *T);
    count(FK, code = OF(_fk)(p, z, q, out_T));
    untouched(FK, code, out_T, before, 12);
    memset(out_T, 0xA5, 12 * sizeof *out_T);
    count(FK_FROM, code = OF(_fk_from)(p, z, q, T, out_T));
    untouched(FK_FROM, code, out_T, before, 12);
    expect(OF(_fk_from)(p, z, q, T, T) == code, FK_FROM, "in place: another code than", code);
    expect(memcmp(T, code == 0 ? out_T : given_T, 12 * sizeof *T) == 0, FK_FROM, "in place: another output, code", code);
    count(JAC, code = OF(_jac)(p, z, q, J));
    untouched(JAC, code, J, before, 6 * N);
    free(q), free(T), free(out_T), free(J), free(before);
}

static void one_row(const real *p, const real *z, const real *given_q, const real *given_T)
{
    real *q = block(N), *T = block(12), *out_q = block(N), *before = block(N), *own = block(N);
    int code;
    memcpy(q, given_q, N * sizeof *q);
    memcpy(T, given_T, 12 * sizeof *T);
    count(IK, code = OF(_ik)(p, z, T, q, out_q));
    untouched(IK, code, out_q, before, N);
    if (code == 0) {
        in_ranges(IK, out_q);
        meets(IK, p, z, out_q, T);
    }
    memcpy(own, q, N * sizeof *q); /* in place */
    expect(OF(_ik)(p, z, T, own, own) == code, IK, "in place: another code than", code);
    expect(memcmp(own, code == 0 ? out_q : q, N * sizeof *q) == 0, IK, "in place: another output, code", code);
    memset(out_q, 0xA5, N * sizeof *out_q);
    count(COMPENSATE, code = OF(_compensate)(p, z, q, out_q));
    untouched(COMPENSATE, code, out_q, before, N);
    if (code == 0) {
        in_ranges(COMPENSATE, out_q);
    }
    memcpy(own, q, N * sizeof *q);
    expect(OF(_compensate)(p, z, own, own) == code, COMPENSATE, "in place: another code than", code);
    expect(memcmp(own, code == 0 ? out_q : q, N * sizeof *q) == 0, COMPENSATE, "in place: another output, code", code);
    free(q), free(T), free(out_q), free(before), free(own);
}

/* Outputs that lie upon inputs, wholly or one number aside: as without, and on a non-zero code all stays as it was. */
static void overlaps(const real *p, const real *z, const real *q, const real *T)
{
    enum { WIDE = 12 + 6 * N };
    real mixed[WIDE], kept[WIDE], out[WIDE];
    const int aside = (int)below(3);
    int function, code, size, at;
    for (function = FK; function <= COMPENSATE; ++function) {
        const real *given = function == IK ? T : q;
        const int width = function == IK ? 12 : N;
        memset(mixed, 0xA5, sizeof mixed);
        memcpy(mixed + aside, given, (size_t)width * sizeof *mixed);
        memcpy(kept, mixed, sizeof kept);
        at = aside == 2 ? 0 : 1;
        size = function == JAC ? 6 * N : function == FK || function == FK_FROM ? 12 : N;
        code = function == FK         ? OF(_fk)(p, z, q, out)
            : function == FK_FROM    ? OF(_fk_from)(p, z, q, T, out)
            : function == IK         ? OF(_ik)(p, z, T, q, out)
            : function == JAC        ? OF(_jac)(p, z, q, out)
                                     : OF(_compensate)(p, z, q, out);
        expect(code == (function == FK         ? OF(_fk)(p, z, mixed + aside, mixed + at)
                           : function == FK_FROM ? OF(_fk_from)(p, z, mixed + aside, T, mixed + at)
                           : function == IK      ? OF(_ik)(p, z, mixed + aside, q, mixed + at)
                           : function == JAC     ? OF(_jac)(p, z, mixed + aside, mixed + at)
                                                 : OF(_compensate)(p, z, mixed + aside, mixed + at)),
            function, "upon its input: another code than", code);
        if (code == 0) {
            memcpy(kept + at, out, (size_t)size * sizeof *out);
        }
        expect(memcmp(mixed, kept, sizeof kept) == 0, function, "upon its input: another output, code", code);
    }
}

#if POINTED >= 0
static void pointed(const real *p, const real *z, const real *given_q, const real *T)
{
    real *u = block(3), *q = block(N), *out = block(N), *before = block(N), there[12];
    const unsigned kind = below(8);
    double length = 0, across = 0;
    int i, code;
    for (i = 0; i < 3; ++i) {
        u[i] = kind == 0 ? hostile() : T[4 * i + POINTED];
        length += (double)u[i] * (double)u[i];
    }
    memcpy(q, given_q, N * sizeof *q);
    count(POINT, code = OF(_point)(p, z, u, q, out));
    untouched(POINT, code, out, before, N);
    if (code == 0) {
        in_ranges(POINT, out);
        expect(OF(_fk)(p, z, out, there) == 0, POINT, "no forward kinematics at a solution", 0);
        for (i = 0; i < 3; ++i) {
            const int j = (i + 1) % 3, k = (i + 2) % 3;
            const double part = (double)u[j] * (double)there[4 * k + POINTED] - (double)u[k] * (double)there[4 * j + POINTED];
            across += part * part;
        }
        across = sqrt(across / length);
        expect(across <= ROTATION + 64 * (single ? FLT_EPSILON : DBL_EPSILON), POINT, "aside, rad", across);
    }
    expect(OF(_point)(p, z, u, q, q) == code, POINT, "in place: another code than", code);
    expect(memcmp(q, code == 0 ? out : given_q, N * sizeof *q) == 0, POINT, "in place: another output, code", code);
    free(u), free(q), free(out), free(before);
}
#endif

#if OF(_HAS_STATE)
static OF(_state) memory;

/* An update with what may come; the struct and z stay as they were where it is refused. z may be sensed. */
static void update(const real *given_q)
{
    enum { NS = OF(_NS), ROOMY = NZ > NS ? NZ : NS };
    real *q = block(N), *sensed = block(ROOMY), *z = block(ROOMY), *before = block(ROOMY), *travel = block(N);
    const unsigned kind = below(8);
    const real dt = kind == 0 ? hostile() : (real)pow(10, between(-6, 6));
    OF(_state) kept = memory, other = memory;
    int i, code, same;
    if (round_number % 64 == 0) {
        for (i = 0; i < N; ++i) {
            travel[i] = below(4) ? (real)between(0, WIDTH[i]) : hostile();
        }
        count(STATE_INIT, code = OF(_state_init)(&memory, below(2) ? travel : NULL));
        expect(code == 0 || memcmp(&memory, &kept, sizeof kept) == 0, STATE_INIT, "state changed, code", code);
        kept = other = memory;
    }
    if (kind == 1) {
        OF(_state_session)(&memory);
        kept = other = memory;
    }
    memcpy(q, given_q, N * sizeof *q);
    for (i = 0; i < NS; ++i) {
        sensed[i] = kind == 2 ? hostile() : (real)between(-50, 50);
    }
    count(STATE_UPDATE, code = OF(_state_update)(&memory, q, dt, kind == 3 ? NULL : sensed, z));
    untouched(STATE_UPDATE, code, z, before, NZ);
    expect(code == 0 || memcmp(&memory, &kept, sizeof kept) == 0, STATE_UPDATE, "state changed, code", code);
    if (kind != 3) {
        same = OF(_state_update)(&other, q, dt, sensed, sensed) == code;
        expect(same, STATE_UPDATE, "in place: another code than", code);
        expect(code != 0 || memcmp(sensed, z, NZ * sizeof *z) == 0, STATE_UPDATE, "in place: another output, code", code);
    }
    if (code == 0 && round_number % 1024 == 0) {
        (void)OF(_state_init)(&memory, NULL); /* after numbers of any size a new beginning */
    }
    free(q), free(sensed), free(z), free(before), free(travel);
}
#endif

#if BRANCHES
static void all_rows(const real *p, const real *z, const real *T)
{
    real *q = block(ROOM), *before = block(ROOM);
    int number = -7, k;
    const int code = OF(_ik_all)(p, z, T, q, &number);
    count(IK_ALL, code);
    if (code != 0) {
        untouched(IK_ALL, code, q, before, ROOM);
        expect(number == -7, IK_ALL, "count changed, code", code);
    }
    for (k = 0; code == 0 && k < number; ++k) {
        untouched(IK_ALL, 0, q + k * N, before, N);
        in_ranges(IK_ALL, q + k * N);
        meets(IK_ALL, p, z, q + k * N, T);
    }
    expect(code != 0 || (number > 0 && number <= BRANCHES), IK_ALL, "number of solutions", number);
    free(q), free(before);
}
#endif

#if OF(_HAS_BATCH)
static void many_rows(const real *p, int with_z, int n, const real *q, const real *T, const real *z)
{
    real *out_q = block(N * n + 1), *out_T = block(12 * n + 1), *before = block(12 * n + N), *place = block(N * n + 1);
    int *code = malloc(sizeof *code * (size_t)(n + 1));
    const int z_step = with_z ? NZ : 0;
    int i, failed, function;
    if (!with_z) {
        z = NULL;
    }
    for (function = FK_N; function <= COMPENSATE_N; ++function) {
        const int size = function == FK_N ? 12 : N;
        int nonzero = 0;
        real *out = function == FK_N ? out_T : out_q;
        memset(out_q, 0xA5, (size_t)(N * n + 1) * sizeof *out_q);
        failed = function == FK_N ? OF(_fk_n)(p, z, n, q, out_T, code)
            : function == IK_N    ? OF(_ik_n)(p, z, n, T, q, out_q, code)
                                  : OF(_compensate_n)(p, z, n, q, out_q, code);
        for (i = 0; i < n; ++i) {
            const real *row_z = with_z ? z + z_step * i : NULL;
            real alone[12];
            const int expected = function == FK_N ? OF(_fk)(p, row_z, q + N * i, alone)
                : function == IK_N                ? OF(_ik)(p, row_z, T + 12 * i, q + N * i, alone)
                                                  : OF(_compensate)(p, row_z, q + N * i, alone);
            count(function, code[i]);
            nonzero += code[i] != 0;
            expect(code[i] == expected, function, "code is not the scalar's, times ten", 10 * code[i] + expected);
            untouched(function, code[i], out + size * i, before, size);
            if (function != FK_N && code[i] == 0) {
                in_ranges(function, out + size * i);
            }
            if (function == IK_N && code[i] == 0) {
                meets(function, p, row_z, out + size * i, T + 12 * i);
            }
        }
        expect(failed == nonzero, function, "number of failures", failed);
        expect(memcmp(out + size * n, before, sizeof *out) == 0, function, "written beyond the rows", n);
        if (function != FK_N) { /* in place, and without codes */
            memcpy(place, q, (size_t)(N * n) * sizeof *q);
            expect(failed == (function == IK_N ? OF(_ik_n)(p, z, n, T, place, place, NULL)
                                               : OF(_compensate_n)(p, z, n, place, place, NULL)),
                function, "in place: number of failures", failed);
            for (i = 0; i < n; ++i) {
                const real *same = code[i] == 0 ? out + N * i : q + N * i;
                expect(memcmp(place + N * i, same, N * sizeof *q) == 0, function, "in place: another output, code", code[i]);
            }
        }
    }
    free(out_q), free(out_T), free(before), free(place), free(code);
}
#endif

static long told(int argc, char **argv, int place, long usual)
{
    return argc > place ? atol(argv[place]) : usual;
}

int main(int argc, char **argv)
{
    enum { MOST = 19 };
    const long rounds = told(argc, argv, 1, 100), inverse = told(argc, argv, 2, 1), all = told(argc, argv, 3, 1);
    const long many = told(argc, argv, 4, 8);
    int function, code;
    for (round_number = 0; round_number < rounds; ++round_number) {
        real p_room[NP], z_room[MOST * NZ], q[MOST * N], T[MOST * 12];
        const int n = (int)below(MOST + 1), with_z = below(3) == 0, mild = below(2) == 0;
        const real *p = constants(OF(_p0), NP, p_room), *z = NULL;
        const int sparing = argc > 4, rows = sparing && round_number % many != 0 ? 1 : MOST;
        uint64_t drawn;
        int i;
        p = mild ? NULL : p;
        for (i = 0; i < rows; ++i) {
            z = constants(OF(_z0), NZ, z_room + NZ * i);
        }
        z = z ? z_room + NZ * (rows - 1) : NULL;
        for (i = 0; i < rows; ++i) {
            joints(q + N * i);
            pose(p, with_z ? z_room + NZ * i : NULL, T + 12 * i);
        }
        drawn = state;
        quick_row(p, z, q, T);
        if (round_number % inverse == 0) {
            one_row(p, z, q, T);
#if POINTED >= 0
            pointed(p, z, q, T);
#endif
        }
        if (round_number % (inverse * 4) == 0) {
            overlaps(p, z, q, T);
        }
#if OF(_HAS_STATE)
        update(q);
#endif
        state = sparing ? state : drawn; /* input of the next round does not depend on which functions there are */
#if BRANCHES
        if (round_number % all == 0) {
            all_rows(p, z, T);
        }
#endif
#if OF(_HAS_BATCH)
        if (round_number % many == 0) {
            many_rows(p, with_z, n, q, T, z_room);
        }
#endif
        (void)n, (void)all;
    }
    for (function = 0; function < FUNCTIONS; ++function) {
        for (code = 0; code < 5; ++code) {
            printf("%s %d %ld\n", names[function], code, counts[function][code]);
        }
    }
    fprintf(stderr, broken ? "%ld promises broken\n" : "", broken);
    return broken != 0;
}
