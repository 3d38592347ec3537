#if defined(__AVX512F__)
#define CG_BYTES 64
#elif defined(__AVX__)
#define CG_BYTES 32
#else
#define CG_BYTES 16
#endif
#define CG_LANES (CG_BYTES / (int)sizeof(cg_real))
typedef cg_real cg_lanes __attribute__((vector_size(CG_BYTES)));
/* A loop over the lanes of one vector, which compilers turn into vector instructions where there are any. */
#define CG_EACH(name, call) \
  static inline cg_lanes name(cg_lanes a) { \
    for (int l = 0; l < CG_LANES; ++l) a[l] = call(a[l]); \
    return a; \
  }
#define CG_EACH2(name, call) \
  static inline cg_lanes name(cg_lanes a, cg_lanes b) { \
    for (int l = 0; l < CG_LANES; ++l) a[l] = call(a[l], b[l]); \
    return a; \
  }
#define CG_COMPARE(name, sign) \
  static inline cg_lanes name(cg_lanes a, cg_lanes b) { \
    for (int l = 0; l < CG_LANES; ++l) a[l] = a[l] sign b[l] ? (cg_real)1 : (cg_real)0; \
    return a; \
  }
#define CG_SELECT(name, sign) \
  static inline cg_lanes name(cg_lanes a, cg_lanes b) { \
    for (int l = 0; l < CG_LANES; ++l) a[l] = a[l] sign b[l] ? a[l] : b[l]; \
    return a; \
  }
CG_COMPARE(cg_lt, <) CG_COMPARE(cg_le, <=) CG_COMPARE(cg_eq, ==) CG_COMPARE(cg_ne, !=)
CG_COMPARE(cg_and, != 0 &&) CG_COMPARE(cg_or, != 0 ||)
static inline cg_lanes cg_if(cg_lanes a, cg_lanes b) {
  for (int l = 0; l < CG_LANES; ++l) a[l] = a[l] != 0 ? b[l] : (cg_real)0;
  return a;
}
static inline cg_lanes cg_not(cg_lanes a) { return cg_eq(a, (cg_lanes){0}); }
static inline cg_lanes cg_sign(cg_lanes a) { return cg_lt((cg_lanes){0}, a) - cg_lt(a, (cg_lanes){0}); }
CG_EACH(cg_sqrt, sqrt) CG_EACH(cg_exp, exp) CG_EACH(cg_fabs, fabs) CG_EACH(cg_sin, sin) CG_EACH(cg_cos, cos)
CG_EACH(cg_tanh, tanh)
CG_EACH2(cg_pow, pow) CG_EACH(cg_log, log)
/* Selections instead of fmin and fmax, which compilers call lane by lane, since these ignore a NaN. */
CG_SELECT(cg_fmin, <) CG_SELECT(cg_fmax, >)
