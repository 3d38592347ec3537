/* The hooks of loop.c by the package's real-time iteration, whose C stands above. SETTINGS are the bytes of its
 * settings, ITERATIONS is how many a step has. */
static rti_plan plan;
static rti_work work;
static rti_settings settings;
static const unsigned char nominal[sizeof(rti_settings)] = {SETTINGS};
static double input[RTI_NU];
static const double *last_p, *last_refs;

void solver_start(const double *x0, const double *u0)
{
  real x[RTI_NX], u[RTI_NU];
  for (int i = 0; i < RTI_NX; ++i) x[i] = (real)x0[i];
  for (int i = 0; i < RTI_NU; ++i) u[i] = (real)u0[i];
  memcpy(&settings, nominal, sizeof settings);
  rti_start(&plan, x, u);
}

void solver_shift(void)
{
  rti_shift(&plan, &settings, 1);
}

void solver_prepare(const double *p, const double *refs)
{
  last_p = p;
  last_refs = refs;
#ifdef RTI_SINGLE
  static real given_p[RTI_SIZE(RTI_NP)], given_refs[(RTI_N + 1) * RTI_SIZE(RTI_NR)];
  for (int i = 0; i < RTI_NP; ++i) given_p[i] = (real)p[i];
  for (int i = 0; i < (RTI_N + 1) * RTI_NR; ++i) given_refs[i] = (real)refs[i];
  rti_prepare(&work, &plan, &settings, given_p, given_refs);
#else
  rti_prepare(&work, &plan, &settings, p, refs);
#endif
}

int solver_feedback(const double *x0)
{
  rti_report report;
  real x[RTI_NX];
  for (int i = 0; i < RTI_NX; ++i) x[i] = (real)x0[i];
  int status = rti_feedback(&work, &plan, &settings, x, &report);
  for (int k = 1; k < ITERATIONS && status >= 0; ++k) {
    solver_prepare(last_p, last_refs);
    status = rti_feedback(&work, &plan, &settings, x, &report);
  }
  for (int i = 0; i < RTI_NU; ++i) input[i] = (double)plan.u[0][i];
  return status == RTI_ITERATION_LIMIT ? -100 : status;
}

const double *solver_input(void)
{
  return input;
}

void solver_plan(double *to)
{
  for (int k = 0; k <= RTI_N; ++k)
    for (int i = 0; i < RTI_NX; ++i) *to++ = (double)plan.x[k][i];
  for (int k = 0; k < RTI_N; ++k)
    for (int i = 0; i < RTI_NU; ++i) *to++ = (double)plan.u[k][i];
}
