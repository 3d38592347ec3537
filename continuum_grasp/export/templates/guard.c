/* Whether the curvature of the matched tip, which is no coordinate, is out of its range. */
<<P>>_API static int tip_left_range(<<declared>>)
{
  <<p>>_real use[1];
  <<call>>
  return !<<p>>_is_finite(use) || use[0] < -1 || use[0] > 1;
}
