/* The tip of a tendon-driven finger follows setpoints under predictive control, all of it in C: the plant is plant_step
 * of one package, estimator and controller are finger_mpc of another, which knows a coarser and softer finger. A camera
 * sees the tip with noise, and for a moment does not see it. Writes CSV.
 *
 * Made for packages of controller.yaml and plant.yaml; see README.md. */
#include <stdint.h>
#include <stdio.h>

#include "finger.h"
#include "plant.h"

#define PERIOD ((double)FINGER_PERIOD)
#define STEPS 20 /* of the plant in a period */
#define CALLS 300
#define NOISE 0.0003 /* m */
#define BLIND_FROM 40 /* calls between which nothing is seen */
#define BLIND_TO 45

static const double targets[3][2] = {{-0.0827, 0.1515}, {-0.1067, 0.1267}, {-0.0308, 0.1764}}; /* m, one each second */

/* Numbers between -1 and 1; xorshift, G. Marsaglia, doi:10.18637/jss.v008.i14 */
static double noise(uint32_t *seed)
{
  *seed ^= *seed << 13;
  *seed ^= *seed >> 17;
  *seed ^= *seed << 5;
  return (double)*seed / 2147483648.0 - 1.0;
}

static void look_ahead(int call, finger_reference *reference)
{
  int node;
  for (node = 0; node < FINGER_NODES; ++node) {
    const int second = (call + node) / 100 < 2 ? (call + node) / 100 : 2;
    reference->tip_x[node] = (finger_real)targets[second][0];
    reference->tip_y[node] = (finger_real)targets[second][1];
    reference->bending_rate_1[node] = reference->bending_rate_2[node] = 0;
    reference->tension_1[node] = reference->tension_2[node] = 1; /* N, the least */
    reference->tension_1_rate[node] = reference->tension_2_rate[node] = 0;
  }
}

int main(void)
{
  static finger_controller controller;
  static finger_controller_work work;
  static finger_reference reference;
  plant_model plant;
  plant_state state = {0};
  plant_input input = {1, 1};
  uint32_t seed = 1;
  int call, step, code = finger_controller_init(&controller);
  if (code < 0 || plant_init(&plant) < 0) return 1;
  printf("time [s],tip x [m],tip y [m],target x [m],target y [m],tension 1 [N],tension 2 [N],missing moment [N m],anomalies,code\n");
  for (call = 0; call < CALLS; ++call) {
    plant_section tip;
    finger_measurement measurement;
    finger_command command;
    finger_estimate estimate;
    finger_diagnosis diagnosis;
    if ((code = plant_tip(&plant, &state, &input, &tip)) < 0) break;
    finger_measurement_init(&measurement);
    measurement.tip_x = (finger_real)(tip.x + NOISE * noise(&seed));
    measurement.tip_y = (finger_real)(tip.y + NOISE * noise(&seed));
    if (call >= BLIND_FROM && call < BLIND_TO) finger_measurement_init(&measurement);
    look_ahead(call, &reference);
    code = finger_mpc(&controller, &work, &measurement, &reference, &command);
    if (code < 0) {
      fprintf(stderr, "%s\n", finger_strerror(code));
      return 1;
    }
    finger_controller_estimate(&controller, &estimate);
    finger_controller_diagnosis(&controller, &diagnosis);
    printf("%.3f,%.9g,%.9g,%.9g,%.9g,%.6g,%.6g,%.6g,%lu,%d\n", call * PERIOD, (double)tip.x, (double)tip.y,
           (double)reference.tip_x[0], (double)reference.tip_y[0], (double)command.tension_1, (double)command.tension_2,
           (double)estimate.missing_tip_moment, (unsigned long)diagnosis.anomalies, code);
    input.tension_1 = (plant_real)command.tension_1;
    input.tension_2 = (plant_real)command.tension_2;
    for (step = 0; step < STEPS && code >= 0; ++step)
      code = plant_step(&plant, &state, &input, (plant_real)(PERIOD / STEPS), &state);
    if (code < 0) break;
  }
  if (code < 0) fprintf(stderr, "%s\n", plant_strerror(code));
  return code < 0;
}
