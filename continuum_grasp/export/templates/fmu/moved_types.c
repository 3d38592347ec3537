typedef struct {<<if late>>
  double past[<<past>>][<<nx>> + <<nu>>]; /* the last one first: a state, and the command that led to it */
  int begun;<<end>><<if prompt>>
  int nothing; /* its state is among the variables */<<end>>
} fmu_model;
typedef struct {
  double w[<<work>>];
  long long iw[<<whole_work>>];
} fmu_scratch;
