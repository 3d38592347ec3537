<<P>>_API static <<p>>_real strict_nan(void)
{
  union { <<p>>_real value; uint<<real.width>>_t bits; } none;
  none.bits = <<exponent_mask>> | 1u;
  return none.value;
}
