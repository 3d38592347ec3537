/* Hyperbolic tangent: e / (e + 2) with e = exp(2 |x|) - 1; one where it rounds to that. */
<<P>>_API static <<p>>_real strict_tanh(<<p>>_real x)
{
  const <<p>>_real size = x < <<zero>> ? -x : x;
  <<p>>_real e;
  if (!<<p>>_is_finite(&x)) return strict_nan();
  if (size > <<tanh_most>>) return x < <<zero>> ? -<<one>> : <<one>>;
  e = strict_expm1(<<two>> * size);
  e = e / (e + <<two>>);
  return x < <<zero>> ? -e : e;
}
