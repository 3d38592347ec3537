typedef char <<p>>_estimator_fits[sizeof(<<p>>_estimator) <= <<P>>_ESTIMATOR_BYTES ? 1 : -1];
typedef char <<p>>_estimator_work_fits[sizeof(<<p>>_estimator_work) <= <<P>>_ESTIMATOR_WORK_BYTES ? 1 : -1];

int <<p>>_estimator_init_abi(<<p>>_estimator *estimator, uint32_t abi)
{
  if (!estimator) return <<P>>_ERR_NULL;
  if (abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  memset(estimator, 0, sizeof *estimator);
  estimator->abi = abi;<<if known>>
  known_written(known_nominal, &estimator->known);<<end>>
  <<p>>_ekf_start(&estimator->memory.state, &<<estimator_settings>>, first_state, command_first);
  return <<P>>_OK;
}

int <<p>>_estimator_start(<<p>>_estimator *estimator, const <<p>>_estimate *state, const <<p>>_command *before)
{
  <<p>>_real z[<<loop.start.size>>], u[<<loop.command.size>>];
  int code;
  if (!estimator || !state || !before) return <<P>>_ERR_NULL;
  if (estimator->abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  estimate_read(state, z);
  command_read(before, u);
  if ((code = check(z, estimate_low, estimate_high, <<loop.start.size>>)) < 0) return code;
  if ((code = check(u, applied_low, applied_high, <<loop.command.size>>)) < 0) return code;
  memset(&estimator->memory, 0, sizeof estimator->memory);
  <<p>>_ekf_start(&estimator->memory.state, &<<estimator_settings>>, z, u);
  return <<P>>_OK;
}

int <<p>>_estimator_step(<<p>>_estimator *estimator, <<p>>_estimator_work *work, const <<p>>_measurement *measurement,
<<indent_step>>const <<p>>_command *applied, <<p>>_estimate *estimate)
{
  <<p>>_real y[<<loop.measurement.size>>], u[<<loop.command.size>>], z[<<loop.start.size>>], p[<<np_size>>] = {0};
  <<p>>_ekf_report report;
  int code, j;
  <<P>>_SCRATCH(estimator);
  if (!estimator || !work || !measurement || !applied || !estimate) return <<P>>_ERR_NULL;
  if (estimator->abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  measurement_read(measurement, y);
  command_read(applied, u);
  if ((code = check(u, applied_low, applied_high, <<loop.command.size>>)) < 0) return code;<<if known>>
  known_read(&estimator->known, p);
  if ((code = check(p, known_low, known_high, <<known>>)) < 0) return code;<<end>>
  if (<<p>>_ekf_step(&estimator->memory.state, work, &<<estimator_settings>>, y, u, p, 1, <<P>>_EKF_DELAY, &report) != <<P>>_EKF_OK)
    code = <<P>>_WARN_ESTIMATE_RESTARTED;
  else if (!<<p>>_ekf_now(&estimator->memory.state, work, &<<estimator_settings>>, p, z)) {
    <<p>>_ekf_restart(&estimator->memory.state, &<<estimator_settings>>);
    code = <<P>>_WARN_ESTIMATE_RESTARTED;
  }
  if (code == <<P>>_WARN_ESTIMATE_RESTARTED) memcpy(z, estimator->memory.state.z, sizeof z);
  estimator->memory.anomalies = report.limited ? <<P>>_ANOMALY_ESTIMATE_LIMITED : 0u;
  if (code == <<P>>_WARN_ESTIMATE_RESTARTED) estimator->memory.anomalies |= <<P>>_ANOMALY_ESTIMATE_RESTARTED;
  for (j = 0; j < <<loop.measurement.size>>; ++j) estimator->memory.anomalies |= anomaly_of_verdict[report.verdict[j]];
  estimate_written(z, estimate);
  return code;
}

int <<p>>_estimator_variance(const <<p>>_estimator *estimator, <<p>>_estimate *variance)
{
  <<p>>_real numbers[<<loop.start.size>>];
  if (!estimator || !variance) return <<P>>_ERR_NULL;
  if (estimator->abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  <<p>>_ekf_variance(&estimator->memory.state, numbers);
  estimate_written(numbers, variance);
  return <<P>>_OK;
}

uint32_t <<p>>_estimator_anomalies(const <<p>>_estimator *estimator)
{
  return estimator ? estimator->memory.anomalies : 0u;
}
