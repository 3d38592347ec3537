/* What estimator and controller keep and work in, for <<p>>.h: their callers own it, and no other code reads it. Made by
   continuum_grasp <<version>>. */
#ifndef <<P>>_MEMORY_H
#define <<P>>_MEMORY_H

<<dimensions>>

<<types>><<if estimator>>
typedef struct {
  <<p>>_ekf_state state;
  uint32_t anomalies;
} <<p>>_estimator_memory;<<end>><<if mpc>>
typedef struct {
  <<p>>_loop_state state;
  <<p>>_loop_output last;
  int late, differs; /* of the next call: whether the last command was late, and was not what was applied */
  <<p>>_real elapsed, age, applied[<<P>>_RTI_NU];
} <<p>>_controller_memory;<<end>><<if loop.phases>>
typedef struct {
  <<p>>_phases_state state;
  uint32_t calls;
  int reported; /* by other fingers */
} <<p>>_mission_memory;<<end>>
#endif
