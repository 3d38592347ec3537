/* The batch against the single step, to the last bit: good states and bad ones, counts that do not fill the lanes. With
   arguments "COUNT STEPS" says how many steps a second it takes, and how many the single step takes. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "<<p>>.h"

#define MOST 67

static double seconds(void) { return (double)clock() / CLOCKS_PER_SEC; }

static void fill(<<p>>_state *states, <<p>>_input *inputs, long count)
{
  long k;
  memset(states, 0, (size_t)count * sizeof *states);
  memset(inputs, 0, (size_t)count * sizeof *inputs);
  for (k = 0; k < count; ++k) {
    const <<p>>_real part = (<<p>>_real)(k % MOST) / MOST;<<if start>>
    <<p>>_state_init(&states[k]);<<end>>
    states[k].<<first_state>> = <<reach>> * (2 * part - 1);
    inputs[k].<<first_input>> = <<level>> * part;
  }
}

static long compare(void)
{
  <<p>>_state states[MOST], next[MOST], single;
  <<p>>_input inputs[MOST];<<if subject.forces>>
  static const <<p>>_forces forces[MOST];<<end>>
  int codes[MOST];
  long count, k, wrong = 0;
  <<p>>_model model;
  if (<<p>>_init(&model) < 0) return 1;
  for (count = 1; count <= MOST; ++count) {
    long refused = 0, said;
    fill(states, inputs, count);
    if (count > 5) states[5].<<first_state>> = 3 * <<reach>>;
    memset(next, 0, sizeof next);
    said = <<p>>_step_batch(&model, states, inputs, <<if subject.forces>>forces, <<end>><<h>>, next, codes, count);
    for (k = 0; k < count; ++k) {
      int code;
      memset(&single, 0, sizeof single);
      code = <<p>>_step(&model, &states[k], &inputs[k], <<if subject.forces>>&forces[k], <<end>><<h>>, &single);
      refused += code < 0;
      wrong += code != codes[k] || memcmp(&single, &next[k], sizeof single) != 0;
    }
    wrong += said != refused;
  }
  return wrong;
}

static int race(long count, long steps)
{
  <<p>>_state *states = malloc((size_t)count * sizeof *states);
  <<p>>_input *inputs = malloc((size_t)count * sizeof *inputs);<<if subject.forces>>
  <<p>>_forces *forces = calloc((size_t)count, sizeof *forces);<<end>>
  int *codes = malloc((size_t)count * sizeof *codes);
  <<p>>_model model;
  long k, step;
  double start, single, many;
  if (!states || !inputs<<if subject.forces>> || !forces<<end>> || !codes || <<p>>_init(&model) < 0) { /* the process ends then */
    free(states);
    free(inputs);<<if subject.forces>>
    free(forces);<<end>>
    free(codes);
    return 1;
  }
  fill(states, inputs, count);
  start = seconds();
  for (step = 0; step < steps; ++step)
    for (k = 0; k < count; ++k) <<p>>_step(&model, &states[k], &inputs[k], <<if subject.forces>>&forces[k], <<end>><<h>>, &states[k]);
  single = seconds() - start;
  fill(states, inputs, count);
  start = seconds();
  for (step = 0; step < steps; ++step) <<p>>_step_batch(&model, states, inputs, <<if subject.forces>>forces, <<end>><<h>>, states, codes, count);
  many = seconds() - start;
  printf("%.3g steps/s one by one, %.3g steps/s in lanes\n", (double)count * (double)steps / single,
         (double)count * (double)steps / many);
  free(states);
  free(inputs);<<if subject.forces>>
  free(forces);<<end>>
  free(codes);
  return 0;
}

int main(int count, char **words)
{
  const long wrong = compare();
  printf("%ld states of batches are not those of single steps\n", wrong);
  if (count > 2 && race(strtol(words[1], NULL, 10), strtol(words[2], NULL, 10))) return EXIT_FAILURE;
  return wrong ? EXIT_FAILURE : EXIT_SUCCESS;
}
