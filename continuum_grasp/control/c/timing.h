/* Nanoseconds of a monotonic clock, for the phases of a controller; they wrap after 4.3 s, which differences do not
 * see. */
#ifndef CG_TIMING_H
#define CG_TIMING_H
#include <stdint.h>
#include <time.h>
static uint32_t cg_ticks(void)
{
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (uint32_t)now.tv_sec * 1000000000u + (uint32_t)now.tv_nsec;
}
#define CONTROLLER_TICKS() cg_ticks()
#endif
