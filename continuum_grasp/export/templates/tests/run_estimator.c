static int estimator_step_run(check_memory *memory, const <<p>>_real *row, <<p>>_real *out, uint32_t abi_bits, int null,
                              int repeat)
{
  <<p>>_measurement measurement;
  <<p>>_command applied;
  <<p>>_estimate estimate, variance;
  int k, code = 0;
  if (row[0] > 0) <<p>>_estimator_init(&memory->estimator);
<<if loop.known>>  memcpy(&memory->estimator.known, row + <<known>>, sizeof memory->estimator.known);
<<end>>  memcpy(&measurement, row + <<measurement>>, sizeof measurement);
  memcpy(&applied, row + <<applied>>, sizeof applied);
  memcpy(&estimate, out, sizeof estimate);
  memory->estimator.abi ^= abi_bits;
  for (k = 0; k < repeat; ++k)
    code = <<p>>_estimator_step(null == 1 ? 0 : &memory->estimator, null == 2 ? 0 : &memory->estimator_work,
                              null == 3 ? 0 : &measurement, null == 4 ? 0 : &applied, null == 5 ? 0 : &estimate);
  memory->estimator.abi ^= abi_bits;
  memcpy(out, &estimate, sizeof estimate);
  if (code < 0 || repeat == 0) return code;
  <<p>>_estimator_variance(&memory->estimator, &variance);
  memcpy(out + <<loop.estimate.size>>, &variance, sizeof variance);
  out[2 * <<loop.estimate.size>>] = (<<p>>_real)<<p>>_estimator_anomalies(&memory->estimator);
  return code;
}
