/* What Simulink does with a block, in the order in which it does it. A block's file includes this at its end, as it
   includes Simulink's own; the functions below are called from Python. */
#include <stdlib.h>

SimStruct *block_new(int parameters, const double *function, const double *p, int count);
const char *block_error(const SimStruct *S);
void block_sizes(const SimStruct *S, int *sizes);
void block_step(SimStruct *S, const double *inputs, double *outputs, int major);
void block_free(SimStruct *S);

SimStruct *block_new(int parameters, const double *function, const double *p, int count)
{
    SimStruct *S = calloc(1, sizeof *S);
    int port, i;
    if (S == NULL) {
        return NULL;
    }
    S->parameters_given = parameters;
    S->parameters[0] = (mxArray){ 1, 1, function };
    S->parameters[1] = (mxArray){ 1, (size_t)count, p };
    mdlInitializeSizes(S);
    if (S->error != NULL || S->parameters_given != S->parameters_expected) {
        return S;
    }
    mdlInitializeSampleTimes(S);
    for (port = 0; port < S->inputs; ++port) {
        for (i = 0; i < S->input_width[port]; ++i) {
            S->pointer[port][i] = &S->signal[port][2 * (S->input_width[port] - i)]; /* neither in order nor in a row */
        }
    }
    for (i = 0; i < MOST_VALUES; ++i) {
        S->real_work[i] = 1e30; /* nobody promises zeros */
    }
    S->integer_work[0] = 99;
#ifdef MDL_START
    mdlStart(S);
#endif
    return S;
}

const char *block_error(const SimStruct *S)
{
    return S->error;
}

/* Inputs, outputs, the widths of both, feedthrough of all inputs, work vectors, states. */
void block_sizes(const SimStruct *S, int *sizes)
{
    int port, through = 1;
    *sizes++ = S->inputs;
    *sizes++ = S->outputs;
    for (port = 0; port < S->inputs; ++port) {
        *sizes++ = S->input_width[port];
        through &= S->feedthrough[port];
    }
    for (port = 0; port < S->outputs; ++port) {
        *sizes++ = S->output_width[port];
    }
    *sizes++ = through;
    *sizes++ = S->reals;
    *sizes++ = S->integers;
    *sizes = S->continuous + S->discrete + S->pointers + S->modes + S->crossings;
}

/* Inputs and outputs of all ports one after the other. */
void block_step(SimStruct *S, const double *inputs, double *outputs, int major)
{
    int port, i;
    for (port = 0; port < S->inputs; ++port) {
        for (i = 0; i < S->input_width[port]; ++i) {
            S->signal[port][2 * (S->input_width[port] - i)] = *inputs++;
        }
    }
    for (port = 0; port < S->outputs; ++port) {
        for (i = 0; i < S->output_width[port]; ++i) {
            S->output[port][i] = 1e30; /* the memory of an output may have served others */
        }
    }
    S->major = major;
    mdlOutputs(S, 0);
    for (port = 0; port < S->outputs; ++port) {
        for (i = 0; i < S->output_width[port]; ++i) {
            *outputs++ = S->output[port][i];
        }
    }
}

void block_free(SimStruct *S)
{
    mdlTerminate(S);
    free(S);
}
