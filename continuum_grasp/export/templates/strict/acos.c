<<P>>_API static <<p>>_real strict_acos(<<p>>_real x)
{
  return strict_atan2(strict_sqrt((<<one>> - x) * (<<one>> + x)), x);
}
