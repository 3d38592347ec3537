/* The finger with the parameters of now, and what the variables say of it. */
static void fmu_taken(const fmu_instance *f, <<p>>_model *model, <<p>>_state *state, <<p>>_input *input<<if forces>>,
                      <<p>>_forces *forces<<end>>)
{
  const double *values = f->data.values;
  <<p>>_init(model);<<if parameters>>
  memcpy(&model->parameters, values + FMU_PARAMETERS, sizeof model->parameters);<<end>>
  memcpy(state, values + FMU_STATE, sizeof *state);
  memcpy(input, values + FMU_INPUTS, sizeof *input);<<if forces>>
  memcpy(forces, values + FMU_FORCES, sizeof *forces);<<end>>
}

static fmu_level fmu_show(fmu_instance *f)
{
  <<p>>_model model;
  <<p>>_state state;
  <<p>>_input input;<<if forces>>
  <<p>>_forces forces;<<end>>
  <<p>>_section section;
  <<p>>_rate rate;<<if contacts>>
  <<p>>_contacts contacts;<<end>>
  double *values = f->data.values;
  int code<<if unit.linear>>, k<<end>><<if contacts>>, k<<end>>;
  fmu_taken(f, &model, &state, &input<<acting>>);
  if ((code = <<p>>_tip(&model, &state, &input, &section)) < 0) return fmu_judged(f, "tip", code);
  values[FMU_TIP] = section.x;
  values[FMU_TIP + 1] = section.y;
  values[FMU_TIP + 2] = section.angle;<<if contacts>>
  /* A state that is out of its ranges is still drawn; its contacts are not known. */
  for (k = 0; k < (int)(sizeof contacts / sizeof *values); ++k) values[FMU_CONTACTS + k] = NAN;
  if (<<p>>_touch(&model, &state, &input<<touched>>, &contacts) >= 0) memcpy(values + FMU_CONTACTS, &contacts, sizeof contacts);<<end>>
  code = <<p>>_dynamics(&model, &state, &input<<acting>>, &rate);
  if (code < 0 && f->data.mode != FMU_STEPPING) return fmu_judged(f, "dynamics", code);<<if unit.linear>>
  /* A state that no step takes is still drawn; it has no rate. */
  for (k = 0; k < <<P>>_NX; ++k) values[FMU_RATES + k] = NAN;
  if (code >= 0) memcpy(values + FMU_RATES, &rate, sizeof rate);<<end>>
  f->data.shown = 1;
  return FMU_OK;
}

static fmu_level fmu_advance(fmu_instance *f, double h)
{
  <<p>>_model model;
  <<p>>_state state;
  <<p>>_input input;<<if forces>>
  <<p>>_forces forces;<<end>>
  fmu_level level;
  fmu_taken(f, &model, &state, &input<<acting>>);
  level = fmu_judged(f, "step", <<p>>_step(&model, &state, &input<<acting>>, h, &state));
  if (level > FMU_WARNING) return level;
  memcpy(f->data.values + FMU_STATE, &state, sizeof state);
  f->data.shown = 0;
  return level;
}

