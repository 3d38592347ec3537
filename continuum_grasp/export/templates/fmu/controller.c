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
  int code, k;
  if (m->computed && f->data.shown) return FMU_OK;
  if (!m->begun) <<p>>_controller_init(&m->now);
  m->begun = 1;
  m->next = m->now;
  memcpy(&m->next.settings, values + FMU_SETTINGS, sizeof m->next.settings);<<if known>>
  memcpy(&m->next.known, values + FMU_KNOWN, sizeof m->next.known);<<end>>
  memcpy(&measurement, values + FMU_MEASUREMENT, sizeof measurement);
  for (k = 0; k < <<nodes>>; ++k) {
<<for name, at in reference>>    f->scratch.reference.<<name>>[k] = values[FMU_REFERENCE + <<at>>];
<<end>>  }
  code = <<p>>_mpc(&m->next, &f->scratch.work, &measurement, &f->scratch.reference, &command);
  if ((level = fmu_judged(f, "mpc", code)) > FMU_WARNING) return level;
  <<p>>_controller_estimate(&m->next, &estimate);
  <<p>>_controller_diagnosis(&m->next, &diagnosis);
  memcpy(values + FMU_COMMAND, &command, sizeof command);
  memcpy(values + FMU_ESTIMATE, &estimate, sizeof estimate);
<<for k, name in diagnosed>>  values[FMU_DIAGNOSIS + <<k>>] = diagnosis.<<name>>;
<<end>><<for name, place in counted|\n>>  f->data.counts[FMU_<<place>>] = (int)diagnosis.<<name>>;<<end>>
  m->computed = f->data.shown = 1;
  return level;
}

/* After a step the results stay, until an input is set. */
static fmu_level fmu_show(fmu_instance *f) { return fmu_computed(f); }

static fmu_level fmu_advance(fmu_instance *f)
{
  fmu_level level;
  if (!f->data.shown) f->data.model.computed = 0;
  f->data.shown = f->data.model.computed;
  if ((level = fmu_computed(f)) > FMU_WARNING) return level;
  f->data.model.now = f->data.model.next;
  f->data.model.computed = 0;
  return level;
}

