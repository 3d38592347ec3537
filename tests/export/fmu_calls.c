/* Random calls of an FMU (FMI 2.0): two instances, any order, any numbers; for sanitizers. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

static unsigned long seed = 1;
static unsigned drawn(unsigned most)
{
  seed = seed * 6364136223846793005ul + 1442695040888963407ul;
  return (unsigned)(seed >> 33) % most;
}
static double number(void)
{
  static const double odd[] = {0, -0.0, 1e300, -1e300, 5e-324, 0.001, 0.002, 1e-9, -0.001, 12.0};
  const unsigned k = drawn(30);
  if (k == 10) return NAN;
  if (k == 11) return INFINITY;
  return k < 10 ? odd[k] : 1e-3 * drawn(10000);
}
static void said(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String text, ...)
{
  va_list list;
  (void)e;
  (void)name;
  (void)status;
  (void)category;
  va_start(list, text);
  if (!strlen(va_arg(list, const char *))) abort();
  va_end(list);
}
int main(void)
{
  const fmi2CallbackFunctions calls = {said, calloc, free, NULL, NULL};
  fmi2Component of[2];
  fmi2FMUstate state = NULL;
  char *bytes = NULL;
  size_t size = 0;
  double time[2] = {0, 0};
  long k, steps = 0;
  if (fmi2Instantiate("one", fmi2CoSimulation, "{}", "", &calls, 0, 1)) return 1;
  of[0] = fmi2Instantiate("one", fmi2CoSimulation, TOKEN, "", &calls, 0, 1);
  of[1] = fmi2Instantiate("two", fmi2CoSimulation, TOKEN, "", &calls, 0, 0);
  for (k = 0; k < 200000; ++k) {
    const unsigned which = drawn(2);
    fmi2Component c = of[which];
    unsigned vr[4], i;
    double values[4], out[4];
    int whole[4];
    for (i = 0; i < 4; ++i) {
      vr[i] = drawn(40);
      values[i] = number();
    }
    switch (drawn(20)) {
      case 0: if (fmi2SetupExperiment(c, 0, 0, values[0], 0, 0) == fmi2OK) time[which] = values[0]; break;
      case 1: fmi2EnterInitializationMode(c); break;
      case 2: fmi2ExitInitializationMode(c); break;
      case 3: if (!drawn(20)) fmi2Terminate(c); break;
      case 4: if (!drawn(20)) { fmi2Reset(c); time[which] = 0; } break;
      case 5: case 6: fmi2SetReal(c, vr, drawn(5), values); break;
      case 7: fmi2GetReal(c, vr, drawn(5), out); break;
      case 8: fmi2GetInteger(c, vr, drawn(5), whole); break;
      case 9: fmi2GetFMUstate(c, &state); break;
      case 10: if (state && !drawn(10)) { fmi2SetFMUstate(c, state); fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &time[which]); } break;
      case 11:
        if (state && fmi2SerializedFMUstateSize(c, state, &size) == fmi2OK) {
          bytes = realloc(bytes, size);
          fmi2SerializeFMUstate(c, state, bytes, size);
        }
        break;
      case 12: if (bytes) fmi2DeSerializeFMUstate(c, bytes, drawn(3) ? size : drawn((unsigned)size), &state); break;
      case 13: fmi2GetDirectionalDerivative(c, vr, drawn(3), vr + 2, drawn(3), values, out); break;
      case 14: fmi2FreeFMUstate(c, &state); break;
      case 15: {
        const unsigned input[] = {0, 1};
        const double pulled[] = {2 + 1e-3 * drawn(8000), 2};
        fmi2SetReal(c, input, 2, pulled);
        break;
      }
      default:
        if (fmi2DoStep(c, drawn(20) ? time[which] : values[0], drawn(10) ? 0.001 * (1 + drawn(3)) : fmod(values[1], 0.01), 1) == fmi2OK) ++steps;
        fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &time[which]);
    }
  }
  fmi2FreeFMUstate(of[0], &state);
  free(bytes);
  fmi2FreeInstance(of[0]);
  fmi2FreeInstance(of[1]);
  printf("done: %ld steps\n", steps);
  return steps < 1000;
}
