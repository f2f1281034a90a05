/* A function block that corrects joint positions by the calibration in truepose's generated C.

   FB_Compensate.st declares the same block, in the same order, for the IEC 61131-3 side. NAME, the machine's name in its
   file, is told by -DMACHINE=NAME; KIN_REAL is LREAL, or REAL where the C was written with --real float.
   Joints are in mm and rad, in the order of NAME_kin.h, and so is everything that is told of each joint. */
#ifndef FB_COMPENSATE_H
#define FB_COMPENSATE_H

#include "iec_types.h"

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define TEXT_(a) #a
#define TEXT(a) TEXT_(a)
#include TEXT(JOIN(MACHINE, _kin.h))

typedef JOIN(MACHINE, _real) KIN_REAL;
#define KIN_JOINTS JOIN(MACHINE, _N)
#define KIN_DRIVERS JOIN(MACHINE, _NZ)

/* nErrorID; 1 to 4 are the codes of NAME_compensate */
#define COMPENSATE_NOT_REACHABLE 1
#define COMPENSATE_ITERATION_LIMIT 2
#define COMPENSATE_JOINT_RANGE 3
#define COMPENSATE_BAD_INPUT 4
#define COMPENSATE_DRIVER_RANGE 17 /* a driver outside aDriverMin .. aDriverMax, or no number: a broken sensor */
#define COMPENSATE_MAX_STEP 18     /* an aMaxStep that is not above 0 */
#define COMPENSATE_MAX_CORRECTION 19 /* a correction above aMaxCorrection, or aActual farther than that from aNominal */

typedef struct FB_Compensate {
    /* VAR_INPUT */
    BOOL bEnable;
    KIN_REAL aNominal[KIN_JOINTS];       /* planned positions */
    KIN_REAL aActual[KIN_JOINTS];        /* where the drives are; read in the first cycle that is enabled */
    KIN_REAL aDriver[KIN_DRIVERS];       /* payload, temperatures: places and units of NAME_Z_... */
    KIN_REAL aDriverMin[KIN_DRIVERS];    /* what is believed of them */
    KIN_REAL aDriverMax[KIN_DRIVERS];
    KIN_REAL aMaxStep[KIN_JOINTS];       /* the correction changes by no more in a cycle */
    KIN_REAL aMaxCorrection[KIN_JOINTS]; /* and is never larger */
    /* VAR_OUTPUT */
    BOOL bValid;                   /* aCommand is this cycle's */
    BOOL bBusy;                    /* valid, but the correction is still on its way */
    BOOL bError;
    UDINT nErrorID;
    KIN_REAL aCommand[KIN_JOINTS]; /* the last valid one while bError; means nothing before the first */
    /* VAR */
    BOOL bStarted;                    /* there was a valid cycle since bEnable */
    KIN_REAL aCorrection[KIN_JOINTS]; /* aCommand less aNominal */
} FB_Compensate_typ;

/* Once, before the first cycle: not enabled, usual drivers, nothing limited but the steps, to 1e-4 mm or rad. */
void FB_Compensate_init(FB_Compensate_typ *self);

/* Every cycle. */
void FB_Compensate(FB_Compensate_typ *self);

#endif
