typedef struct { int nothing; } fmu_model; /* its state is among the variables */
typedef struct { int nothing; } fmu_scratch;
