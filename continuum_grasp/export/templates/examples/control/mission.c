/* The mission over a pipe: a line of measurements comes in, a line with the command goes out. What is no number was not
 * measured. Lines with one word are for the next period: "release" and "abort" let the object go, "late" says that the last
 * command was, "rearm" leaves a trip, "start" begins anew.
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

<<read_line>>/* Do what a line with one word asks for; whether it is one. */
static int asked(const char *line, int *code)
{
  if (strcmp(line, "release\n") == 0) *code = <<p>>_mission_release(&mission);
  else if (strcmp(line, "abort\n") == 0) *code = <<p>>_mission_abort(&mission);
  else if (strcmp(line, "late\n") == 0) *code = <<p>>_controller_late(&mission.controller);
  else if (strcmp(line, "rearm\n") == 0) *code = <<p>>_controller_rearm(&mission.controller);
  else if (strcmp(line, "start\n") == 0) *code = <<p>>_mission_init(&mission);
  else return 0;
  return 1;
}

int main(void)
{
  char line[4096];
  int code = <<p>>_mission_init(&mission);
  while (code >= 0 && fgets(line, sizeof line, stdin)) {
    <<p>>_measurement measurement;
    <<p>>_command command;
    <<p>>_real numbers[COMMANDED];
    int k;
    if (asked(line, &code)) continue;
    line_read(line, &measurement);
    if ((code = <<p>>_mission_step(&mission, &work, &measurement, &command)) < 0) break;
    memcpy(numbers, &command, sizeof numbers);
    for (k = 0; k < COMMANDED; ++k) printf("%.17g,", (double)numbers[k]);
    printf("%d,%d\n", code, <<p>>_mission_phase(&mission));
    fflush(stdout);
  }
  if (code < 0) fprintf(stderr, "%s\n", <<p>>_strerror(code));
  return code < 0;
}
