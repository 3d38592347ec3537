/* Commands for measurements that come line by line: control_loop < measurements.csv > commands.csv
 *
 * A line is a period of <<loop.period:.12g>> s: <<for name in loop.measurement_names|, >><<name>><<end>>.
 * What is no number was not measured. Setpoints stay those with which the scene begins. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "<<p>>.h"

#define MEASURED <<loop.measurement.size>>
#define WANTED <<loop.stages.nr>>
#define NODES <<loop.nodes>>
#define COMMANDED <<loop.command.size>>

static const <<p>>_real wanted[WANTED] = {<<wanted>>}; /* <<for name in loop.stages.r_names|, >><<name>><<end>> */
static <<p>>_controller controller;
static <<p>>_controller_work work;

<<read_line>>/* The same setpoints for the whole horizon. */
static void hold(<<p>>_reference *reference)
{
  <<p>>_real rows[WANTED][NODES];
  int j, k;
  for (j = 0; j < WANTED; ++j)
    for (k = 0; k < NODES; ++k) rows[j][k] = wanted[j];
  memcpy(reference, rows, sizeof *reference);
}

int main(void)
{
  char line[4096];
  <<p>>_reference reference;
  long period = 0;
  int code = <<p>>_controller_init(&controller);
  hold(&reference);
  printf("time [s],<<for name in loop.stages.u_names|,>><<name>><<end>>,code,anomalies\n");
  while (code >= 0 && fgets(line, sizeof line, stdin)) {
    <<p>>_measurement measurement;
    <<p>>_command command;
    <<p>>_diagnosis diagnosis;
    <<p>>_real numbers[COMMANDED];
    int k;
    line_read(line, &measurement);
    if ((code = <<p>>_mpc(&controller, &work, &measurement, &reference, &command)) < 0) break;
    <<p>>_controller_diagnosis(&controller, &diagnosis);
    memcpy(numbers, &command, sizeof numbers);
    printf("%.6g", (double)period++ * <<loop.period:.12g>>);
    for (k = 0; k < COMMANDED; ++k) printf(",%.9g", (double)numbers[k]);
    printf(",%d,%lu\n", code, (unsigned long)diagnosis.anomalies);
  }
  if (code < 0) fprintf(stderr, "%s\n", <<p>>_strerror(code));
  return code < 0;
}
