/* The controller as a Simulink S-function (level 2), sampled every <<loop.period:.12g>> s.
 *
 *   mex -I../../include sfun_<<p>>_control.c<<mex_sources>>
 *
 * Input ports: measurement (<<loop.measurement.size>>, NaN: not measured), reference (<<loop.stages.nr>>, which holds for the whole horizon). Output ports:
 * command (<<loop.command.size>>), code (1). A negative code stops the simulation with its sentence; positive ones warn.
 * Block parameters: settings (<<loop.settings.size>> numbers in the order of <<p>>_settings, [] for those of the scene)<<if known>>, known (<<known>>, [] as well)<<end>>. They may be
 * tuned while it runs. */
#define S_FUNCTION_NAME sfun_<<p>>_control
#define S_FUNCTION_LEVEL 2

#include "simstruc.h"

#include <string.h>

#include "<<p>>.h"

#define MEASURED <<loop.measurement.size>>
#define WANTED <<loop.stages.nr>>
#define NODES <<loop.nodes>>
#define COMMANDED <<loop.command.size>>
#define DOUBLES(type) ((int_T)((sizeof(type) + sizeof(real_T) - 1) / sizeof(real_T)))

/* Numbers of a block parameter, where there are any; whether their count is right. */
static int read_parameter(SimStruct *S, int_T which, size_t count, <<p>>_real *to)
{
  const mxArray *given = ssGetSFcnParam(S, which);
  size_t k;
  if (mxGetNumberOfElements(given) == 0) return 1;
  if (mxGetNumberOfElements(given) != count) return 0;
  for (k = 0; k < count; ++k) to[k] = (<<p>>_real)mxGetPr(given)[k];
  return 1;
}

static void mdlInitializeSizes(SimStruct *S)
{
  ssSetNumSFcnParams(S, <<if known>>2<<else>>1<<end>>);
  if (ssGetNumSFcnParams(S) != ssGetSFcnParamsCount(S)) return;
  if (!ssSetNumInputPorts(S, 2)) return;
  ssSetInputPortWidth(S, 0, MEASURED);
  ssSetInputPortWidth(S, 1, WANTED);
  ssSetInputPortDirectFeedThrough(S, 0, 1);
  ssSetInputPortDirectFeedThrough(S, 1, 1);
  if (!ssSetNumOutputPorts(S, 2)) return;
  ssSetOutputPortWidth(S, 0, COMMANDED);
  ssSetOutputPortWidth(S, 1, 1);
  ssSetNumDWork(S, 2);
  ssSetDWorkWidth(S, 0, DOUBLES(<<p>>_controller));
  ssSetDWorkWidth(S, 1, DOUBLES(<<p>>_controller_work));
  ssSetNumSampleTimes(S, 1);
}

static void mdlInitializeSampleTimes(SimStruct *S)
{
  ssSetSampleTime(S, 0, <<loop.period:.12g>>);
  ssSetOffsetTime(S, 0, 0.0);
}

#define MDL_START
static void mdlStart(SimStruct *S)
{
  int code = <<p>>_check();
  if (code >= 0) code = <<p>>_controller_init((<<p>>_controller *)ssGetDWork(S, 0));
  if (code < 0) ssSetErrorStatus(S, <<p>>_strerror(code));
}

static void mdlOutputs(SimStruct *S, int_T tid)
{
  InputRealPtrsType measured = ssGetInputPortRealSignalPtrs(S, 0), wanted = ssGetInputPortRealSignalPtrs(S, 1);
  real_T *commanded = ssGetOutputPortRealSignal(S, 0);
  <<p>>_measurement measurement;
  <<p>>_reference reference;
  <<p>>_command command;
  <<p>>_real numbers[MEASURED], rows[WANTED][NODES], found[COMMANDED];
  <<p>>_controller *controller = (<<p>>_controller *)ssGetDWork(S, 0);
  int_T j, k;
  int code;
  (void)tid;
<<for k, struct in structs>>  {
    <<p>>_real values[<<struct.size>>];
    memcpy(values, &controller-><<struct.name>>, sizeof values);
    if (!read_parameter(S, <<k>>, <<struct.size>>, values)) {
      ssSetErrorStatus(S, "<<struct.name>>: <<struct.size>> numbers, or []");
      return;
    }
    memcpy(&controller-><<struct.name>>, values, sizeof values);
  }
<<end>>  for (k = 0; k < MEASURED; ++k) numbers[k] = (<<p>>_real)*measured[k];
  for (j = 0; j < WANTED; ++j)
    for (k = 0; k < NODES; ++k) rows[j][k] = (<<p>>_real)*wanted[j];
  memcpy(&measurement, numbers, sizeof measurement);
  memcpy(&reference, rows, sizeof reference);
  code = <<p>>_mpc(controller, (<<p>>_controller_work *)ssGetDWork(S, 1), &measurement,
                   &reference, &command);
  if (code < 0) {
    ssSetErrorStatus(S, <<p>>_strerror(code));
    return;
  }
  memcpy(found, &command, sizeof found);
  for (k = 0; k < COMMANDED; ++k) commanded[k] = (real_T)found[k];
  *ssGetOutputPortRealSignal(S, 1) = (real_T)code;
}

static void mdlTerminate(SimStruct *S) { (void)S; }

#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif
