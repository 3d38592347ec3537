<<P>>_API static <<p>>_real strict_power_of_two(int k)
{
  union { <<p>>_real value; uint<<width>>_t bits; } power;
  power.bits = (uint<<width>>_t)(k + <<bias>>) << <<mantissa>>;
  return power.value;
}
