/* One second of the finger under <<what_input>>; writes time, state and code as CSV. */
#include <stdio.h>
#include <string.h>

#include "<<p>>.h"

int main(void)
{
  <<p>>_model model;
  <<p>>_state state;
  <<p>>_input input;<<if subject.forces>>
  <<p>>_forces forces;<<end>>
  const <<p>>_real h = <<h>>;
  const int steps = (int)(1 / h);
  int k, code = <<p>>_init(&model);
<<begin>>  memset(&input, 0, sizeof input);<<if subject.forces>>
  memset(&forces, 0, sizeof forces);<<end>>
  printf("time [s]<<csv_head>>,code\n");
  for (k = 0; k <= steps && code >= 0; ++k) {
    const <<p>>_real t = (<<p>>_real)k * h;
    printf("%.6g<<csv_format>>,%d\n", (double)t<<csv_values>>, code);
    input.<<first_input>> = <<level>><<onset>>;
    code = <<p>>_step(&model, &state, &input<<if subject.forces>>, &forces<<end>>, h, &state);
  }
  if (code < 0) fprintf(stderr, "%s\n", <<p>>_strerror(code));
  return code < 0;
}
