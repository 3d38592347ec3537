typedef struct {
  double past[<<past>>][<<model.nx>> + <<model.nu>>]; /* the last one first: a state, and the command that led to it */
  int begun;
} fmu_model;
typedef struct {
  double w[<<work>>];
  long long iw[<<whole_work>>];
} fmu_scratch;
