/* Cosine of x less so many quarters of a turn: x = k pi / 2 + r with |r| <= pi / 4, and Taylor polynomials of r. Beyond
   a thousand turns the remainder r loses digits, and beyond <<most_angle>> it is no number. */
<<P>>_API static <<p>>_real strict_turn(<<p>>_real x, int quarters)
{
  <<P>>_API static const <<p>>_real sine_series[] = <<sin_series>>;
  <<P>>_API static const <<p>>_real cosine_series[] = <<cos_series>>;
  <<p>>_real r, square, sine = sine_series[0], cosine = cosine_series[0], value;
  int j, k, at;
  if (!<<p>>_is_finite(&x)) return x;
  if (x < -<<most_angle>> || x > <<most_angle>>) return strict_nan();
  k = (int)(x * <<per_half_pi>> + (x < <<zero>> ? -<<half>> : <<half>>));
  r = ((x - (<<p>>_real)k * <<pi_1>>) - (<<p>>_real)k * <<pi_2>>) - (<<p>>_real)k * <<pi_3>>;
  square = r * r;
  for (j = 1; j <= <<sin_last>>; ++j) sine = sine * square + sine_series[j];
  for (j = 1; j <= <<cos_last>>; ++j) cosine = cosine * square + cosine_series[j];
  at = (int)((unsigned)(k - quarters) & 3u);
  value = (at & 1) ? r * sine : cosine;
  return (at == 1 || at == 2) ? -value : value;
}
