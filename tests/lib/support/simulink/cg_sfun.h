/* What Simulink's generated code does with a block's functions: it has them by address. */
typedef struct {
    void (*sizes)(SimStruct *), (*times)(SimStruct *), (*start)(SimStruct *), (*stop)(SimStruct *);
    void (*outputs)(SimStruct *, int_T);
} block_functions;

extern const block_functions S_FUNCTION_NAME;
const block_functions S_FUNCTION_NAME = {
    mdlInitializeSizes, mdlInitializeSampleTimes, mdlStart, mdlTerminate, mdlOutputs
};
