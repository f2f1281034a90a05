/* arm3_batch.h: many poses a call, for programs on computers with vector units; needs arm3_kin.c. Generated
   by truepose. Do not edit.

   n rows; p: one set of parameters for all, or NULL; z: NULL, or n rows of arm3_NZ drivers; code: NULL, or n return
   codes as those of arm3_kin.h. Returns how many rows did not end with 0; their outputs are left as they were. */
#ifndef arm3_BATCH_H
#define arm3_BATCH_H

#include "arm3_kin.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Poses T (n x 12) at joints q (n x arm3_N). */
int arm3_fk_n(const arm3_real *p, const arm3_real *z, int n, const arm3_real *q, arm3_real *T, int *code);

/* Joints q (n x arm3_N) for poses T (n x 12) near q_guess, which may be q. */
int arm3_ik_n(const arm3_real *p, const arm3_real *z, int n, const arm3_real *T,
    const arm3_real *q_guess, arm3_real *q, int *code);

/* Corrected commands q (n x arm3_N) for nominal ones, which may be q. */
int arm3_compensate_n(const arm3_real *p, const arm3_real *z, int n, const arm3_real *q_nominal,
    arm3_real *q, int *code);

/* The same of compensate_near, with what is left of the turns (n), rad. */
int arm3_compensate_near_n(const arm3_real *p, const arm3_real *z, int n, const arm3_real *q_nominal,
    arm3_real *q, arm3_real *left, int *code);

#ifdef __cplusplus
}
#endif

#endif
