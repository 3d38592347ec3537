<<P>>_API static <<p>>_real strict_cos(<<p>>_real x)
{
  return strict_turn(x, 0);
}
