/* Whether what several numbers set together, which is none of them, is out of its range. */
<<P>>_API static int left_range(<<declared>>)
{
  <<p>>_real use[1];
  <<call>>
  return !<<p>>_is_finite(use) || use[0] < -1 || use[0] > 1;
}
