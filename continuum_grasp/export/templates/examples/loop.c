/* One second of the finger under a constant input<<if onset>> that sets in smoothly<<end>>; writes time, state and code as CSV. */
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
<<if start>>  if (code >= 0) code = <<p>>_state_init(&state);
<<else>>  memset(&state, 0, sizeof state);
<<end>>  memset(&input, 0, sizeof input);<<if subject.forces>>
  memset(&forces, 0, sizeof forces);<<end>>
  printf("time [s]<<for f in subject.state.fields>>,<<f.name>> [<<f.unit>>]<<end>>,code\n");
  for (k = 0; k <= steps && code >= 0; ++k) {
    const <<p>>_real t = (<<p>>_real)k * h;
    printf("%.6g<<for f in subject.state.fields>>,%.9g<<end>>,%d\n", (double)t<<for f in subject.state.fields>>,
           (double)state.<<f.name>><<end>>, code);
    input.<<first_input>> = <<level>><<if onset>> * (t < <<onset>> ? t / <<onset>> : 1)<<end>>;
    code = <<p>>_step(&model, &state, &input<<if subject.forces>>, &forces<<end>>, h, &state);
  }
  if (code < 0) fprintf(stderr, "%s\n", <<p>>_strerror(code));
  return code < 0;
}
