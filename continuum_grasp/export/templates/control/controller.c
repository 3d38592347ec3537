typedef char <<p>>_controller_fits[sizeof(<<p>>_controller) <= <<P>>_CONTROLLER_BYTES ? 1 : -1];
typedef char <<p>>_controller_work_fits[sizeof(<<p>>_controller_work) <= <<P>>_CONTROLLER_WORK_BYTES ? 1 : -1];

int <<p>>_controller_init_abi(<<p>>_controller *controller, uint32_t abi)
{
  if (!controller) return <<P>>_ERR_NULL;
  if (abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  memset(controller, 0, sizeof *controller);
  controller->abi = abi;
  controller->memory.elapsed = controller->memory.age = -1; /* unknown: the call rate is not judged, the age as usual */
  settings_written(settings_nominal, &controller->settings);<<if known>>
  known_written(known_nominal, &controller->known);<<end>>
  <<p>>_loop_start(&controller->memory.state, &settings_exported, first_state, command_first, <<if known>>known_nominal<<else>>0<<end>>);
  return <<P>>_OK;
}

int <<p>>_reference_init_abi(<<p>>_reference *reference, uint32_t abi)
{
  int k;
  if (!reference) return <<P>>_ERR_NULL;
  if (abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  for (k = 0; k < <<P>>_NODES; ++k) {
<<for j, field in setpoints>>    reference-><<field.name>>[k] = first_setpoints[<<j>>];
<<end>>  }
  return <<P>>_OK;
}

int <<p>>_controller_start(<<p>>_controller *controller, const <<p>>_<<loop.start.name>> *state, const <<p>>_command *before)
{
  <<p>>_real z[<<loop.start.size>>], u[<<loop.command.size>>];
  int code;
  if (!controller || !state || !before) return <<P>>_ERR_NULL;
  if (controller->abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  <<loop.start.name>>_read(state, z);
  command_read(before, u);
  if ((code = check(z, <<loop.start.name>>_low, <<loop.start.name>>_high, <<loop.start.size>>)) < 0) return code;
  if ((code = check(u, applied_low, applied_high, <<loop.command.size>>)) < 0) return code;
  memset(&controller->memory, 0, sizeof controller->memory);
  controller->memory.elapsed = controller->memory.age = -1;
  <<p>>_loop_start(&controller->memory.state, &settings_exported, z, u, <<if known>>known_nominal<<else>>0<<end>>);
  return <<P>>_OK;
}

int <<p>>_controller_applied(<<p>>_controller *controller, const <<p>>_command *applied)
{
  <<p>>_real u[<<loop.command.size>>];
  int code;
  if (!controller || !applied) return <<P>>_ERR_NULL;
  if (controller->abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  command_read(applied, u);
  if ((code = check(u, applied_low, applied_high, <<loop.command.size>>)) < 0) return code;
  memcpy(controller->memory.applied, u, sizeof u); /* beside the last command, by which the next one stays within limits */
  controller->memory.differs = 1;
  return <<P>>_OK;
}

int <<p>>_controller_late(<<p>>_controller *controller)
{
  if (!controller) return <<P>>_ERR_NULL;
  if (controller->abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  controller->memory.late = 1;
  return <<P>>_OK;
}

int <<p>>_controller_elapsed(<<p>>_controller *controller, <<p>>_real seconds)
{
  if (!controller) return <<P>>_ERR_NULL;
  if (controller->abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  if (!<<p>>_checks_finite(&seconds, 1) || seconds < 0) return <<P>>_ERR_RANGE;
  controller->memory.elapsed = seconds;
  return <<P>>_OK;
}

int <<p>>_controller_age(<<p>>_controller *controller, <<p>>_real seconds)
{
  if (!controller) return <<P>>_ERR_NULL;
  if (controller->abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  if (!<<p>>_checks_finite(&seconds, 1) || seconds < 0) return <<P>>_ERR_RANGE;
  controller->memory.age = seconds;
  return <<P>>_OK;
}

int <<p>>_controller_rearm(<<p>>_controller *controller)
{
  if (!controller) return <<P>>_ERR_NULL;
  if (controller->abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  return <<p>>_loop_rearm(&controller->memory.state, &settings_exported);
}

/* The settings of this call, from those of the caller. */
static int settings_taken(const <<p>>_controller *controller, <<p>>_loop_settings *to)
{
  <<p>>_real numbers[<<loop.settings.size>>];
  int code;
  settings_read(&controller->settings, numbers);
  if ((code = check(numbers, settings_low, settings_high, <<loop.settings.size>>)) < 0) return code;
  memcpy(to, &settings_exported, sizeof *to);
<<for member, at, count in taken>>  memcpy(to->rti.<<member>>, numbers + <<at>>, <<count>> * sizeof *numbers);
<<end>>  return <<p>>_rti_settings_valid(&to->rti) ? <<P>>_OK : <<P>>_ERR_RANGE;
}

int <<p>>_mpc(<<p>>_controller *controller, <<p>>_controller_work *work, const <<p>>_measurement *measurement,
<<indent_mpc>>const <<p>>_reference *reference, <<p>>_command *command)
{
  static const signed char codes[] = {
      <<P>>_OK, <<P>>_WARN_ITERATION_LIMIT, <<P>>_WARN_BOUND_LEFT, <<P>>_WARN_PREVIOUS_PLAN, <<P>>_WARN_SAFE_RAMP};
  <<p>>_real y[<<loop.measurement.size>>]<<if known>>, p[<<known>>]<<end>>;
  <<p>>_loop_input input;
  int code, k;
  <<P>>_SCRATCH(controller);
  if (!controller || !work || !measurement || !reference || !command) return <<P>>_ERR_NULL;
  if (controller->abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  if ((code = settings_taken(controller, &work->settings)) < 0) return code;
  measurement_read(measurement, y);<<if known>>
  known_read(&controller->known, p);<<end>>
  for (k = 0; k <= <<P>>_RTI_N; ++k) {
<<for j, field in setpoints>>    work->reference[k][<<j>>] = reference-><<field.name>>[k];
<<end>>  }
  input.measurement = y;
  input.setpoints = &work->reference[0][0];
  input.p = <<if known>>p<<else>>0<<end>>;
  input.applied = controller->memory.differs ? controller->memory.applied : 0;
  input.late = controller->memory.late;
  input.elapsed = controller->memory.elapsed;
  input.age = controller->memory.age;
  code = <<p>>_loop_step(&controller->memory.state, &work->loop, &work->settings, &input, &controller->memory.last);
  controller->memory.late = controller->memory.differs = 0;
  controller->memory.elapsed = controller->memory.age = -1;
  if (code < 0 || check(controller->memory.last.u, applied_low, applied_high, <<loop.command.size>>) < 0) return <<P>>_ERR_RESULT;
  command_written(controller->memory.last.u, command);
  if (code < <<P>>_LOOP_PREVIOUS_PLAN
      && check(controller->memory.last.u, work->settings.rti.u_min, work->settings.rti.u_max, <<loop.command.size>>) < 0)
    return <<P>>_WARN_BEYOND_LIMIT; /* the last command, from which the rate counts, was beyond them too */
  return codes[code];
}

int <<p>>_controller_estimate(const <<p>>_controller *controller, <<p>>_<<loop.start.name>> *estimate)
{
  <<p>>_real z[<<loop.start.size>>];
  if (!controller || !estimate) return <<P>>_ERR_NULL;
  if (controller->abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  memcpy(z, controller->memory.last.x, <<loop.stages.nd>> * sizeof *z);
<<if disturbances>>  memcpy(z + <<loop.stages.nd>>, controller->memory.state.ekf.z + <<loop.stages.nd>>, <<disturbances>> * sizeof *z);
<<end>>  <<loop.start.name>>_written(z, estimate);
  return <<P>>_OK;
}

int <<p>>_controller_diagnosis(const <<p>>_controller *controller, <<p>>_diagnosis *diagnosis)
{
  if (!controller || !diagnosis) return <<P>>_ERR_NULL;
  if (controller->abi != <<P>>_ABI) return <<P>>_ERR_ABI;
<<for kind, name, text, place in diagnosis>>  diagnosis-><<name>> = controller->memory.last.<<place>>;
<<end>>  return <<P>>_OK;
}
