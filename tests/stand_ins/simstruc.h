/* What the S-function uses of Simulink's header, to compile it where there is none. */
#include <stddef.h>

typedef struct SimStruct SimStruct;
typedef struct mxArray mxArray;
typedef double real_T;
typedef int int_T;
typedef const real_T *const *InputRealPtrsType;

double *mxGetPr(const mxArray *array);
size_t mxGetNumberOfElements(const mxArray *array);
const mxArray *ssGetSFcnParam(SimStruct *S, int_T index);
void ssSetNumSFcnParams(SimStruct *S, int_T count);
int_T ssGetNumSFcnParams(SimStruct *S);
int_T ssGetSFcnParamsCount(SimStruct *S);
void ssSetErrorStatus(SimStruct *S, const char *text);
void ssSetNumDiscStates(SimStruct *S, int_T count);
int_T ssSetNumInputPorts(SimStruct *S, int_T count);
void ssSetInputPortWidth(SimStruct *S, int_T port, int_T width);
int_T ssSetNumOutputPorts(SimStruct *S, int_T count);
void ssSetOutputPortWidth(SimStruct *S, int_T port, int_T width);
void ssSetInputPortDirectFeedThrough(SimStruct *S, int_T port, int_T whether);
void ssSetNumDWork(SimStruct *S, int_T count);
void ssSetDWorkWidth(SimStruct *S, int_T index, int_T width);
void *ssGetDWork(SimStruct *S, int_T index);
void ssSetNumSampleTimes(SimStruct *S, int_T count);
void ssSetSampleTime(SimStruct *S, int_T index, real_T period);
void ssSetOffsetTime(SimStruct *S, int_T index, real_T offset);
real_T *ssGetRealDiscStates(SimStruct *S);
real_T *ssGetOutputPortRealSignal(SimStruct *S, int_T port);
InputRealPtrsType ssGetInputPortRealSignalPtrs(SimStruct *S, int_T port);
