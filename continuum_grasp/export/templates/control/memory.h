/* What estimator and controller keep and work in, for <<p>>.h: their callers own it, and no other code reads it. Made by
   continuum_grasp <<version>>. */
#ifndef <<P>>_MEMORY_H
#define <<P>>_MEMORY_H

<<dimensions>>

<<types>>
#endif
