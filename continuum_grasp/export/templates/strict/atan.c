<<P>>_API static <<p>>_real strict_atan(<<p>>_real x)
{
  return strict_atan2(x, <<one>>);
}
