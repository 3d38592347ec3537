/* ---- FMI 2.0: types and functions by the names that the standard gives them ---- */

<<names>>#ifndef fmi2FunctionTypes_h /* the headers of the standard declare the same */
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

<<shared>>
FMI2(const char *, fmi2GetTypesPlatform)(void) { return "default"; }

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
  f->data.time = start;
  return fmi2OK;
}

FMI2(fmi2Status, fmi2EnterInitializationMode)(fmi2Component c) { return (fmi2Status)fmu_enter((fmu_instance *)c); }

FMI2(fmi2Status, fmi2DoStep)(fmi2Component c, fmi2Real from, fmi2Real length, fmi2Boolean no_way_back)
{
  (void)no_way_back;
  return (fmi2Status)fmu_walk((fmu_instance *)c, from, length);
}

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
  *value = ((fmu_instance *)c)->data.time;
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

/* ---- the rest of the standard, of which this FMU has nothing ---- */

<<others>>
