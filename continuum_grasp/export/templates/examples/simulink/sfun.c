/* The finger as a Simulink S-function (level 2): states from the inputs, by one Runge-Kutta step per sample.
 *
 *   mex -I../../include sfun_<<p>>.c ../../src/<<p>>.c ../../src/<<p>>_kernels.c
 *
 * Block parameters: sample time [s], initial state (<<subject.moving.nx>> numbers), run-time parameters (<<subject.moving.np>> numbers in the order of
 * <<p>>_parameters, [] for those that the package was made with). Input ports: input (<<subject.input.size>>)<<if subject.forces>>, forces (<<subject.moving.nw>>)<<end>>. Output: state.
 * An error of the library stops the simulation with its sentence. */
#define S_FUNCTION_NAME sfun_<<p>>
#define S_FUNCTION_LEVEL 2

#include "simstruc.h"

#include <string.h>

#include "<<p>>.h"

#define PERIOD(S) (*mxGetPr(ssGetSFcnParam(S, 0)))
#define START(S) ssGetSFcnParam(S, 1)
#define PARAMETERS(S) ssGetSFcnParam(S, 2)
#define PARAMETER_COUNT <<subject.moving.np>>

static void mdlInitializeSizes(SimStruct *S)
{
  ssSetNumSFcnParams(S, 3);
  if (ssGetNumSFcnParams(S) != ssGetSFcnParamsCount(S)) return;
  if (mxGetNumberOfElements(START(S)) != <<P>>_NX) {
    ssSetErrorStatus(S, "the initial state has <<subject.moving.nx>> entries");
    return;
  }
  if (mxGetNumberOfElements(PARAMETERS(S)) != 0 && mxGetNumberOfElements(PARAMETERS(S)) != PARAMETER_COUNT) {
    ssSetErrorStatus(S, "there are <<subject.moving.np>> run-time parameters, or [] for the nominal ones");
    return;
  }
  if (<<p>>_check() < 0) {
    ssSetErrorStatus(S, <<p>>_strerror(<<p>>_check()));
    return;
  }
  ssSetNumDiscStates(S, <<P>>_NX);
  if (!ssSetNumInputPorts(S, <<if subject.forces>>2<<else>>1<<end>>)) return;
  ssSetInputPortWidth(S, 0, <<P>>_NU);<<if subject.forces>>
  ssSetInputPortWidth(S, 1, <<P>>_NW);<<end>>
  if (!ssSetNumOutputPorts(S, 1)) return;
  ssSetOutputPortWidth(S, 0, <<P>>_NX);
  ssSetNumSampleTimes(S, 1);
}

static void mdlInitializeSampleTimes(SimStruct *S)
{
  ssSetSampleTime(S, 0, PERIOD(S));
  ssSetOffsetTime(S, 0, 0.0);
}

#define MDL_INITIALIZE_CONDITIONS
static void mdlInitializeConditions(SimStruct *S)
{
  memcpy(ssGetRealDiscStates(S), mxGetPr(START(S)), <<P>>_NX * sizeof(real_T));
}

static void mdlOutputs(SimStruct *S, int_T tid)
{
  (void)tid;
  memcpy(ssGetOutputPortRealSignal(S, 0), ssGetRealDiscStates(S), <<P>>_NX * sizeof(real_T));
}

/* Numbers of a port, as the library wants them. */
static void read_port(SimStruct *S, int_T port, int_T count, <<p>>_real *to)
{
  InputRealPtrsType from = ssGetInputPortRealSignalPtrs(S, port);
  int_T k;
  for (k = 0; k < count; ++k) to[k] = (<<p>>_real)*from[k];
}

/* The model with the block's parameters. */
static int make_model(SimStruct *S, <<p>>_model *model)
{
  const int code = <<p>>_init(model);
  (void)S;<<if subject.moving.np>>
  <<p>>_real numbers[PARAMETER_COUNT];
  size_t k;
  if (mxGetNumberOfElements(PARAMETERS(S)) == 0) return code;
  for (k = 0; k < PARAMETER_COUNT; ++k) numbers[k] = (<<p>>_real)mxGetPr(PARAMETERS(S))[k];
  memcpy(&model->parameters, numbers, sizeof model->parameters);<<end>>
  return code;
}

#define MDL_UPDATE
static void mdlUpdate(SimStruct *S, int_T tid)
{
  <<p>>_model model;
  <<p>>_state state;
  <<p>>_input input;<<if subject.forces>>
  <<p>>_forces forces;<<end>>
  <<p>>_real numbers[<<most_port>>];
  real_T *x = ssGetRealDiscStates(S);
  int k, code = make_model(S, &model);
  (void)tid;
  for (k = 0; k < <<P>>_NX; ++k) numbers[k] = (<<p>>_real)x[k];
  memcpy(&state, numbers, sizeof state);
  read_port(S, 0, <<P>>_NU, numbers);
  memcpy(&input, numbers, sizeof input);<<if subject.forces>>
  read_port(S, 1, <<P>>_NW, numbers);
  memcpy(&forces, numbers, sizeof forces);<<end>>
  if (code >= 0) code = <<p>>_step(&model, &state, &input<<if subject.forces>>, &forces<<end>>, (<<p>>_real)PERIOD(S), &state);
  if (code < 0) {
    ssSetErrorStatus(S, <<p>>_strerror(code));
    return;
  }
  memcpy(numbers, &state, sizeof state);
  for (k = 0; k < <<P>>_NX; ++k) x[k] = (real_T)numbers[k];
}

static void mdlTerminate(SimStruct *S) { (void)S; }

#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif
