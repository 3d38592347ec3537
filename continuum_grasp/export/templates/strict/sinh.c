/* Hyperbolic sine: half of e + e / (e + 1) with e = exp(|x|) - 1; half an exponential, by its root, where that is all. */
<<P>>_API static <<p>>_real strict_sinh(<<p>>_real x)
{
  const <<p>>_real size = x < <<zero>> ? -x : x;
  <<p>>_real e;
  if (!<<p>>_is_finite(&x)) return strict_nan();
  if (size > <<tanh_most>>) {
    e = strict_exp(<<half>> * size);
    e = <<half>> * e * e;
  } else {
    e = strict_expm1(size);
    e = <<half>> * (e + e / (e + <<one>>));
  }
  return x < <<zero>> ? -e : e;
}
