<<P>>_API static <<p>>_real strict_asin(<<p>>_real x)
{
  return strict_atan2(x, strict_sqrt((<<one>> - x) * (<<one>> + x)));
}
