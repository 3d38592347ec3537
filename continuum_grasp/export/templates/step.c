  <<p>>_real rate[<<P>>_NX], point[<<P>>_NX], total[<<P>>_NX];
  const <<p>>_real part = h / <<substeps>>, half = <<half>> * part, sixth = part / <<six>>;
  int i, stage, substep;
  for (i = 0; i < <<P>>_NX; ++i) result[i] = x[i];
  for (substep = 0; substep < <<P>>_SUBSTEPS; ++substep) {
    for (i = 0; i < <<P>>_NX; ++i) { point[i] = result[i]; total[i] = 0; }
    for (stage = 0; stage < 4; ++stage) { /* slopes at 0, 1/2, 1/2 and 1 of a sub-step, weighted 1, 2, 2, 1 */
      const <<p>>_real weight = stage == 1 || stage == 2 ? <<two>> : <<one>>;
      const <<p>>_real ahead = stage == 2 ? part : half;
      <<dynamics>>
      for (i = 0; i < <<P>>_NX; ++i) {
        total[i] = total[i] + weight * rate[i];
        point[i] = result[i] + ahead * rate[i];
      }
    }
    for (i = 0; i < <<P>>_NX; ++i) result[i] = result[i] + sixth * total[i];
  }
  if (h > <<accurate>>) code = <<P>>_WARN_COARSE_STEP;
  if (<<left_range>>) code = <<P>>_WARN_LEFT_RANGE;
