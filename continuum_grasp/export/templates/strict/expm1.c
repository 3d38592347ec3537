/* Exponential less one: that of r without its first term, times 2^k with k = -1, 0 or 1; the plain one beyond. */
<<P>>_API static <<p>>_real strict_expm1(<<p>>_real x)
{
  <<P>>_API static const <<p>>_real series[] = <<exp_series>>;
  <<p>>_real r, scale, value = series[0];
  int j, k;
  if (!<<p>>_is_finite(&x)) return strict_nan();
  if (x < -<<one>> || x > <<one>>) return strict_exp(x) - <<one>>;
  k = (int)(x * <<per_ln2>> + (x < <<zero>> ? -<<half>> : <<half>>));
  r = (x - (<<p>>_real)k * <<ln2_1>>) - (<<p>>_real)k * <<ln2_2>>;
  for (j = 1; j < <<exp_last>>; ++j) value = value * r + series[j];
  scale = strict_power_of_two(k);
  return scale * (value * r) + (scale - <<one>>);
}
