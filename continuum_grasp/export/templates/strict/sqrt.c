/* Square root: Newton's iteration for 1 / sqrt(x) from a guess of its exponent, then one step of Heron's. */
<<P>>_API static <<p>>_real strict_sqrt(<<p>>_real x)
{
  union { <<p>>_real value; uint<<real.width>>_t bits; } guess;
  <<p>>_real scaled = x, y, root;
  int k;
  if (x < <<zero>>) return strict_nan();
  if (!(x > <<zero>>)) return x;
  if (x < <<least>>) scaled = x * <<up>>; /* the guess reads the exponent, which subnormal numbers do not have */
  guess.value = scaled;
  guess.bits = <<guess>> - (guess.bits >> 1); /* half the exponent, negated: 1 / sqrt(x) to 3.4 % */
  y = guess.value;
  for (k = 0; k < <<n.newton>>; ++k) y = y * (<<three_halves>> - <<half>> * scaled * y * y);
  root = scaled * y;
  root = <<half>> * (root + scaled / root);
  return x < <<least>> ? root * <<down>> : root;
}
