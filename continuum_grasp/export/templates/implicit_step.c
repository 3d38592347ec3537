  <<p>>_real rate[<<P>>_NX], jacobian[<<nonzeros>>], k[<<P>>_NX], before[<<P>>_NX];
  <<p>>_real base[<<P>>_NX], ahead[<<P>>_NX], off, moved = 0;
  const <<p>>_real part = h / <<substeps>>;
  int i, stage, substep;
  for (i = 0; i < <<P>>_NX; ++i) result[i] = x[i];
  for (substep = 0; substep < <<P>>_IMPLICIT_SUBSTEPS; ++substep) {
    for (i = 0; i < <<P>>_NX; ++i) base[i] = result[i];
    for (stage = 0; stage < 2; ++stage) { /* each by two Newton iterations */
      <<slope_base>>
      <<guess>>
      <<slope_ahead>>
      if (stage == 0) <<first>>
      else <<last>>
    }
    <<size>>
    if (off > moved) moved = off;
    for (i = 0; i < <<P>>_NX; ++i) result[i] = base[i];
  }
  if (moved > <<unsolved>>) return <<P>>_ERR_STEP;
  if (moved > <<settled>>) code = <<P>>_WARN_COARSE_STEP;
  if (<<left_range>>) code = <<P>>_WARN_LEFT_RANGE;
