/* Exponential: x = k ln 2 + r with |r| <= ln 2 / 2, a Taylor polynomial of r, and 2^k in two factors. */
<<P>>_API static <<p>>_real strict_exp(<<p>>_real x)
{
  <<P>>_API static const <<p>>_real series[] = <<exp_series>>;
  <<p>>_real r, value = series[0];
  int j, k, first;
  if (!<<p>>_is_finite(&x)) return x;
  /* Beyond these the result would be no normal number, and k not within an int; it is never zero, for those who divide. */
  x = x < <<exp_least>> ? <<exp_least>> : x > <<exp_most>> ? <<exp_most>> : x;
  k = (int)(x * <<per_ln2>> + (x < <<zero>> ? -<<half>> : <<half>>));
  r = (x - (<<p>>_real)k * <<ln2_1>>) - (<<p>>_real)k * <<ln2_2>>;
  for (j = 1; j <= <<exp_last>>; ++j) value = value * r + series[j];
  first = k / 2; /* 2^k alone may be beyond the exponents of normal numbers though the result is not */
  return value * strict_power_of_two(first) * strict_power_of_two(k - first);
}
