/* Whether numbers are finite and in range; the first that is not decides. */
<<P>>_API static int check(const <<p>>_real *numbers, const <<p>>_real *low, const <<p>>_real *high, int count)
{
  int k;
  for (k = 0; k < count; ++k) {
    if (!<<p>>_is_finite(&numbers[k])) return <<P>>_ERR_NON_FINITE;
    if (numbers[k] < low[k] || numbers[k] > high[k]) return <<P>>_ERR_RANGE;
  }
  return <<P>>_OK;
}
