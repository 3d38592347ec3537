/* The tip of a tendon-driven finger goes to a line x = TARGET under a proportional-integral law, all of it in C: the plant
 * is finger_step, what is measured is finger_tip, the law pulls one tendon or the other. Writes CSV.
 *
 * Made for a package of configs/simulate/tendon_step.yaml; see README.md. */
#include <stdio.h>

#include "finger.h"

#define PERIOD 0.002 /* s */
#define DURATION 4.0 /* s */
#define TARGET -0.06 /* m */
#define PROPORTIONAL 5.0 /* N/m */
#define INTEGRAL 150.0 /* N/(m s) */
#define LEAST 1.0 /* N, so that no tendon goes slack */
#define MOST 20.0 /* N */

static finger_real clamp(finger_real value, finger_real low, finger_real high)
{
  return value < low ? low : value > high ? high : value;
}

int main(void)
{
  finger_model model;
  finger_state state = {0};
  finger_input input = {0};
  finger_section tip;
  finger_real sum = 0;
  int k, code = finger_init(&model);
  printf("time [s],tip x [m],tip y [m],tension 1 [N],tension 2 [N]\n");
  for (k = 0; code >= 0 && k * PERIOD <= DURATION; ++k) {
    finger_real missing, pull;
    code = finger_tip(&model, &state, &input, &tip);
    if (code < 0) break;
    missing = tip.x - (finger_real)TARGET; /* tendon 1 bends the finger towards -x */
    sum = clamp(sum + (finger_real)(INTEGRAL * PERIOD) * missing, -(finger_real)MOST, (finger_real)MOST);
    pull = (finger_real)PROPORTIONAL * missing + sum;
    input.tension_1 = clamp((finger_real)LEAST + pull, (finger_real)LEAST, (finger_real)MOST);
    input.tension_2 = clamp((finger_real)LEAST - pull, (finger_real)LEAST, (finger_real)MOST);
    printf("%.4f,%.9g,%.9g,%.6g,%.6g\n", k * PERIOD, (double)tip.x, (double)tip.y, (double)input.tension_1,
           (double)input.tension_2);
    code = finger_step(&model, &state, &input, (finger_real)PERIOD, &state);
  }
  if (code < 0) fprintf(stderr, "%s\n", finger_strerror(code));
  return code < 0;
}
