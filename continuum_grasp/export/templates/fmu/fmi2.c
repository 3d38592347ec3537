/* ---- FMI 2.0: types and functions by the names that the standard gives them ---- */

#if !defined(FMI2_Export)
#if defined _WIN32 || defined __CYGWIN__
#define FMI2_Export __declspec(dllexport)
#elif defined __GNUC__
#define FMI2_Export __attribute__((visibility("default")))
#else
#define FMI2_Export
#endif
#endif
/* Where sources of several FMUs are linked together, each has its own names. */
#ifdef FMI2_FUNCTION_PREFIX
#define FMI2_JOINED(a, b) a##b
#define FMI2_NAMED(a, b) FMI2_JOINED(a, b)
#define FMI2_NAME(name) FMI2_NAMED(FMI2_FUNCTION_PREFIX, name)
#else
#define FMI2_NAME(name) name
#endif
#define FMI2(type, name) FMI2_Export type FMI2_NAME(name)

#ifndef fmi2FunctionTypes_h /* the headers of the standard declare the same */
typedef void *fmi2Component, *fmi2ComponentEnvironment, *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef char fmi2Byte;
typedef const char *fmi2String;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef void (*fmi2CallbackLogger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
typedef struct {
  fmi2CallbackLogger logger;
  void *(*allocateMemory)(size_t, size_t);
  void (*freeMemory)(void *);
  void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
  fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;
/* Prototypes, which compilers like to see. */
<<prototypes>>
#endif

static void fmu_send(const fmu_instance *f, fmu_level level, const char *text)
{
  static const char *const categories[] = {"logAll", "logStatusWarning", "logStatusDiscard", "logStatusError"};
  ((fmi2CallbackLogger)f->log)(f->environment, f->name, (fmi2Status)level, categories[level], "%s", text);
}

static fmi2Status fmi2_refused(fmi2Component c, const char *what)
{
  return c ? (fmi2Status)fmu_say((fmu_instance *)c, FMU_ERROR, "%s", what) : fmi2Error;
}

FMI2(const char *, fmi2GetTypesPlatform)(void) { return "default"; }

FMI2(const char *, fmi2GetVersion)(void) { return "2.0"; }

FMI2(fmi2Status, fmi2SetDebugLogging)(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
  (void)n;
  (void)categories;
  if (!c) return fmi2Error;
  ((fmu_instance *)c)->logging = on;
  return fmi2OK;
}

FMI2(fmi2Component, fmi2Instantiate)(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                     const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
  fmu_instance *f = type == fmi2CoSimulation ? fmu_made(name, guid) : NULL;
  (void)resources;
  (void)visible;
  if (!f) {
    if (functions && functions->logger)
      functions->logger(functions->componentEnvironment, name, fmi2Error, "logStatusError", "%s",
                        "Instantiate: expected a name, co-simulation, and the guid of modelDescription.xml");
    return NULL;
  }
  f->logging = logging;
  f->log = functions ? (void (*)(void))functions->logger : NULL;
  f->environment = functions ? functions->componentEnvironment : NULL;
  return f;
}

FMI2(void, fmi2FreeInstance)(fmi2Component c) { free(c); }

FMI2(fmi2Status, fmi2SetupExperiment)(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                                      fmi2Boolean has_stop, fmi2Real stop)
{
  fmu_instance *f = (fmu_instance *)c;
  const fmu_level level = fmu_allowed(f, FMU_INSTANTIATED, "SetupExperiment");
  (void)has_tolerance; /* the steps are as long as they are */
  (void)tolerance;
  (void)has_stop;
  (void)stop;
  if (level != FMU_OK) return (fmi2Status)level;
  if (!(fabs(start) <= 1e12)) return fmi2_refused(c, "SetupExperiment: the start time is no time");
  f->data.begin = start;
  return fmi2OK;
}

FMI2(fmi2Status, fmi2EnterInitializationMode)(fmi2Component c) { return (fmi2Status)fmu_enter((fmu_instance *)c); }

FMI2(fmi2Status, fmi2ExitInitializationMode)(fmi2Component c) { return (fmi2Status)fmu_exit((fmu_instance *)c); }

FMI2(fmi2Status, fmi2Terminate)(fmi2Component c)
{
  const fmu_level level = fmu_allowed((fmu_instance *)c, FMU_STEPPING, "Terminate");
  if (level == FMU_OK) ((fmu_instance *)c)->data.mode = FMU_TERMINATED;
  return (fmi2Status)level;
}

FMI2(fmi2Status, fmi2Reset)(fmi2Component c)
{
  if (!c) return fmi2Error;
  fmu_restart((fmu_instance *)c);
  return fmi2OK;
}

FMI2(fmi2Status, fmi2GetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
  return (fmi2Status)fmu_get((fmu_instance *)c, vr, n, value);
}

FMI2(fmi2Status, fmi2GetInteger)(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
{
  return (fmi2Status)fmu_get_counts((fmu_instance *)c, vr, n, value);
}

FMI2(fmi2Status, fmi2GetBoolean)(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
{
  (void)vr;
  (void)value;
  return n ? fmi2_refused(c, "there is no variable of type Boolean") : fmi2OK;
}

FMI2(fmi2Status, fmi2GetString)(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{
  (void)vr;
  (void)value;
  return n ? fmi2_refused(c, "there is no variable of type String") : fmi2OK;
}

FMI2(fmi2Status, fmi2SetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
  return (fmi2Status)fmu_set((fmu_instance *)c, vr, n, value);
}

FMI2(fmi2Status, fmi2SetInteger)(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
{
  (void)vr;
  (void)value;
  return n ? fmi2_refused(c, "there is no variable of type Integer to be set") : fmi2OK;
}

FMI2(fmi2Status, fmi2SetBoolean)(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
{
  (void)vr;
  (void)value;
  return n ? fmi2_refused(c, "there is no variable of type Boolean") : fmi2OK;
}

FMI2(fmi2Status, fmi2SetString)(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
  (void)vr;
  (void)value;
  return n ? fmi2_refused(c, "there is no variable of type String") : fmi2OK;
}

FMI2(fmi2Status, fmi2GetFMUstate)(fmi2Component c, fmi2FMUstate *state)
{
  fmu_data *made;
  if (!c || !state) return fmi2Error;
  made = fmu_copied(&((fmu_instance *)c)->data);
  if (!made) return fmi2_refused(c, "no memory");
  free(*state);
  *state = made;
  return fmi2OK;
}

FMI2(fmi2Status, fmi2SetFMUstate)(fmi2Component c, fmi2FMUstate state)
{
  if (!c || !state) return fmi2Error;
  memcpy(&((fmu_instance *)c)->data, state, sizeof(fmu_data));
  return fmi2OK;
}

FMI2(fmi2Status, fmi2FreeFMUstate)(fmi2Component c, fmi2FMUstate *state)
{
  (void)c;
  if (state) {
    free(*state);
    *state = NULL;
  }
  return fmi2OK;
}

FMI2(fmi2Status, fmi2SerializedFMUstateSize)(fmi2Component c, fmi2FMUstate state, size_t *size)
{
  if (!c || !state || !size) return fmi2Error;
  *size = FMU_BYTES;
  return fmi2OK;
}

FMI2(fmi2Status, fmi2SerializeFMUstate)(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
  return (fmi2Status)fmu_packed((fmu_instance *)c, (const fmu_data *)state, bytes, size);
}

FMI2(fmi2Status, fmi2DeSerializeFMUstate)(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
  fmu_data *made = NULL;
  const fmu_level level = state ? fmu_unpacked((fmu_instance *)c, bytes, size, &made) : FMU_ERROR;
  if (level == FMU_OK) {
    free(*state);
    *state = made;
  }
  return (fmi2Status)level;
}

FMI2(fmi2Status, fmi2GetDirectionalDerivative)(fmi2Component c, const fmi2ValueReference unknowns[], size_t n,
                                               const fmi2ValueReference knowns[], size_t m, const fmi2Real seed[],
                                               fmi2Real sensitivity[])
{<<if linear>>
  return (fmi2Status)fmu_directional((fmu_instance *)c, unknowns, n, knowns, m, seed, sensitivity);<<end>><<if plain>>
  (void)unknowns;
  (void)n;
  (void)knowns;
  (void)m;
  (void)seed;
  (void)sensitivity;
  return fmi2_refused(c, "GetDirectionalDerivative: not provided");<<end>>
}

FMI2(fmi2Status, fmi2SetRealInputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                              const fmi2Integer order[], const fmi2Real value[])
{
  (void)vr;
  (void)order;
  (void)value;
  return n ? fmi2_refused(c, "SetRealInputDerivatives: inputs are held, not interpolated") : fmi2OK;
}

FMI2(fmi2Status, fmi2GetRealOutputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                               const fmi2Integer order[], fmi2Real value[])
{
  (void)vr;
  (void)order;
  (void)value;
  return n ? fmi2_refused(c, "GetRealOutputDerivatives: not provided") : fmi2OK;
}

FMI2(fmi2Status, fmi2DoStep)(fmi2Component c, fmi2Real from, fmi2Real length, fmi2Boolean no_way_back)
{
  (void)no_way_back;
  return (fmi2Status)fmu_walk((fmu_instance *)c, from, length);
}

FMI2(fmi2Status, fmi2CancelStep)(fmi2Component c) { return fmi2_refused(c, "CancelStep: steps end before DoStep returns"); }

FMI2(fmi2Status, fmi2GetStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
  (void)kind;
  (void)value;
  return c ? fmi2Discard : fmi2Error; /* no step is ever pending */
}

FMI2(fmi2Status, fmi2GetRealStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
  if (!c || !value) return fmi2Error;
  if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
  *value = fmu_time((fmu_instance *)c);
  return fmi2OK;
}

FMI2(fmi2Status, fmi2GetIntegerStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
  (void)kind;
  (void)value;
  return c ? fmi2Discard : fmi2Error;
}

FMI2(fmi2Status, fmi2GetBooleanStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
  if (!c || !value) return fmi2Error;
  if (kind != fmi2Terminated) return fmi2Discard;
  *value = 0; /* a model never ends of itself */
  return fmi2OK;
}

FMI2(fmi2Status, fmi2GetStringStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
  (void)kind;
  (void)value;
  return c ? fmi2Discard : fmi2Error;
}
