typedef char <<p>>_mission_fits[sizeof(<<p>>_mission) <= <<P>>_MISSION_BYTES ? 1 : -1];
typedef char <<p>>_mission_work_fits[sizeof(<<p>>_mission_work) <= <<P>>_MISSION_WORK_BYTES ? 1 : -1];

/* Begin the first phase, with what the controller started from. */
static void begin_mission(<<p>>_mission *mission)
{
  memset(&mission->memory, 0, sizeof mission->memory);
  <<p>>_phases_start(&mission->memory.state, &settings_of_phases, 0, mission->controller.memory.state.u);
}

int <<p>>_mission_init_abi(<<p>>_mission *mission, uint32_t abi)
{
  int code;
  if (!mission) return <<P>>_ERR_NULL;
  if ((code = <<p>>_controller_init_abi(&mission->controller, abi)) < 0) return code;
  mission->abi = abi;
  begin_mission(mission);
  return <<P>>_OK;
}

/* Whether a mission can be used. */
static int mission_ready(const <<p>>_mission *mission)
{
  if (!mission) return <<P>>_ERR_NULL;
  return mission->abi == <<P>>_ABI ? <<P>>_OK : <<P>>_ERR_ABI;
}

int <<p>>_mission_start(<<p>>_mission *mission, const <<p>>_<<loop.start.name>> *state, const <<p>>_command *before)
{
  int code = mission_ready(mission);
  if (code < 0 || (code = <<p>>_controller_start(&mission->controller, state, before)) < 0) return code;
  begin_mission(mission);
  return <<P>>_OK;
}

/* Normal forces at the contacts, by the estimate from which the last plan starts. */
static void estimated_forces(const <<p>>_controller *controller, <<p>>_real *forces)
{
  <<p>>_real z[<<loop.start.size>>];
  const <<p>>_real *arg[3];
  <<p>>_real *res[1];
  arg[0] = z;
  arg[1] = controller->memory.last.u;
  arg[2] = controller->memory.last.p;
  res[0] = forces;
  memcpy(z, controller->memory.last.x, <<loop.stages.nd>> * sizeof *z);
<<if disturbances>>  memcpy(z + <<loop.stages.nd>>, controller->memory.state.ekf.z + <<loop.stages.nd>>, <<disturbances>> * sizeof *z);
<<end>>  <<p>>_call_estimator_forces(arg, res);
}

/* Time of the next call. */
static <<p>>_real mission_now(const <<p>>_mission *mission) { return (<<p>>_real)mission->memory.calls * settings_of_phases.period; }

int <<p>>_mission_step(<<p>>_mission *mission, <<p>>_mission_work *work, const <<p>>_measurement *measurement,
<<indent_mission>><<p>>_command *command)
{
  const int ready = mission_ready(mission);
  const <<p>>_real now = ready < 0 ? 0 : mission_now(mission);
  <<p>>_real row[<<loop.stages.nr>>], numbers[<<loop.settings.size>>], forces[<<P>>_PHASES_SIZE(<<P>>_PHASES_NC)];
  <<p>>_phases_state next;
  int code, k;
  <<P>>_SCRATCH(mission);
  if (ready < 0 || !work || !measurement || !command) return ready < 0 ? ready : <<P>>_ERR_NULL;
  memcpy(&next, &mission->memory.state, sizeof next);
  if (mission->memory.calls > 0) {
    const <<p>>_real *before = mission->controller.memory.state.u;
    const int reported = <<if loop.phases.reported>>mission->memory.reported<<else>><<P>>_PHASES_BEARS<<end>>;
    next.sight = mission->controller.memory.last.sight;
    <<p>>_phases_advance(&next, &settings_of_phases, now, 0, before, reported);
    if (<<p>>_phases_asks(&next, &settings_of_phases)) {
      estimated_forces(&mission->controller, forces);
      <<p>>_phases_advance(&next, &settings_of_phases, now, forces, before, reported);
    }
  }
  for (k = 0; k < <<P>>_NODES; ++k) {
    <<p>>_phases_setpoints(&next, &settings_of_phases, now + (<<p>>_real)k * settings_exported.rti.stage, row);
<<for j, field in setpoints>>    work->reference.<<field.name>>[k] = row[<<j>>];
<<end>>  }
  memcpy(numbers, settings_nominal, sizeof numbers);
  memcpy(numbers, settings_of_phases.weights[next.follows], <<loop.stages.nr>> * sizeof *numbers);
  memcpy(numbers + <<u_min>>, next.u_min, sizeof next.u_min);
  memcpy(numbers + <<u_max>>, next.u_max, sizeof next.u_max);
  settings_written(numbers, &mission->controller.settings);
  code = <<p>>_mpc(&mission->controller, &work->controller, measurement, &work->reference, command);
  if (code < 0) return code;
  memcpy(&mission->memory.state, &next, sizeof next);
  if (mission->memory.calls < 0xFFFFFFu) ++mission->memory.calls; /* whole numbers of a float */
  return code;
}

static int let_go(<<p>>_mission *mission, int at_once)
{
  const int ready = mission_ready(mission);
  if (ready < 0) return ready;
  <<p>>_phases_release(&mission->memory.state, &settings_of_phases, mission_now(mission), mission->controller.memory.state.u,
                       at_once);
  return <<P>>_OK;
}

int <<p>>_mission_release(<<p>>_mission *mission) { return let_go(mission, 0); }

int <<p>>_mission_abort(<<p>>_mission *mission) { return let_go(mission, 1); }

int <<p>>_mission_phase(const <<p>>_mission *mission)
{
  const int ready = mission_ready(mission);
  return ready < 0 ? ready : mission->memory.state.phase;
}

int <<p>>_mission_decision(const <<p>>_mission *mission)
{
  const int ready = mission_ready(mission);
  return ready < 0 ? ready : mission->memory.state.decision;
}

int <<p>>_mission_forces(const <<p>>_mission *mission)
{
  const int ready = mission_ready(mission);
  return ready < 0 ? ready : mission->memory.state.bears;
}
<<if loop.phases.watches>>
int <<p>>_mission_height(<<p>>_mission *mission, <<p>>_real height)
{
  const int ready = mission_ready(mission);
  if (ready >= 0) <<p>>_phases_see(&mission->memory.state, &settings_of_phases, height);
  return ready;
}

int <<p>>_mission_squeeze(<<p>>_mission *mission)
{
  const int ready = mission_ready(mission);
  if (ready >= 0) <<p>>_phases_squeeze(&mission->memory.state, &settings_of_phases, <<P>>_PHASES_REPORTED);
  return ready;
}

int <<p>>_mission_grip(const <<p>>_mission *mission)
{
  const int ready = mission_ready(mission);
  return ready < 0 ? ready : mission->memory.state.grip;
}
<<end>><<for name, word in loop.phases.reported>>
int <<p>>_mission_<<name>>(<<p>>_mission *mission)
{
  const int ready = mission_ready(mission);
  if (ready >= 0) mission->memory.reported = <<P>>_PHASES_<<word>>;
  return ready;
}
<<end>>
