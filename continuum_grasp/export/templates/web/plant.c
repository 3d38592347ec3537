/* What moves in a page: steps in time, and what is seen of a state. */
#include <stdint.h>

#define PLANT_API
typedef double plant_real;

/* By its bits, whatever a compiler assumes of numbers. */
static int plant_is_finite(const plant_real *value)
{
  union { plant_real value; uint64_t bits; } number;
  number.value = *value;
  return (number.bits & <<exponent>>) != <<exponent>>;
}

<<kernels>>
static plant_real <<for name, size in arrays|, >><<name>>[<<size>>]<<end>>;

<<for name, size in arrays|\n>>plant_real *at_<<name>>(void) { return <<name>>; }<<end>>

static plant_real matrix[<<nx>>][<<nx>>], factored;
static int pivots[<<nx>>];

/* Before a motion begins anew: that nothing is known of the last one. */
void restart(void)
{
  factored = 0;
}

/* I - step times the slope of the rate at a state, by differences, in factors with row pivots. */
static void factor(plant_real step, const plant_real *state)
{
  static const plant_real scales[] = {<<scales>>};
  plant_real at[<<nx>>], here[<<nx>>], rate[<<nx>>];
  int i, j, n;
  for (i = 0; i < <<nx>>; ++i) at[i] = state[i];
  <<rate>>
  for (i = 0; i < <<nx>>; ++i) here[i] = rate[i];
  for (j = 0; j < <<nx>>; ++j) {
    const plant_real aside = at[j] + <<difference>> * scales[j], away = aside - at[j];
    at[j] = aside;
    <<rate>>
    for (i = 0; i < <<nx>>; ++i) matrix[i][j] = (i == j) - step * ((rate[i] - here[i]) / away);
    at[j] = state[j];
  }
  for (n = 0; n < <<nx>>; ++n) {
    plant_real most = -1;
    for (pivots[n] = i = n; i < <<nx>>; ++i) {
      const plant_real size = matrix[i][n] < 0 ? -matrix[i][n] : matrix[i][n];
      if (size > most) { most = size; pivots[n] = i; }
    }
    for (j = 0; j < <<nx>>; ++j) {
      const plant_real entry = matrix[n][j];
      matrix[n][j] = matrix[pivots[n]][j];
      matrix[pivots[n]][j] = entry;
    }
    for (i = n + 1; i < <<nx>>; ++i) {
      const plant_real share = matrix[i][n] = matrix[i][n] / matrix[n][n];
      for (j = n + 1; j < <<nx>>; ++j) matrix[i][j] = matrix[i][j] - share * matrix[n][j];
    }
  }
}

/* The solution of its equations, in place. */
static void solve(plant_real *right)
{
  int i, n;
  for (n = 0; n < <<nx>>; ++n) {
    const plant_real entry = right[n];
    right[n] = right[pivots[n]];
    right[pivots[n]] = entry;
  }
  for (n = 0; n < <<nx>>; ++n) for (i = n + 1; i < <<nx>>; ++i) right[i] = right[i] - matrix[i][n] * right[n];
  for (n = <<nx>> - 1; n >= 0; --n) {
    right[n] = right[n] / matrix[n][n];
    for (i = 0; i < n; ++i) right[i] = right[i] - matrix[i][n] * right[n];
  }
}

/* So many steps of h [s] by two diagonally implicit stages (L-stable, of order 2). Their equations are solved by Newton's
   method with the slope of an earlier step, as long as that takes few corrections, or else of this one; where corrections
   grow, as under damping that rises with the rate, the stage begins anew, and each has its own. 1 where a stage is not solved, -1 where the state is not finite: then it is that of before. */
int advance(plant_real h, int steps)
{
  static const plant_real scales[] = {<<scales>>};
  plant_real rate[<<nx>>], base[<<nx>>], at[<<nx>>], k[2][<<nx>>], most, last;
  const plant_real part = <<gamma>> * h;
  int i, stage, turn, grown, code = 0;
  for (; steps > 0; --steps) {
    for (i = 0; i < <<nx>>; ++i) { base[i] = at[i] = x[i]; k[0][i] = 0; }
    if (factored != part) factor(part, x);
    factored = part;
    for (stage = 0; stage < 2; ++stage) {
      for (grown = turn = 0, most = 1e300; turn < 4 * <<corrections>>; ++turn) {
        if (grown || turn == <<corrections>>) factor(part, at);
        last = most;
        <<rate>>
        for (i = 0; i < <<nx>>; ++i) rate[i] = rate[i] - k[stage][i];
        solve(rate);
        for (most = 0, i = 0; i < <<nx>>; ++i) {
          plant_real size = part * rate[i] / scales[i];
          if (size < 0) size = -size;
          if (!(size <= most)) most = size; /* also what is not a number */
          k[stage][i] = k[stage][i] + rate[i];
          at[i] = base[i] + part * k[stage][i];
        }
        if (most <= <<exact>>) break;
        if (grown || most <= last) continue;
        for (grown = 1, i = 0; i < <<nx>>; ++i) {
          k[stage][i] = stage ? k[0][i] : 0;
          at[i] = base[i] + part * k[stage][i];
        }
      }
      if (turn > <<few>>) factored = 0;
      if (!(most <= <<settled>>)) code = 1;
      if (stage) break;
      for (i = 0; i < <<nx>>; ++i) {
        k[1][i] = k[0][i];
        base[i] = x[i] + (h - part) * k[0][i];
        at[i] = base[i] + part * k[1][i];
      }
    }
    for (i = 0; i < <<nx>>; ++i) if (!plant_is_finite(&at[i])) return -1;
    for (i = 0; i < <<nx>>; ++i) x[i] = at[i];
  }
  return code;
}

/* Write what is drawn of the state. */
void look(void)
{
  <<look>>
}

/* Write what is drawn of a node of the plan. */
void foresee(void)
{
  <<foresee>>
}

/* Write what is measured of it. */
void sense(void)
{
  <<sense>>
}
