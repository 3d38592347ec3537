#define FMU_PAST <<past>> /* states that a late measurement may still show */
typedef struct {
  double past[FMU_PAST][<<nx>> + <<nu>>]; /* the last one first: a state, and the command that led to it */
  int begun;
} fmu_model;
typedef struct {
  double w[<<work>>];
  long long iw[<<whole_work>>];
} fmu_scratch;
