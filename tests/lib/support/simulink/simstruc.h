/* A small stand-in for Simulink's simstruc.h: the documented names that generated blocks use, on a plain struct.
   What Simulink keeps to itself (phases, signals anywhere in memory) is in simulink.c beside it. */
#ifndef STAND_IN_SIMSTRUC_H
#define STAND_IN_SIMSTRUC_H

#include <stddef.h>

typedef double real_T;
typedef int int_T;
typedef const real_T *const *InputRealPtrsType;

typedef struct {
    int is_double;
    size_t count;
    const double *values;
} mxArray;

#define mxIsDouble(array) ((array)->is_double)
#define mxGetNumberOfElements(array) ((array)->count)
#define mxGetPr(array) ((array)->values)
#define mxGetScalar(array) ((array)->values[0])

enum { MOST_PORTS = 4, MOST_VALUES = 4096 };

typedef struct {
    const char *error;
    mxArray parameters[4];
    int parameters_given, parameters_expected, tunable[4];
    int inputs, outputs, input_width[MOST_PORTS], output_width[MOST_PORTS], feedthrough[MOST_PORTS];
    int continuous, discrete, sample_times, reals, integers, pointers, modes, crossings;
    unsigned options;
    double sample_time, offset;
    int inherits, major;
    real_T real_work[MOST_VALUES];
    int_T integer_work[MOST_PORTS];
    real_T signal[MOST_PORTS][2 * MOST_VALUES], output[MOST_PORTS][MOST_VALUES];
    const real_T *pointer[MOST_PORTS][MOST_VALUES];
} SimStruct;

#define SS_PRM_NOT_TUNABLE 0
#define SS_PRM_TUNABLE 1
#define SS_OPTION_EXCEPTION_FREE_CODE 1u
#define INHERITED_SAMPLE_TIME (-1.0)

#define ssSetErrorStatus(S, text) ((S)->error = (text))
#define ssGetErrorStatus(S) ((S)->error)
#define ssSetNumSFcnParams(S, n) ((S)->parameters_expected = (n))
#define ssGetNumSFcnParams(S) ((S)->parameters_expected)
#define ssGetSFcnParamsCount(S) ((S)->parameters_given)
#define ssGetSFcnParam(S, k) ((const mxArray *)&(S)->parameters[k])
#define ssSetSFcnParamTunable(S, k, may) ((S)->tunable[k] = (may))
#define ssSetNumContStates(S, n) ((S)->continuous = (n))
#define ssSetNumDiscStates(S, n) ((S)->discrete = (n))
#define ssSetNumInputPorts(S, n) ((S)->inputs = (n), (n) <= MOST_PORTS)
#define ssSetNumOutputPorts(S, n) ((S)->outputs = (n), (n) <= MOST_PORTS)
#define ssSetInputPortWidth(S, k, n) ((S)->input_width[k] = (n))
#define ssSetOutputPortWidth(S, k, n) ((S)->output_width[k] = (n))
#define ssSetInputPortDirectFeedThrough(S, k, yes) ((S)->feedthrough[k] = (yes))
#define ssSetNumSampleTimes(S, n) ((S)->sample_times = (n))
#define ssSetNumRWork(S, n) ((S)->reals = (n))
#define ssSetNumIWork(S, n) ((S)->integers = (n))
#define ssSetNumPWork(S, n) ((S)->pointers = (n))
#define ssSetNumModes(S, n) ((S)->modes = (n))
#define ssSetNumNonsampledZCs(S, n) ((S)->crossings = (n))
#define ssSetOptions(S, flags) ((S)->options = (flags))
#define ssSetSampleTime(S, k, time) ((void)(k), (S)->sample_time = (time))
#define ssSetOffsetTime(S, k, time) ((void)(k), (S)->offset = (time))
#define ssSetModelReferenceSampleTimeDefaultInheritance(S) ((S)->inherits = 1)
#define ssGetInputPortRealSignalPtrs(S, k) ((InputRealPtrsType)(S)->pointer[k])
#define ssGetOutputPortRealSignal(S, k) ((S)->output[k])
#define ssGetRWork(S) ((S)->real_work)
#define ssGetIWorkValue(S, k) ((S)->integer_work[k])
#define ssSetIWorkValue(S, k, value) ((S)->integer_work[k] = (value))
#define ssIsMajorTimeStep(S) ((S)->major)

#endif
