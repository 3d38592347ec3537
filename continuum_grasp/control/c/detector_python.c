/* A contact detector on doubles, for Python. */
#include "doubles.h"

typedef struct { contact_state state; contact_settings settings; contact_report report; } cg_object;

size_t cg_size(void) { return sizeof(cg_object); }
size_t cg_state_size(void) { return sizeof(contact_state); }
void cg_settings(cg_object *o, const double *values) { cg_fill(&o->settings, values); }

/* in: states of all members at the start */
void cg_start(cg_object *o, const double *in)
{
  cg_read(&o->settings.first[0][0], in, CONTACT_NM * CONTACT_NS);
  contact_start(&o->state, &o->settings);
}

/* in: y, u; out: the report */
int cg_step(cg_object *o, const double *in, double *out)
{
  real y[CONTACT_NY], u[CONTACT_NU];
  cg_read(u, cg_read(y, in, CONTACT_NY), CONTACT_NU);
  contact_step(&o->state, &o->settings, y, u, &o->report);
  out = cg_write(out, o->report.residual, CONTACT_ND);
  out = cg_write(out, o->report.low, CONTACT_ND);
  out = cg_write(out, o->report.high, CONTACT_ND);
  out = cg_write(out, o->report.gain, CONTACT_ND * CONTACT_NL);
  out = cg_write(out, o->report.threshold, CONTACT_NL);
  out = cg_write(out, o->report.force_low, CONTACT_NL);
  cg_write(out, o->report.force_high, CONTACT_NL);
  return o->report.verdict;
}
