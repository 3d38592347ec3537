/* ---- the mission: phases, their setpoints and limits, and the controller, once every <<loop.period:g>> s ---- */

/* Phases, in their order. In `confirm` the fingers squeeze on until their contacts bear what is needed to lift. */
enum {
<<for k, name in phases|,\n>>  <<P>>_PHASE_<<name>> = <<k>><<end>>
};
/* Decision before the lift; forces at the contacts, from `confirm` on. */
enum { <<P>>_DECISION_NONE = 0, <<P>>_DECISION_LIFT = 1, <<P>>_DECISION_LET_GO = 2 };
enum { <<P>>_FORCES_UNKNOWN = 0, <<P>>_FORCES_ENOUGH = 1, <<P>>_FORCES_LACK = 2, <<P>>_FORCES_DOUBTED = 3,
       <<P>>_FORCES_BLIND = 4 };
<<if loop.phases.watches>>/* Grip of what is held: as planned, squeezed since it slipped, set down since squeezing did not stop it. */
enum { <<P>>_GRIP_USUAL = 0, <<P>>_GRIP_FIRM = 1, <<P>>_GRIP_SETS_DOWN = 2 };
<<end>>
/* A mission. The caller owns it, <<p>>_mission_init makes it ready. Its controller may be asked for estimate and
   diagnosis, rearmed, and informed of what was applied, of a late command and of the time between calls; its settings are
   the mission's. */
typedef struct {
  uint32_t abi; /* set by <<p>>_mission_init, read by every function */
  <<p>>_controller controller;
  <<p>>_mission_memory memory; /* its own */
} <<p>>_mission;

/* Scratch of a call, which need not be initialized; missions of one thread may share it. */
typedef struct {
  <<p>>_controller_work controller;
  <<p>>_reference reference;
} <<p>>_mission_work;

/* Bytes of both at most. */
#define <<P>>_MISSION_BYTES <<mission_bytes>>
#define <<P>>_MISSION_WORK_BYTES <<mission_work_bytes>>

/* Make a mission ready at its first phase, with the first state of the scene that it was made from. */
#define <<p>>_mission_init(mission) <<p>>_mission_init_abi((mission), <<P>>_ABI)
int <<p>>_mission_init_abi(<<p>>_mission *mission, uint32_t abi);
/* Begin the first phase at a state, with the command that was applied before. */
int <<p>>_mission_start(<<p>>_mission *mission, const <<p>>_<<loop.start.name>> *state, const <<p>>_command *before);
/* The command for a measurement, with the codes of <<p>>_mpc. Behind the last phase commands stay at rest. Below zero
   the command is left alone, and the mission is as it was. */
int <<p>>_mission_step(<<p>>_mission *mission, <<p>>_mission_work *work, const <<p>>_measurement *measurement,
<<indent_mission>><<p>>_command *command);
/* Before the next call: let the object go. It is lowered first (<<P>>_PHASE_LOWER) where it was lifted. */
int <<p>>_mission_release(<<p>>_mission *mission);
/* Before the next call: open at once, wherever the object is. */
int <<p>>_mission_abort(<<p>>_mission *mission);
/* Number of the phase. */
int <<p>>_mission_phase(const <<p>>_mission *mission);
/* Decision before the lift: 0 none, 1 lift, 2 let go. */
int <<p>>_mission_decision(const <<p>>_mission *mission);
/* Forces at the contacts of this finger: 0 unknown, 1 enough to lift, 2 too little, 3 enough by an estimate that
   sensors contradict, which lifts as late as possible, 4 whatever they are: it was blind before the lift, and lets go. */
int <<p>>_mission_forces(const <<p>>_mission *mission);
<<if loop.phases.watches>>/* Before each call: height of the object in the hand [m], from where it does not matter; none where it was not measured. */
int <<p>>_mission_height(<<p>>_mission *mission, <<p>>_real height);
/* Before the next call: squeeze harder, since slip was noticed elsewhere. */
int <<p>>_mission_squeeze(<<p>>_mission *mission);
/* How the object is held: 0 as planned, 1 squeezed, 2 set down<<if loop.phases.reported>>. Where one finger squeezes, squeeze all; where one sets down, release all<<end>>. */
int <<p>>_mission_grip(const <<p>>_mission *mission);
<<end>><<if loop.phases.reported>>/* This finger is one of several<<if loop.phases.leads>>, and decides for all. Before each call from its phase `confirm` on: that all
   others have <<P>>_FORCES_ENOUGH. Until this or the opposite is known, it waits. */
int <<p>>_mission_others_bear(<<p>>_mission *mission);
/* Before each call from the phase `confirm` on: that one of the other fingers has <<P>>_FORCES_LACK. */
int <<p>>_mission_others_lack(<<p>>_mission *mission);
/* The same: that none of them has that, and one <<P>>_FORCES_DOUBTED. */
int <<p>>_mission_others_doubt(<<p>>_mission *mission);
/* Before the next call, in any phase: that one of them has <<P>>_FORCES_BLIND. All let go. */
int <<p>>_mission_others_blind(<<p>>_mission *mission);<<else>>, of which another one decides. Before the next call: that it lifts. */
int <<p>>_mission_lift(<<p>>_mission *mission);
/* Before the next call, in any phase: that the finger that decides lets go. */
int <<p>>_mission_let_go(<<p>>_mission *mission);<<end>>
<<end>>
