<<P>>_API static <<p>>_real strict_power_of_two(int k)
{
  union { <<p>>_real value; uint<<real.width>>_t bits; } power;
  power.bits = (uint<<real.width>>_t)(k + <<real.bias>>) << <<real.mantissa_bits>>;
  return power.value;
}
