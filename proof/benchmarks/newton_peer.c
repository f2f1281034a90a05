/* Newton's method on a forward model and Jacobian that CasADi wrote: the peer of benchmarks/embedded_features.py.
   `model` (q -> pose as [R|p] row by row, Jacobian column after column) stands above; NAME_ is set by the compiler's user.
   Full steps, elimination with pivots, nothing checked but convergence and the ranges of numbers that the pose implies. */

enum { N = PEER(N), ROUNDS = 12 };

static int evaluate(const real *q, real *T, real *J)
{
    const real *in[CASADI_ARGS] = { q };
    real *out[CASADI_RESULTS] = { T, J };
    casadi_int iw[CASADI_INTS];
    real w[CASADI_REALS];
    return model(in, out, iw, w, 0);
}

/* What takes the pose C to T: mm, and a vector along the axis of the turn. */
static void way(const real *T, const real *C, real *e)
{
    int i;
    e[3] = e[4] = e[5] = 0;
    for (i = 0; i < 3; ++i) {
        const real a = C[i], b = C[4 + i], c = C[8 + i], u = T[i], v = T[4 + i], w = T[8 + i];
        e[i] = T[4 * i + 3] - C[4 * i + 3];
        e[3] += HALF * (b * w - c * v);
        e[4] += HALF * (c * u - a * w);
        e[5] += HALF * (a * v - b * u);
    }
}

static int eliminate(real *J, real *e)
{
    int i, j, k;
    for (k = 0; k < N; ++k) {
        int best = k;
        for (i = k + 1; i < N; ++i) {
            best = ABS(J[k * 6 + i]) > ABS(J[k * 6 + best]) ? i : best;
        }
        if (!(ABS(J[k * 6 + best]) > SMALL)) {
            return 0;
        }
        for (j = 0; j < N; ++j) {
            const real swap = J[j * 6 + k];
            J[j * 6 + k] = J[j * 6 + best];
            J[j * 6 + best] = swap;
        }
        {
            const real swap = e[k];
            e[k] = e[best];
            e[best] = swap;
        }
        for (i = k + 1; i < N; ++i) {
            const real share = J[k * 6 + i] / J[k * 6 + k];
            for (j = k + 1; j < N; ++j) {
                J[j * 6 + i] -= share * J[j * 6 + k];
            }
            e[i] -= share * e[k];
        }
    }
    for (k = N - 1; k >= 0; --k) {
        for (j = k + 1; j < N; ++j) {
            e[k] -= J[j * 6 + k] * e[j];
        }
        e[k] /= J[k * 6 + k];
    }
    return 1;
}

int PEER(fk)(const real *p, const real *z, const real q[N], real T[12])
{
    real C[12], J[6 * N];
    int i;
    (void)p;
    (void)z;
    (void)evaluate(q, C, J);
    for (i = 0; i < 12; ++i) {
        if (!(ABS(C[i]) <= LARGE)) {
            return 4;
        }
    }
    for (i = 0; i < 12; ++i) {
        T[i] = C[i];
    }
    return 0;
}

int PEER(fk_from)(const real *p, const real *z, const real q[N], const real T_guess[12], real T[12])
{
    (void)T_guess;
    return PEER(fk)(p, z, q, T);
}

int PEER(ik)(const real *p, const real *z, const real T[12], const real q_guess[N], real q[N])
{
    real y[N], C[12], J[6 * N], e[6];
    int k, j;
    (void)p;
    (void)z;
    for (j = 0; j < N; ++j) {
        y[j] = q_guess[j];
    }
    for (k = 0; k < ROUNDS; ++k) {
        (void)evaluate(y, C, J);
        way(T, C, e);
        if (e[0] * e[0] + e[1] * e[1] + e[2] * e[2] <= MET_MM * MET_MM &&
            e[3] * e[3] + e[4] * e[4] + e[5] * e[5] <= MET_RAD * MET_RAD) {
            for (j = 0; j < N; ++j) {
                q[j] = y[j];
            }
            return 0;
        }
        if (!eliminate(J, e)) {
            return 2;
        }
        for (j = 0; j < N; ++j) {
            y[j] += e[j];
        }
    }
    return 2;
}

int PEER(jac)(const real *p, const real *z, const real q[N], real J[6 * N])
{
    real C[12], columns[6 * N];
    int i, j;
    (void)p;
    (void)z;
    (void)evaluate(q, C, columns);
    for (i = 0; i < 6 * N; ++i) {
        if (!(ABS(columns[i]) <= LARGE)) {
            return 4;
        }
    }
    for (i = 0; i < 6; ++i) {
        for (j = 0; j < N; ++j) {
            J[i * N + j] = columns[6 * j + i];
        }
    }
    return 0;
}

int PEER(compensate)(const real *p, const real *z, const real q_nominal[N], real q[N])
{
    real T[12];
    const int code = PEER(fk)(p, z, q_nominal, T); /* of the same constants: the peer has but these */
    return code ? code : PEER(ik)(p, z, T, q_nominal, q);
}
