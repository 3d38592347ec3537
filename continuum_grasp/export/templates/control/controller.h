/* ---- the controller: once every <<loop.period:g>> s, on a horizon of <<loop.stages.stages>> stages of <<loop.stages.stage:g>> s ---- */

/* A controller. The caller owns it, <<p>>_controller_init makes it ready. */
typedef struct {
  uint32_t abi; /* set by <<p>>_controller_init, read by every function */
  <<p>>_settings settings; /* may be changed between calls */<<if known>>
  <<p>>_known known; /* may be changed between calls */<<end>>
  <<p>>_controller_memory memory; /* its own */
} <<p>>_controller;

/* Scratch of a call, which need not be initialized; controllers of one thread may share it. */
typedef struct {
  <<p>>_loop_work loop;
  <<p>>_loop_settings settings;
  <<p>>_real reference[<<P>>_RTI_N + 1][<<P>>_RTI_NR];
} <<p>>_controller_work;

/* Bytes of both at most. */
#define <<P>>_CONTROLLER_BYTES <<controller_bytes>>
#define <<P>>_CONTROLLER_WORK_BYTES <<controller_work_bytes>>

/* Whether sensors, model and call rate agree, beside the code, which tells how the command came about. */
enum {
  <<P>>_HEALTH_OK = 0,
  <<P>>_HEALTH_MISMATCH = 1, /* a sensor contradicts the model */
  <<P>>_HEALTH_DETUNED = 2, /* the same with an active command, or a drive is late: the weight of its rate is raised */
  <<P>>_HEALTH_FROZEN = 3, /* a reading does not move: it counts as missing until it does */
  <<P>>_HEALTH_TRIPPED = 4, /* the command goes to <<loop.safe>> until <<p>>_controller_rearm */
  <<P>>_HEALTH_OFFSET = 5 /* the measured tip stays away from a setpoint that stands */
};
/* Why it does. */
enum {
  <<P>>_OFFSET_NONE = 0,
  <<P>>_OFFSET_UNEXPECTED = 1, /* the plan ends at the setpoint: camera (scale, shift, turn), load or stiffness are not as the model has them */
  <<P>>_OFFSET_UNREACHED = 2, /* the plan ends away from it too: the inputs do not lead the tip there, or other weights do not let them */
  <<P>>_OFFSET_LIMITED = 3 /* the same, by a limit of an input or a constraint */
};
/* What contradicts the model. */
enum {
<<for name, k in sensors|,\n>>  <<P>>_SENSOR_<<name>> = <<k>><<end>>
};
/* Why a controller is tripped. */
enum {
  <<P>>_TRIP_NONE = 0,
  <<P>>_TRIP_SWINGING = 1, /* mismatch and an active command, though the weight of its rate is raised 64-fold */
  <<P>>_TRIP_CONTRADICTED = 2, /* a sensor contradicts the model by many standard deviations */
  <<P>>_TRIP_AWAY = 3, /* mismatch, and the tip stays far from its setpoint */
  <<P>>_TRIP_UNSEEN = 4, /* no sensor that shows the shape moves, or is there and within its limits */
  <<P>>_TRIP_UNANSWERED = 5, /* the drives move, and a sensor that should show it shows noise */
  <<P>>_TRIP_IMPLAUSIBLE = 6 /* an estimated disturbance stays at a limit of what it can be */
};

/* What is known of the last call. */
typedef struct {
<<for kind, name, text, place in diagnosis|\n>>  <<kind>> <<name>>; /* <<text>> */<<end>>
} <<p>>_diagnosis;

/* Make a controller ready, with the settings and the first state of the scene that it was made from. */
#define <<p>>_controller_init(controller) <<p>>_controller_init_abi((controller), <<P>>_ABI)
int <<p>>_controller_init_abi(<<p>>_controller *controller, uint32_t abi);
/* Setpoints to begin with: those with which the scene begins, at every node. */
#define <<p>>_reference_init(reference) <<p>>_reference_init_abi((reference), <<P>>_ABI)
int <<p>>_reference_init_abi(<<p>>_reference *reference, uint32_t abi);
/* Begin anew at a state, with the command that was applied before; settings stay. */
int <<p>>_controller_start(<<p>>_controller *controller, const <<p>>_<<loop.start.name>> *state, const <<p>>_command *before);
/* The command for <<if loop.estimation>>a measurement<<else>>the state<<end>> and setpoints.
   Zero: of a new plan. <<P>>_WARN_ITERATION_LIMIT, <<P>>_WARN_BOUND_LEFT: of a new plan all the same.
   <<P>>_WARN_PREVIOUS_PLAN, <<P>>_WARN_SAFE_RAMP: there is none; of the last plan as long as it lasts, then en route to
   <<loop.safe>>, at a bounded rate; <<p>>_controller_diagnosis tells why.
   A command that is written is finite, and changes at its rate at most. It is within the limits, but where these were
   moved faster than its rate allows, or the command before the start is beyond them: then it is on its way to them, by
   <<P>>_WARN_BEYOND_LIMIT where it is of a new plan. Below zero (null pointer, interface, settings) the command is left
   alone, and the controller is as it was. */
int <<p>>_mpc(<<p>>_controller *controller, <<p>>_controller_work *work, const <<p>>_measurement *measurement,
<<indent_mpc>>const <<p>>_reference *reference, <<p>>_command *command);
/* Before the next call: what was really applied since the last one; the last command by default. Drives that
   are off or overshoot are no error: <<for f in loop.applied.fields|, >><<f.name>> <<f.limits>><<if not f.limits>>any finite number of<<end>> <<f.unit>><<end>>. */
int <<p>>_controller_applied(<<p>>_controller *controller, const <<p>>_command *applied);
/* Before the next call: that the last command came late, so that the next is of the previous plan. */
int <<p>>_controller_late(<<p>>_controller *controller);
/* Before the next call: time since the last one [s], by which missed calls are bridged, and a wrong call rate is noticed.
   Zero: a clock that stood still or went back, which is noticed and not used. */
int <<p>>_controller_elapsed(<<p>>_controller *controller, <<p>>_real seconds);
/* Before the next call: age of its measurement [s]<<if loop.estimation>>, as usual (<<loop.periods>> periods) by default. One that is no younger than the last is not
   used<<else>>, which without an estimator is without effect<<end>>. */
int <<p>>_controller_age(<<p>>_controller *controller, <<p>>_real seconds);
/* Leave a trip: 1, or 0 where the command does not rest yet, sensors and model do not agree, or it was the second trip
   within 150 averaging times, which only <<p>>_controller_start ends. */
int <<p>>_controller_rearm(<<p>>_controller *controller);
/* State (and disturbances) from which the last plan starts. */
int <<p>>_controller_estimate(const <<p>>_controller *controller, <<p>>_<<loop.start.name>> *estimate);
/* What is known of the last call. */
int <<p>>_controller_diagnosis(const <<p>>_controller *controller, <<p>>_diagnosis *diagnosis);
