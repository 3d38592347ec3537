<<P>>_API static <<p>>_real strict_sin(<<p>>_real x)
{
  return strict_turn(x, 1);
}
