<<P>>_API static <<p>>_real strict_tan(<<p>>_real x)
{
  const <<p>>_real sine = strict_turn(x, 1), cosine = strict_turn(x, 0);
  return cosine < <<zero>> || cosine > <<zero>> ? sine / cosine : strict_nan();
}
