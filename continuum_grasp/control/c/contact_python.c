/* The report of a contact detector as doubles. */
#include "doubles.h"

static double *cg_write_contact(double *out, const contact_report *report)
{
  out = cg_write_ints(out, &report->verdict, 1);
  out = cg_write(out, report->residual, CONTACT_ND);
  out = cg_write(out, report->low, CONTACT_ND);
  out = cg_write(out, report->high, CONTACT_ND);
  out = cg_write(out, report->gain, CONTACT_ND * CONTACT_NL);
  out = cg_write(out, report->threshold, CONTACT_NL);
  out = cg_write(out, report->force_low, CONTACT_NL);
  return cg_write(out, report->force_high, CONTACT_NL);
}
