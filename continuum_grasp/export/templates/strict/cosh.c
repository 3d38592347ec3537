/* Hyperbolic cosine: the mean of two exponentials; half of one, by its root, where that is all. */
<<P>>_API static <<p>>_real strict_cosh(<<p>>_real x)
{
  const <<p>>_real size = x < <<zero>> ? -x : x;
  <<p>>_real e;
  if (!<<p>>_is_finite(&x)) return strict_nan();
  e = strict_exp(size > <<tanh_most>> ? <<half>> * size : size);
  return size > <<tanh_most>> ? <<half>> * e * e : <<half>> * e + <<half>> / e;
}
