/* Derivatives of rates, states and tip by states, inputs and forces, in a direction. */
static fmu_level fmu_directional(fmu_instance *f, const unsigned *unknowns, size_t n, const unsigned *knowns, size_t m,
                                 const double *seed, double *sensitivity)
{
  <<p>>_model model;
  <<p>>_state state;
  <<p>>_input input;<<if forces>>
  <<p>>_forces forces;<<end>>
  <<p>>_linearization by;
  size_t i, j;
  int code;
  const fmu_level level = fmu_allowed(f, FMU_INITIALIZING | FMU_STEPPING, "GetDirectionalDerivative");
  if (level != FMU_OK) return level;
  if (!unknowns || !knowns || !seed || !sensitivity) return fmu_say(f, FMU_ERROR, "GetDirectionalDerivative: a pointer is null");
  fmu_taken(f, &model, &state, &input<<acting>>);
  code = <<p>>_linearize(&model, &state, &input<<acting>>, &by);
  if (code < 0) return fmu_judged(f, "linearize", code);
  for (i = 0; i < n; ++i) {
    const unsigned of = unknowns[i];
    sensitivity[i] = 0;
    for (j = 0; j < m; ++j) {
      const unsigned at = knowns[j];
      double value = 0;
      if ((at >= FMU_PARAMETERS && at < FMU_STATE) || at >= FMU_TIP)
        return fmu_say(f, FMU_ERROR, "GetDirectionalDerivative: value reference %u is no state, input or force", at);
      if (of >= FMU_RATES && of < FMU_REALS)
        value = at >= FMU_STATE ? by.rate_by_state[of - FMU_RATES][at - FMU_STATE]<<if forces>>
                : at >= FMU_FORCES ? by.rate_by_forces[of - FMU_RATES][at - FMU_FORCES]<<end>>
                                   : by.rate_by_input[of - FMU_RATES][at - FMU_INPUTS];
      else if (of >= FMU_TIP && of < FMU_RATES)
        value = at >= FMU_STATE ? by.tip_by_state[of - FMU_TIP][at - FMU_STATE]<<if forces>>
                : at >= FMU_FORCES ? 0<<end>>
                                   : by.tip_by_input[of - FMU_TIP][at - FMU_INPUTS];
      else if (of >= FMU_STATE && of < FMU_TIP)
        value = of == at;
      else
        return fmu_say(f, FMU_ERROR, "GetDirectionalDerivative: value reference %u is no output and no rate", of);
      sensitivity[i] += value * seed[j];
    }
  }
  return FMU_OK;
}

