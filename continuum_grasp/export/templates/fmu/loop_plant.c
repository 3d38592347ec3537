/* A function of state, input, forces and parameters of now, or of a state and an input of before. */
static void fmu_call(fmu_instance *f, int (*function)(const double **, double **, long long *, double *, int),
                     const double *x, const double *u, double *to)
{
  const double *given[<<given>>];
  double *found[<<found>>];
  given[0] = x;
  given[1] = u;
  given[2] = f->data.values + FMU_FORCES;
  given[3] = f->data.values + FMU_PARAMETERS;
  found[0] = to;
  function(given, found, f->scratch.iw, f->scratch.w, 0);
}

static int fmu_finite(const double *numbers, int count)
{
  int k;
  for (k = 0; k < count; ++k)
    if (!(fabs(numbers[k]) <= 1.7976931348623157e308)) return 0;
  return 1;
}

/* Code of the first variable that cannot be taken. */
static int fmu_checked(const fmu_instance *f)
{
  int k;
  for (k = 0; k < FMU_REALS; ++k) {
    const fmu_variable *v = &fmu_variables[k];
    const double *value = f->data.values + k;
    if (v->kind == FMU_RESULT) continue;
    if (!fmu_finite(value, 1)) return <<P>>_ERR_NON_FINITE;
    if (*value < v->low || *value > v->high) return <<P>>_ERR_RANGE;
  }
  return <<P>>_OK;
}

static void fmu_remember(fmu_instance *f, const double *u)
{
  fmu_model *m = &f->data.model;
  const int times = m->begun ? 1 : <<past>>; /* before the start the finger was as it is at the start */
  int k;
  for (k = 0; k < times; ++k) {
    memmove(m->past[1], m->past[0], (<<past>> - 1) * sizeof m->past[0]);
    memcpy(m->past[0], f->data.values + FMU_STATE, <<model.nx>> * sizeof(double));
    memcpy(m->past[0] + <<model.nx>>, u, <<model.nu>> * sizeof(double));
  }
  m->begun = 1;
}

/* What sensors show, which are late; whether it is finite. */
static int fmu_measured(fmu_instance *f)
{
  static const double rest[] = {<<rest>>};
  double *values = f->data.values, seen[<<model.nx>>], measured[<<ny>> + 1];
  const double part = <<part>>; /* of a step, by which what is seen is older than a whole number of them */
  const fmu_model *m = &f->data.model;
  int k;
  if (f->data.mode != FMU_STEPPING) {
    f->data.model.begun = 0;
    fmu_remember(f, rest);
  }
  for (k = 0; k < <<model.nx>>; ++k)
    seen[k] = part > 0 ? m->past[<<past>> - 2][k] + part * (m->past[<<past>> - 1][k] - m->past[<<past>> - 2][k])
                       : m->past[<<past>> - 2][k];
  fmu_call(f, <<p>>_measured, seen, m->past[<<past>> - 2] + <<model.nx>>, measured);
  for (k = 0; k < <<ny>>; ++k) values[FMU_MEASUREMENT + k] = measured[k]<<if noisy>> + values[FMU_NOISE + k]<<end>>;
  return fmu_finite(measured, <<ny>>);
}

static fmu_level fmu_show(fmu_instance *f)
{
  double *values = f->data.values;
  int code = fmu_checked(f);
  if (code < 0) return fmu_judged(f, "show", code);
  fmu_call(f, <<p>>_shown, values + FMU_STATE, values + FMU_INPUTS, values + FMU_TIP);
  if (!fmu_finite(values + FMU_TIP, <<shown>>)) return fmu_judged(f, "show", <<P>>_ERR_RESULT);
  if (!fmu_measured(f)) return fmu_judged(f, "measure", <<P>>_ERR_RESULT);
  f->data.shown = 1;
  return FMU_OK;
}

static fmu_level fmu_advance(fmu_instance *f, double h)
{
  double *values = f->data.values, next[<<model.nx>>];
  int code = fmu_checked(f);
  (void)h; /* the internal step, always */
  if (code < 0) return fmu_judged(f, "step", code);
  fmu_call(f, <<p>>_plant_step, values + FMU_STATE, values + FMU_INPUTS, next);
  if (!fmu_finite(next, <<model.nx>>)) return fmu_judged(f, "step", <<P>>_ERR_RESULT);
  memcpy(values + FMU_STATE, next, sizeof next);
  fmu_remember(f, values + FMU_INPUTS);
  f->data.shown = 0;
  return fmu_judged(f, "step", <<P>>_OK);
}
