/* ---- the estimator: once per measurement, every <<loop.period:g>> s ---- */

/* An estimator. The caller owns it, <<p>>_estimator_init makes it ready. */
typedef struct {
  uint32_t abi; /* set by <<p>>_estimator_init, read by every function */<<if known>>
  <<p>>_known known; /* may be changed between calls */<<end>>
  <<p>>_estimator_memory memory; /* its own */
} <<p>>_estimator;

/* Scratch of a call, which need not be initialized; estimators of one thread may share it. */
typedef <<p>>_ekf_work <<p>>_estimator_work;

/* Bytes of both at most, as <<p>>_estimator and <<p>>_estimator_work have them. */
#define <<P>>_ESTIMATOR_BYTES <<estimator_bytes>>
#define <<P>>_ESTIMATOR_WORK_BYTES <<estimator_work_bytes>>

/* Make an estimator ready, with the numbers and the first state of the scene that it was made from. */
#define <<p>>_estimator_init(estimator) <<p>>_estimator_init_abi((estimator), <<P>>_ABI)
int <<p>>_estimator_init_abi(<<p>>_estimator *estimator, uint32_t abi);
/* Begin anew at a state, with the command that was applied before. */
int <<p>>_estimator_start(<<p>>_estimator *estimator, const <<p>>_estimate *state, const <<p>>_command *before);
/* Take a measurement, NaN where there was none, and the command that was applied since the last call: state and
   disturbances now. Drives that are off or overshoot are no error: <<for f in loop.applied.fields|, >><<f.name>> <<f.limits>><<if not f.limits>>any finite number of<<end>> <<f.unit>><<end>>.
   Beyond the codes of every function: <<P>>_WARN_ESTIMATE_RESTARTED. */
int <<p>>_estimator_step(<<p>>_estimator *estimator, <<p>>_estimator_work *work, const <<p>>_measurement *measurement,
<<indent_step>>const <<p>>_command *applied, <<p>>_estimate *estimate);
/* Variance of each entry at the time of the last measurement. */
int <<p>>_estimator_variance(const <<p>>_estimator *estimator, <<p>>_estimate *variance);
/* What was noticed in the last call, bits of <<P>>_ANOMALY_...; zero for a null pointer. */
uint32_t <<p>>_estimator_anomalies(const <<p>>_estimator *estimator);
