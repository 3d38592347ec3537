/* Compute what the next step will do, unless it is known: outputs are those of the inputs of now, and the step takes
   over what led to them. */
static fmu_level fmu_computed(fmu_instance *f)
{
  fmu_model *m = &f->data.model;
  double *values = f->data.values;
  <<p>>_measurement measurement;
  <<p>>_command command;
  <<p>>_<<start>> estimate;
  <<p>>_diagnosis diagnosis;
  fmu_level level;
  int code<<if alone>>, k<<end>>;
  if (m->computed && f->data.shown) return FMU_OK;
  if (!m->begun) <<p>>_<<kind>>_init(&m->now);
  m->begun = 1;
  m->next = m->now;
<<if known>>  memcpy(&m->next<<inner>>.known, values + FMU_KNOWN, sizeof m->next<<inner>>.known);
<<end>>  memcpy(&measurement, values + FMU_MEASUREMENT, sizeof measurement);
<<if alone>>  memcpy(&m->next.settings, values + FMU_SETTINGS, sizeof m->next.settings);
  for (k = 0; k < <<nodes>>; ++k) {
<<for name, at in reference>>    f->scratch.reference.<<name>>[k] = values[FMU_REFERENCE + <<at>>];
<<end>>  }
  code = <<p>>_mpc(&m->next, &f->scratch.work, &measurement, &f->scratch.reference, &command);
  if ((level = fmu_judged(f, "mpc", code)) > FMU_WARNING) return level;
<<else>><<for k, name in events>>  if (values[FMU_EVENTS + <<k>>] > 0.5) <<p>>_mission_<<name>>(&m->next);
<<end>><<if watches>>  <<p>>_mission_height(&m->next, values[FMU_HEIGHT]);
<<end>>  code = <<p>>_mission_step(&m->next, &f->scratch.work, &measurement, &command);
  if ((level = fmu_judged(f, "mission_step", code)) > FMU_WARNING) return level;
<<for name, place in states>>  f->data.counts[FMU_<<place>>] = <<p>>_mission_<<name>>(&m->next);
<<end>><<end>>  <<p>>_controller_estimate(&m->next<<inner>>, &estimate);
  <<p>>_controller_diagnosis(&m->next<<inner>>, &diagnosis);
  memcpy(values + FMU_COMMAND, &command, sizeof command);
  memcpy(values + FMU_ESTIMATE, &estimate, sizeof estimate);
<<for k, name in diagnosed>>  values[FMU_DIAGNOSIS + <<k>>] = diagnosis.<<name>>;
<<end>><<for name, place in counted|\n>>  f->data.counts[FMU_<<place>>] = (int)diagnosis.<<name>>;<<end>>
  m->computed = f->data.shown = 1;
  return level;
}

/* After a step the results stay, until an input is set. */
static fmu_level fmu_show(fmu_instance *f) { return fmu_computed(f); }

static fmu_level fmu_advance(fmu_instance *f, double h)
{
  fmu_level level;
  (void)h; /* the period, always */
  if (!f->data.shown) f->data.model.computed = 0;
  f->data.shown = f->data.model.computed;
  if ((level = fmu_computed(f)) > FMU_WARNING) return level;
  f->data.model.now = f->data.model.next;
  f->data.model.computed = 0;
  return level;
}

