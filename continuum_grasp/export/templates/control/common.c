/* Estimator and controller: real-time iterations on the horizon, extended Kalman filter, fallback, and the public
   functions around them. Made by continuum_grasp <<version>>. */
#include "<<p>>_internal.h"

#include <stddef.h>
#include <string.h>

#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#endif

<<sqrt>>
#define <<P>>_CHECKS_SQRT strict_sqrt
#define <<P>>_RTI_SQRT strict_sqrt

<<prototypes>>
/* ---- functions of the model, as estimator and controller call them ---- */

<<adapters>>
<<bodies>>
/* ---- public functions ---- */

#ifdef <<P>>_OWN_SCRATCH
/* Scratch for callers that give none, one at a time. */
static union {<<if estimator>>
  <<p>>_estimator_work estimator;<<end>><<if mpc>>
  <<p>>_controller_work controller;<<end>><<if loop.phases>>
  <<p>>_mission_work mission;<<end>>
} own_memory;
#define <<P>>_SCRATCH(kind) if (!work) work = &own_memory.kind
#else
#define <<P>>_SCRATCH(kind) (void)0
#endif

<<numbers>>

<<structs>><<check>>
<<functions>>
