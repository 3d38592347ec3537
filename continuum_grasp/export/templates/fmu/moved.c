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
<<if late>>
static void fmu_remember(fmu_instance *f, const double *u);
static int fmu_measured(fmu_instance *f);
<<end>>
static fmu_level fmu_show(fmu_instance *f)
{
  double *values = f->data.values;
  int code = fmu_checked(f);
  if (code < 0) return fmu_judged(f, "show", code);
  fmu_call(f, <<p>>_shown, values + FMU_STATE, values + FMU_INPUTS, values + FMU_TIP);
  if (!fmu_finite(values + FMU_TIP, <<shown>>)) return fmu_judged(f, "show", <<P>>_ERR_RESULT);<<if late>>
  if (!fmu_measured(f)) return fmu_judged(f, "measure", <<P>>_ERR_RESULT);<<end>>
  f->data.shown = 1;
  return FMU_OK;
}

static fmu_level fmu_advance(fmu_instance *f)
{
  double *values = f->data.values, next[<<nx>>], ahead[<<nx>>];
  int k, code = fmu_checked(f);
  if (code < 0) return fmu_judged(f, "step", code);
  memcpy(next, values + FMU_STATE, sizeof next);
  for (k = 0; k < <<substeps>>; ++k) {
    fmu_call(f, <<p>>_plant_step, next, values + FMU_INPUTS, ahead);
    memcpy(next, ahead, sizeof next);
  }
  if (!fmu_finite(next, <<nx>>)) return fmu_judged(f, "step", <<P>>_ERR_RESULT);
  memcpy(values + FMU_STATE, next, sizeof next);<<if late>>
  fmu_remember(f, values + FMU_INPUTS);<<end>>
  f->data.shown = 0;
  return fmu_judged(f, "step", <<P>>_OK);
}
