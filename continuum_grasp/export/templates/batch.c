#ifdef <<P>>_BATCH
#if defined(__AVX512F__)
#define LANE_BYTES 64
#elif defined(__AVX__)
#define LANE_BYTES 32
#else
#define LANE_BYTES 16
#endif
#ifndef __clang__
#pragma GCC diagnostic ignored "-Wpsabi" /* vectors are passed between functions of this file alone */
#endif

typedef <<p>>_real lanes __attribute__((vector_size(LANE_BYTES)));
#define LANES (LANE_BYTES / (int)sizeof(<<p>>_real))

static inline lanes same(<<p>>_real value)
{
  lanes all = {value};
  int k;
  for (k = 0; k < LANES; ++k) all[k] = value;
  return all;
}

<<strict>><<helpers>><<kernel>>
long <<p>>_step_batch(const <<p>>_model *model, const <<p>>_state *states, const <<p>>_input *inputs,
                      <<if forces>>const <<p>>_forces *forces, <<end>><<p>>_real h, <<p>>_state *next, int *codes, long count)
{
  <<p>>_real <<for name, size in arrays|, >><<name>>[<<size>>] = {0}<<end>>, result[<<P>>_NX];
  lanes <<for name, size in lanes|, >>v<<name>>[<<size>>]<<end>>, rate[<<P>>_NX], point[<<P>>_NX], total[<<P>>_NX];
  const <<p>>_real part = h / <<substeps>>, half = <<half>> * part, sixth = part / <<six>>;
  long first, refused = 0;
  if (!model || !states || !inputs<<if forces>> || !forces<<end>> || !next || !codes) return <<P>>_ERR_NULL;
  for (first = 0; first < count; first += LANES) {
    const int held = count - first < LANES ? (int)(count - first) : LANES;
    int i, k, stage, substep;
    for (k = 0; k < LANES; ++k) { /* the last state fills up the lanes; lanes do not touch each other */
      const long at = first + (k < held ? k : held - 1);
      codes[at] = accept_step(model, &states[at], &inputs[at], <<if forces>>&forces[at], <<end>>h<<for name in passed>>, <<name>><<end>>);
      <<for name, size in gathered|\n      >>for (i = 0; i < <<size>>; ++i) v<<name>>[i][k] = <<name>>[i];<<end>>
    }<<if spread>>
    for (i = 0; i < <<spread>>; ++i) vp[i] = same(p[i]);<<end>>
    for (substep = 0; substep < <<P>>_SUBSTEPS; ++substep) {
      for (i = 0; i < <<P>>_NX; ++i) { point[i] = vx[i]; total[i] = same(<<zero>>); }
      for (stage = 0; stage < 4; ++stage) {
        const <<p>>_real weight = stage == 1 || stage == 2 ? <<two>> : <<one>>;
        const <<p>>_real ahead = stage == 2 ? part : half;
        dynamics_lanes(<<call>>);
        for (i = 0; i < <<P>>_NX; ++i) {
          total[i] = total[i] + weight * rate[i];
          point[i] = vx[i] + ahead * rate[i];
        }
      }
      for (i = 0; i < <<P>>_NX; ++i) vx[i] = vx[i] + sixth * total[i];
    }
    for (k = 0; k < held; ++k) {
      int *code = &codes[first + k];
      for (i = 0; i < <<P>>_NX; ++i) result[i] = vx[i][k];
      if (*code >= 0 && !all_finite(result, <<P>>_NX)) *code = <<P>>_ERR_RESULT;
      if (*code < 0) {
        ++refused;
        continue;
      }<<if again>>
      read_input(&inputs[first + k], u);<<end>>
      if (h > <<accurate>>) *code = <<P>>_WARN_COARSE_STEP;
      if (<<left_range>>) *code = <<P>>_WARN_LEFT_RANGE;
      write_state(result, &next[first + k]);
    }
  }
  return refused;
}
#endif
