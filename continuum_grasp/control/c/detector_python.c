/* A contact detector on doubles, for Python. */
#include "doubles.h"
#include "contact_python.c"

typedef struct { contact_state state; contact_settings settings; contact_report report; } cg_object;

size_t cg_size(void) { return sizeof(cg_object); }
size_t cg_state_size(void) { return sizeof(contact_state); }
void cg_settings(cg_object *o, const double *values) { cg_fill(&o->settings, values); }

/* in: states of all members at the start */
void cg_start(cg_object *o, const double *in)
{
  cg_read(&o->settings.first[0][0], in, CONTACT_NM * CONTACT_NS);
  contact_start(&o->state, &o->settings, 0);
}

/* in: y, u; out: the report */
int cg_step(cg_object *o, const double *in, double *out)
{
  real y[CONTACT_NY], u[CONTACT_NU];
  cg_read(u, cg_read(y, in, CONTACT_NY), CONTACT_NU);
  contact_step(&o->state, &o->settings, y, u, &o->report);
  cg_write_contact(out, &o->report);
  return o->report.verdict;
}
