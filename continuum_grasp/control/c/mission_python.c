/* The phases of a mission on doubles, for Python. */
#include "doubles.h"

typedef struct { mission_state state; mission_settings settings; } cg_object;

size_t cg_size(void) { return sizeof(cg_object); }
size_t cg_state_size(void) { return sizeof(mission_state); }
void cg_settings(cg_object *o, const double *values) { cg_fill(&o->settings, values); }

/* out: phase, whether weights and limits changed, decision, forces, grip, what was noticed, whether forces are asked for,
 * height lost; weights, least and greatest command */
static void cg_state(const cg_object *o, double *out)
{
  const int numbers[] = {o->state.phase, o->state.changed, o->state.decision, o->state.bears, o->state.grip, o->state.noticed,
                         mission_asks(&o->state, &o->settings)};
  out = cg_write_ints(out, numbers, 7);
  out = cg_write(out, &o->state.lost, 1);
  out = cg_write(out, o->settings.weights[o->state.follows], MISSION_NR);
  out = cg_write(out, o->state.u_min, MISSION_NU);
  cg_write(out, o->state.u_max, MISSION_NU);
}

/* in: t, command, forces, what is reported, what that is worth, height of the object; what: a phase that begins, or
 * -1: what is due, -2: by forces, -3: release, -4: abort, -5: squeeze */
int cg_step(cg_object *o, const double *in, int what, double *out)
{
  const double t = *in++;
  real u[MISSION_NU], forces[MISSION_SIZE(MISSION_NC)];
  in = cg_read(forces, cg_read(u, in, MISSION_NU), MISSION_NC);
  int goes_on = 1;
  o->state.changed = 0;
  o->state.sight = (int)in[1];
  if (what == 0) mission_start(&o->state, &o->settings, t, u);
  if (what == 0 || what == -1) mission_see(&o->state, &o->settings, (real)in[2]);
  if (what > 0) mission_enter(&o->state, &o->settings, what, t, u);
  else if (what == -5) mission_squeeze(&o->state, &o->settings, MISSION_REPORTED);
  else if (what == -3 || what == -4) mission_release(&o->state, &o->settings, t, u, what == -4);
  else if (what) goes_on = mission_advance(&o->state, &o->settings, t, what == -2 ? forces : 0, u, (int)*in);
  cg_state(o, out);
  return goes_on;
}

/* in: instants, of the plan where it is asked for that */
void cg_rows(const cg_object *o, const double *in, int count, int of_plan, double *out)
{
  real row[MISSION_SIZE(MISSION_NR)];
  for (int k = 0; k < count; ++k) {
    if (of_plan) mission_planned(&o->settings, in[k], row);
    else mission_setpoints(&o->state, &o->settings, in[k], row);
    out = cg_write(out, row, MISSION_NR);
  }
}
