/* The controller after the last step, and as the next one leaves it with the inputs of now. */
typedef struct {
  <<p>>_<<kind>> now, next;
  int begun, computed; /* whether the first is made ready, and the second is of the inputs of now */
} fmu_model;
typedef struct {
  <<p>>_<<kind>>_work work;
<<if alone>>  <<p>>_reference reference;
<<end>>} fmu_scratch;
