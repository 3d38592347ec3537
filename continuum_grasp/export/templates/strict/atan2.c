/* Angle of (x, y): the ratio of the smaller to the greater one is turned by pi / 4 where it is beyond tan(pi / 8), and
   the rest is a Taylor polynomial. Zeros have no sign; the angle of two zeros is zero. */
<<P>>_API static <<p>>_real strict_atan2(<<p>>_real y, <<p>>_real x)
{
  <<P>>_API static const <<p>>_real series[] = <<atan_series>>;
  const <<p>>_real a = y < <<zero>> ? -y : y, b = x < <<zero>> ? -x : x;
  const int steep = a > b;
  <<p>>_real t, square, sum = series[0];
  int j, turned;
  if (!<<p>>_is_finite(&x) || !<<p>>_is_finite(&y)) return strict_nan();
  if (!(a > <<zero>> || b > <<zero>>)) return <<zero>>;
  t = steep ? b / a : a / b;
  turned = t > <<tan_eighth>>;
  if (turned) t = (t - <<one>>) / (t + <<one>>);
  square = t * t;
  for (j = 1; j <= <<atan_last>>; ++j) sum = sum * square + series[j];
  t = t * sum;
  if (turned) t = <<quarter_pi>> + (t + <<half>> * <<half_pi_rest>>);
  if (steep) t = <<half_pi>> - (t - <<half_pi_rest>>);
  if (x < <<zero>>) t = <<two>> * <<half_pi>> - (t - <<two>> * <<half_pi_rest>>);
  return y < <<zero>> ? -t : t;
}
