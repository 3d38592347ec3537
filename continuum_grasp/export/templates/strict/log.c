/* Logarithm: x = m 2^k with m from sqrt(1/2) to sqrt(2), and the series of 2 artanh((m - 1) / (m + 1)). */
<<P>>_API static <<p>>_real strict_log(<<p>>_real x)
{
  <<P>>_API static const <<p>>_real series[] = <<log_series>>;
  union { <<p>>_real value; uint<<real.width>>_t bits; } scaled;
  <<p>>_real s, square, sum = series[0];
  int j, k = 0;
  if (x < <<zero>> || !<<p>>_is_finite(&x)) return strict_nan();
  scaled.bits = (uint<<real.width>>_t)1 << <<sign_bit>> | <<exponent_mask>>; /* minus infinity */
  if (!(x > <<zero>>)) return scaled.value;
  if (x < <<least>>) k = -<<n.up_power>>;
  scaled.value = x < <<least>> ? x * <<up>> : x;
  j = (int)(scaled.bits >> <<real.mantissa_bits>>) - <<real.bias>>;
  k += j;
  scaled.bits -= (uint<<real.width>>_t)(unsigned)(j + <<real.bias>>) << <<real.mantissa_bits>>;
  scaled.bits |= (uint<<real.width>>_t)<<real.bias>> << <<real.mantissa_bits>>;
  if (scaled.value > <<root_two>>) {
    scaled.value = <<half>> * scaled.value;
    k += 1;
  }
  s = (scaled.value - <<one>>) / (scaled.value + <<one>>);
  square = s * s;
  for (j = 1; j <= <<log_last>>; ++j) sum = sum * square + series[j];
  return (<<p>>_real)k * <<ln2_1>> + ((<<p>>_real)k * <<ln2_2>> + s * sum);
}
