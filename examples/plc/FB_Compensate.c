/* The function block of FB_Compensate.h. No heap and no static data: as many blocks as there are robots. */
#include "FB_Compensate.h"

#include <string.h>

#define COMPENSATE JOIN(MACHINE, _compensate)
#define USUAL JOIN(MACHINE, _z0)

void FB_Compensate_init(FB_Compensate_typ *self)
{
    const KIN_REAL any = (KIN_REAL)1e30, step = (KIN_REAL)1e-4;
    int k;
    memset(self, 0, sizeof *self);
    for (k = 0; k < KIN_DRIVERS; ++k) {
        self->aDriver[k] = USUAL[k];
        self->aDriverMin[k] = -any;
        self->aDriverMax[k] = any;
    }
    for (k = 0; k < KIN_JOINTS; ++k) {
        self->aMaxStep[k] = step;
        self->aMaxCorrection[k] = any;
    }
}

/* A comparison with a NaN is false. */
static int within(KIN_REAL value, KIN_REAL low, KIN_REAL high)
{
    return value >= low && value <= high;
}

/* What NAME_compensate does not check itself; 0, or nErrorID. */
static UDINT check_limits(const FB_Compensate_typ *self)
{
    int k;
    for (k = 0; k < KIN_DRIVERS; ++k) {
        if (!within(self->aDriver[k], self->aDriverMin[k], self->aDriverMax[k])) {
            return COMPENSATE_DRIVER_RANGE;
        }
    }
    for (k = 0; k < KIN_JOINTS; ++k) {
        if (!(self->aMaxStep[k] > 0)) {
            return COMPENSATE_MAX_STEP;
        }
    }
    return 0;
}

/* The corrections that are wanted and where to start from; 0, or nErrorID. */
static UDINT wanted_correction(const FB_Compensate_typ *self, KIN_REAL wanted[KIN_JOINTS], KIN_REAL start[KIN_JOINTS])
{
    UDINT code = (UDINT)COMPENSATE(0, self->aDriver, self->aNominal, wanted);
    int k;
    for (k = 0; code == 0 && k < KIN_JOINTS; ++k) {
        const KIN_REAL most = self->aMaxCorrection[k];
        wanted[k] -= self->aNominal[k];
        start[k] = self->bStarted ? self->aCorrection[k] : self->aActual[k] - self->aNominal[k];
        if (!within(wanted[k], -most, most) || !within(start[k], -most, most)) {
            code = COMPENSATE_MAX_CORRECTION;
        }
    }
    return code;
}

/* The correction goes from start towards wanted, by aMaxStep at most; whether any joint's is still on its way. */
static BOOL approach(FB_Compensate_typ *self, const KIN_REAL wanted[KIN_JOINTS], const KIN_REAL start[KIN_JOINTS])
{
    BOOL late = FALSE;
    int k;
    for (k = 0; k < KIN_JOINTS; ++k) {
        const KIN_REAL most = self->aMaxStep[k], way = wanted[k] - start[k];
        if (within(way, -most, most)) {
            self->aCorrection[k] = wanted[k];
        } else {
            self->aCorrection[k] = start[k] + (way > 0 ? most : -most);
            late = TRUE;
        }
        self->aCommand[k] = self->aNominal[k] + self->aCorrection[k];
    }
    return late;
}

void FB_Compensate(FB_Compensate_typ *self)
{
    KIN_REAL wanted[KIN_JOINTS], start[KIN_JOINTS];
    UDINT code = 0;
    if (self->bEnable) {
        code = check_limits(self);
        if (code == 0) {
            code = wanted_correction(self, wanted, start);
        }
    }
    self->nErrorID = code;
    self->bError = code != 0 ? TRUE : FALSE;
    self->bValid = self->bEnable && code == 0 ? TRUE : FALSE;
    self->bBusy = self->bValid ? approach(self, wanted, start) : FALSE;
    self->bStarted = self->bEnable && (self->bStarted || self->bValid) ? TRUE : FALSE;
}
