/* Kernels: the equations of the finger as straight-line code of additions, multiplications and divisions, which give the
   same bits on every machine that keeps to IEEE 754. Made by continuum_grasp <<version>>; not meant to be edited. */
#include "<<p>>_internal.h"

#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#endif

<<body>>
