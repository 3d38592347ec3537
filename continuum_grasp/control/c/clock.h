/* Nanoseconds of a clock that never goes back, for the phases of a controller. */
#ifndef CG_CLOCK_H
#define CG_CLOCK_H
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
