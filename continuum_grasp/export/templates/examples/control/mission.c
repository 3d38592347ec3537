/* The mission over a pipe: a line of measurements comes in, a line with the command goes out. What is no number was not
 * measured. Lines with "release" or "abort" alone are for the next period.
 *
 * A line in is a period of <<loop.period:.12g>> s: <<for name in loop.measurement_names|, >><<name>><<end>>.
 * A line out: <<for name in loop.stages.u_names|, >><<name>><<end>>, code, phase. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "<<p>>.h"

#define MEASURED <<loop.measurement.size>>
#define COMMANDED <<loop.command.size>>

static <<p>>_mission mission;
static <<p>>_mission_work work;

<<read_line>>int main(void)
{
  char line[4096];
  int code = <<p>>_mission_init(&mission);
  while (code >= 0 && fgets(line, sizeof line, stdin)) {
    <<p>>_measurement measurement;
    <<p>>_command command;
    <<p>>_real numbers[COMMANDED];
    int k;
    if (strcmp(line, "release\n") == 0 || strcmp(line, "abort\n") == 0) {
      code = line[0] == 'r' ? <<p>>_mission_release(&mission) : <<p>>_mission_abort(&mission);
      continue;
    }
    read_line(line, &measurement);
    if ((code = <<p>>_mission_step(&mission, &work, &measurement, &command)) < 0) break;
    memcpy(numbers, &command, sizeof numbers);
    for (k = 0; k < COMMANDED; ++k) printf("%.17g,", (double)numbers[k]);
    printf("%d,%d\n", code, <<p>>_mission_phase(&mission));
    fflush(stdout);
  }
  if (code < 0) fprintf(stderr, "%s\n", <<p>>_strerror(code));
  return code < 0;
}
