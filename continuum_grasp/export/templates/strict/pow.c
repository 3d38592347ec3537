/* Power of a number above zero, of zero one with an exponent from zero on; it takes over the rounding of y log(x). */
<<P>>_API static <<p>>_real strict_pow(<<p>>_real x, <<p>>_real y)
{
  if (!<<p>>_is_finite(&x) || !<<p>>_is_finite(&y)) return strict_nan();
  if (!(x < <<zero>> || x > <<zero>>)) return y > <<zero>> ? <<zero>> : y < <<zero>> ? strict_nan() : <<one>>;
  return strict_exp(y * strict_log(x));
}
