/* ---- FMI 3.0: types and functions by the names that the standard gives them ---- */

<<names>>#ifndef fmi3FunctionTypes_h /* the headers of the standard declare the same */
#include <stdbool.h>
#include <stdint.h>
typedef void *fmi3Instance, *fmi3InstanceEnvironment, *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8, fmi3Byte;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean, fmi3Clock;
typedef const char *fmi3String;
typedef const fmi3Byte *fmi3Binary;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent, fmi3Constant, fmi3Fixed, fmi3Tunable, fmi3Discrete, fmi3Dependent } fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged } fmi3IntervalQualifier;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean, fmi3Boolean,
                                               fmi3Boolean, fmi3Boolean *, fmi3Float64 *);
typedef void (*fmi3LockPreemptionCallback)(void);
typedef void (*fmi3UnlockPreemptionCallback)(void);
/* Prototypes, which compilers like to see. */
<<prototypes>>
#endif

static void fmu_send(const fmu_instance *f, fmu_level level, const char *text)
{
  static const char *const categories[] = {"logAll", "logStatusWarning", "logStatusDiscard", "logStatusError"};
  ((fmi3LogMessageCallback)f->log)(f->environment, (fmi3Status)level, categories[level], text);
}

<<shared>>
FMI3(fmi3Instance, fmi3InstantiateCoSimulation)(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                                fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                                const fmi3ValueReference required[], size_t n_required,
                                                fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                                fmi3IntermediateUpdateCallback update)
{
  fmu_instance *f = event_mode || n_required ? NULL : fmu_made(name, token);
  (void)resources;
  (void)visible;
  (void)early_return;
  (void)required;
  (void)update;
  if (!f) {
    if (log)
      log(environment, fmi3Error, "logStatusError",
          "InstantiateCoSimulation: expected a name, the token of modelDescription.xml, no event mode and no intermediate "
          "variables");
    return NULL;
  }
  f->logging = logging;
  f->log = (void (*)(void))log;
  f->environment = environment;
  return f;
}

FMI3(fmi3Instance, fmi3InstantiateModelExchange)(fmi3String name, fmi3String token, fmi3String resources,
                                                 fmi3Boolean visible, fmi3Boolean logging,
                                                 fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
  (void)name;
  (void)token;
  (void)resources;
  (void)visible;
  (void)logging;
  if (log) log(environment, fmi3Error, "logStatusError", "this FMU is for co-simulation");
  return NULL;
}

FMI3(fmi3Instance, fmi3InstantiateScheduledExecution)(fmi3String name, fmi3String token, fmi3String resources,
                                                      fmi3Boolean visible, fmi3Boolean logging,
                                                      fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                                      fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                                      fmi3UnlockPreemptionCallback unlock)
{
  (void)name;
  (void)token;
  (void)resources;
  (void)visible;
  (void)logging;
  (void)update;
  (void)lock;
  (void)unlock;
  if (log) log(environment, fmi3Error, "logStatusError", "this FMU is for co-simulation");
  return NULL;
}

FMI3(fmi3Status, fmi3EnterInitializationMode)(fmi3Instance instance, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                              fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop)
{
  const fmu_level level = fmu_enter((fmu_instance *)instance);
  (void)has_tolerance; /* the steps are as long as they are */
  (void)tolerance;
  (void)has_stop;
  (void)stop;
  if (level != FMU_OK) return (fmi3Status)level;
  if (!(fabs(start) <= 1e12)) return fmi3_refused(instance, "EnterInitializationMode: the start time is no time");
  ((fmu_instance *)instance)->data.time = start;
  return fmi3OK;
}

FMI3(fmi3Status, fmi3DoStep)(fmi3Instance instance, fmi3Float64 from, fmi3Float64 length, fmi3Boolean no_way_back,
                             fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached)
{
  fmu_level level;
  (void)no_way_back;
  if (!instance) return fmi3Error;
  if (!event || !terminate || !early || !reached) return fmi3_refused(instance, "DoStep: a pointer is null");
  level = fmu_walk((fmu_instance *)instance, from, length);
  *event = *terminate = *early = false;
  *reached = ((fmu_instance *)instance)->data.time;
  return (fmi3Status)level;
}

/* ---- the rest of the standard, of which this FMU has nothing ---- */

<<others>>
