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

<<numbers>>

<<structs>><<check>>
<<functions>>
