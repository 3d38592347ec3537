int <<p>>_measurement_init_abi(<<p>>_measurement *measurement, uint32_t abi)
{
  union { <<p>>_real value; uint<<width>>_t bits; } missing;
  <<p>>_real numbers[<<loop.measurement.size>>];
  int k;
  if (!measurement) return <<P>>_ERR_NULL;
  if (abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  missing.bits = <<missing>>; /* NaN by its bits: C99 has no literal of it without a library */
  for (k = 0; k < <<loop.measurement.size>>; ++k) numbers[k] = missing.value;
  measurement_written(numbers, measurement);
  return <<P>>_OK;
}

int <<p>>_command_init_abi(<<p>>_command *command, uint32_t abi)
{
  if (!command) return <<P>>_ERR_NULL;
  if (abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  command_written(command_first, command);
  return <<P>>_OK;
}
