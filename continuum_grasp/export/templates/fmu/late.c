
static void fmu_remember(fmu_instance *f, const double *u)
{
  fmu_model *m = &f->data.model;
  const int times = m->begun ? 1 : <<past>>; /* before the start the finger was as it is at the start */
  int k;
  for (k = 0; k < times; ++k) {
    memmove(m->past[1], m->past[0], (<<past>> - 1) * sizeof m->past[0]);
    memcpy(m->past[0], f->data.values + FMU_STATE, <<nx>> * sizeof(double));
    memcpy(m->past[0] + <<nx>>, u, <<nu>> * sizeof(double));
  }
  m->begun = 1;
}

/* What sensors show, which are late; whether it is finite. */
static int fmu_measured(fmu_instance *f)
{
  static const double rest[] = {<<rest>>};
  double *values = f->data.values, seen[<<nx>>], measured[<<ny>> + 1];
  const double part = <<part>>; /* of a step, by which what is seen is older than a whole number of them */
  const fmu_model *m = &f->data.model;
  int k;
  if (f->data.mode != FMU_STEPPING) {
    f->data.model.begun = 0;
    fmu_remember(f, rest);
  }
  for (k = 0; k < <<nx>>; ++k)
    seen[k] = part > 0 ? m->past[<<past>> - 2][k] + part * (m->past[<<past>> - 1][k] - m->past[<<past>> - 2][k])
                       : m->past[<<past>> - 2][k];
  fmu_call(f, <<p>>_measured, seen, m->past[<<past>> - 2] + <<nx>>, measured);
  for (k = 0; k < <<ny>>; ++k) values[FMU_MEASUREMENT + k] = measured[k]<<noise>>;
  return fmu_finite(measured, <<ny>>);
}
