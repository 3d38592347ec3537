static void fmu_call(fmu_instance *f,
                     int (*function)(const double **, double **, long long *, double *, int), const double *x,
                     const double *u, const double *w, double *to, double *further)
{
  const double *given[<<given>>];
  double *found[<<found>>];
  given[0] = x;
  given[1] = u;
  given[2] = w;
  found[0] = to;
  found[1] = further;
  function(given, found, f->scratch.iw, f->scratch.w, 0);
}

static int fmu_finite(const double *numbers, int count)
{
  int k;
  for (k = 0; k < count; ++k)
    if (!(fabs(numbers[k]) <= 1.7976931348623157e308)) return 0;
  return 1;
}

static void fmu_remember(fmu_instance *f, const double *u)
{
  fmu_model *m = &f->data.model;
  const int times = m->begun ? 1 : FMU_PAST; /* before the start the finger was as it is at the start */
  int k;
  for (k = 0; k < times; ++k) {
    memmove(m->past[1], m->past[0], (FMU_PAST - 1) * sizeof m->past[0]);
    memcpy(m->past[0], f->data.values + FMU_STATE, <<nx>> * sizeof(double));
    memcpy(m->past[0] + <<nx>>, u, <<nu>> * sizeof(double));
  }
  m->begun = 1;
}

static fmu_level fmu_show(fmu_instance *f)
{
  static const double rest[] = {<<rest>>};
  double *values = f->data.values, seen[<<nx>>], measured[<<ny>> + 1], w[<<nw>> + 1] = {0};
  const double part = <<part>>; /* of a step, by which what is seen is older than a whole number of them */
  const fmu_model *m = &f->data.model;
  int k;<<if forces>>
  memcpy(w, values + FMU_FORCES, <<nw>> * sizeof *w);<<end>>
  if (f->data.mode != FMU_STEPPING) {
    f->data.model.begun = 0;
    fmu_remember(f, rest);
  }
  for (k = 0; k < <<nx>>; ++k)
    seen[k] = part > 0 ? m->past[FMU_PAST - 2][k] + part * (m->past[FMU_PAST - 1][k] - m->past[FMU_PAST - 2][k])
                       : m->past[FMU_PAST - 2][k];
  fmu_call(f, <<p>>_measured, seen, m->past[FMU_PAST - 2] + <<nx>>, w, measured, NULL);
  for (k = 0; k < <<ny>>; ++k) values[FMU_MEASUREMENT + k] = measured[k]<<if noise>> + values[FMU_NOISE + k]<<end>>;
  fmu_call(f, <<p>>_seen_tip, values + FMU_STATE, values + FMU_COMMAND, w, values + FMU_TIP, NULL);
  if (!fmu_finite(values + FMU_TIP, 3) || !fmu_finite(measured, <<ny>>)) return fmu_judged(f, "measure", <<P>>_ERR_RESULT);
  f->data.shown = 1;
  return FMU_OK;
}

static fmu_level fmu_advance(fmu_instance *f)
{
  double *values = f->data.values, next[<<nx>>], w[<<nw>> + 1] = {0};<<if forces>>
  memcpy(w, values + FMU_FORCES, <<nw>> * sizeof *w);<<end>>
  if (!fmu_finite(values + FMU_COMMAND, <<nu>>) || !fmu_finite(w, <<nw>>))
    return fmu_judged(f, "step", <<P>>_ERR_NON_FINITE);
  fmu_call(f, <<p>>_plant_step, values + FMU_STATE, values + FMU_COMMAND, w, next, NULL);
  if (!fmu_finite(next, <<nx>>)) return fmu_judged(f, "step", <<P>>_ERR_RESULT);
  memcpy(values + FMU_STATE, next, sizeof next);
  fmu_remember(f, values + FMU_COMMAND);
  f->data.shown = 0;
  return fmu_judged(f, "step", <<P>>_OK);
}

