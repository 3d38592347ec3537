/* Logarithm of 1 + x: that of the rounded sum u, times x / (u - 1), which takes the rounding back. */
<<P>>_API static <<p>>_real strict_log1p(<<p>>_real x)
{
  const <<p>>_real u = <<one>> + x, off = u - <<one>>;
  if (!<<p>>_is_finite(&u)) return strict_nan();
  return off < <<zero>> || off > <<zero>> ? strict_log(u) * (x / off) : x;
}
