/* example.c: forward and inverse kinematics of "arm3" against poses that truepose computed.
   Prints the largest errors; exits with 0 when all are within tolerance. */
#include "arm3_kin.h"

#include <math.h>
#include <stdio.h>

typedef arm3_real real;

enum { COUNT = 8 };

static const real joints[COUNT][arm3_N] = {
    { 2.4579928f, -1.122383f, 0.9888392f },
    { -1.0181339f, 1.9440243f, 1.9776784f },
    { 1.4398588f, 0.8216413f, -1.2222725f },
    { 0.4217249f, -1.4231246f, 0.75540596f },
    { 2.8797176f, 1.6432827f, 1.7442452f },
    { 0.8434498f, 1.3425411f, 1.5108119f },
    { -0.17468417f, -0.90222484f, -0.70029986f },
    { 2.2833085f, -2.0246077f, 0.2885394f },
};

static const real poses[COUNT][12] = {
    { -0.7685086f, -0.100605614f, -0.6318806f, -455.022f, 0.6261449f, 0.084976315f, -0.7750623f, 343.39664f, 0.1316705f, -0.99129087f, -0.0023113417f, 707.1834f },
    { -0.36994275f, 0.3728411f, 0.85095936f, -163.79329f, 0.6015812f, -0.6018593f, 0.5252289f, 302.50815f, 0.70798475f, 0.7062258f, -0.0016407223f, 175.77734f },
    { 0.120065235f, 0.052828915f, -0.9913594f, 65.16677f, 0.913902f, 0.384163f, 0.13115604f, 642.1858f, 0.38777244f, -0.92175263f, -0.0021558315f, 143.27827f },
    { 0.7175822f, 0.5635744f, -0.4092184f, 342.02246f, 0.32134724f, 0.25336963f, 0.9124362f, 174.31935f, 0.61790913f, -0.78624916f, 0.00071048515f, 912.37164f },
    { 0.9355495f, -0.24032208f, -0.25882906f, 302.4465f, -0.2517956f, 0.06008296f, -0.9659136f, -100.87967f, 0.24768157f, 0.96883196f, -0.004301458f, -12.195701f },
    { -0.6379149f, -0.18799543f, -0.74680805f, -144.07666f, -0.7169565f, -0.20903994f, 0.6650381f, -133.28029f, -0.28113684f, 0.9596666f, -0.0014348603f, -187.86273f },
    { -0.028328022f, 0.9842799f, 0.1743292f, 287.15152f, 0.004346782f, -0.17427626f, 0.9846872f, -31.466639f, 0.9995892f, 0.028652012f, 0.0006584518f, 964.11896f },
    { 0.10567576f, -0.6454339f, -0.75647056f, 103.81085f, -0.12540089f, 0.7460072f, -0.65402436f, -153.41109f, 0.986462f, 0.1639766f, -0.0021031043f, 1004.5706f },
};

/* How far the guess of the inverse stands from the solution. */
static const real aside[arm3_N] = { 0.048089407f, 0.048089407f, 0.048089407f };

static real larger(real a, real b)
{
    return a >= b ? a : b; /* a NaN b is told by the return code */
}

/* Largest position (mm) and rotation (entry of R) difference of two poses so far. */
static void compare(const real *a, const real *b, real *position, real *rotation)
{
    int i;
    for (i = 0; i < 12; ++i) {
        real *worst = i % 4 == 3 ? position : rotation;
        *worst = larger(*worst, fabsf(a[i] - b[i]));
    }
}

/* The same of what the inverse meets: x and y of the tool's position along axes of the base and the turn about the tool's z axis. */
static void compare_task(const real *goal, const real *T, real *position, real *rotation)
{
    real E[9]; /* T from the goal, along the goal's axes */
    int i;
    for (i = 0; i < 9; ++i) {
        const real *a = goal + i / 3, *b = T + i % 3;
        E[i] = a[0] * b[0] + a[4] * b[4] + a[8] * b[8];
    }
    *position = larger(*position, fabsf(goal[3] - T[3]));
    *position = larger(*position, fabsf(goal[7] - T[7]));
    *rotation = larger(*rotation, 0.5f * fabsf(E[3] - E[1]));
}

int main(void)
{
    real position = 0.0f, rotation = 0.0f;
    int k, j, failed = 0;
    for (k = 0; k < COUNT; ++k) {
        real T[12], q[arm3_N];
        if (arm3_fk(0, 0, joints[k], T) != 0) {
            ++failed;
            continue;
        }
        compare(T, poses[k], &position, &rotation);
        for (j = 0; j < arm3_N; ++j) {
            q[j] = joints[k][j] + aside[j];
        }
        if (arm3_ik(0, 0, poses[k], q, q) != 0 || arm3_fk_from(0, 0, q, poses[k], T) != 0) {
            ++failed;
            continue;
        }
        compare_task(poses[k], T, &position, &rotation);
    }
    printf("arm3: %d of %d poses failed; largest error %.2e mm, %.2e rad\n", failed, COUNT, (double)position, (double)rotation);
    return failed == 0 && position <= 0.00623838f && rotation <= 6e-06f ? 0 : 1;
}
