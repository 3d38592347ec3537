static fmi<<v>>Status fmi<<v>>_refused(<<handle>> c, const char *what)
{
  return c ? (fmi<<v>>Status)fmu_say((fmu_instance *)c, FMU_ERROR, "%s", what) : fmi<<v>>Error;
}

FMI<<v>>(const char *, fmi<<v>>GetVersion)(void) { return "<<v>>.0"; }

FMI<<v>>(fmi<<v>>Status, fmi<<v>>SetDebugLogging)(<<handle>> c, fmi<<v>>Boolean on, size_t n, const fmi<<v>>String categories[])
{
  (void)n;
  (void)categories;
  if (!c) return fmi<<v>>Error;
  ((fmu_instance *)c)->logging = on;
  return fmi<<v>>OK;
}

FMI<<v>>(void, fmi<<v>>FreeInstance)(<<handle>> c) { free(c); }

FMI<<v>>(fmi<<v>>Status, fmi<<v>>ExitInitializationMode)(<<handle>> c) { return (fmi<<v>>Status)fmu_exit((fmu_instance *)c); }

FMI<<v>>(fmi<<v>>Status, fmi<<v>>Terminate)(<<handle>> c)
{
  const fmu_level level = fmu_allowed((fmu_instance *)c, FMU_STEPPING, "Terminate");
  if (level == FMU_OK) ((fmu_instance *)c)->data.mode = FMU_TERMINATED;
  return (fmi<<v>>Status)level;
}

FMI<<v>>(fmi<<v>>Status, fmi<<v>>Reset)(<<handle>> c)
{
  if (!c) return fmi<<v>>Error;
  fmu_restart((fmu_instance *)c);
  return fmi<<v>>OK;
}

FMI<<v>>(fmi<<v>>Status, fmi<<v>>Get<<state>>)(<<handle>> c, fmi<<v>><<state>> *state)
{
  fmu_data *made;
  if (!c || !state) return fmi<<v>>Error;
  made = fmu_copied(&((fmu_instance *)c)->data);
  if (!made) return fmi<<v>>_refused(c, "no memory");
  free(*state);
  *state = made;
  return fmi<<v>>OK;
}

FMI<<v>>(fmi<<v>>Status, fmi<<v>>Set<<state>>)(<<handle>> c, fmi<<v>><<state>> state)
{
  if (!c || !state) return fmi<<v>>Error;
  memcpy(&((fmu_instance *)c)->data, state, sizeof(fmu_data));
  return fmi<<v>>OK;
}

FMI<<v>>(fmi<<v>>Status, fmi<<v>>Free<<state>>)(<<handle>> c, fmi<<v>><<state>> *state)
{
  (void)c;
  if (state) {
    free(*state);
    *state = NULL;
  }
  return fmi<<v>>OK;
}

FMI<<v>>(fmi<<v>>Status, fmi<<v>>Serialized<<state>>Size)(<<handle>> c, fmi<<v>><<state>> state, size_t *size)
{
  if (!c || !state || !size) return fmi<<v>>Error;
  *size = FMU_BYTES;
  return fmi<<v>>OK;
}

FMI<<v>>(fmi<<v>>Status, fmi<<v>>Serialize<<state>>)(<<handle>> c, fmi<<v>><<state>> state, fmi<<v>>Byte bytes[], size_t size)
{
  return (fmi<<v>>Status)fmu_packed((fmu_instance *)c, (const fmu_data *)state, (char *)bytes, size);
}

FMI<<v>>(fmi<<v>>Status, fmi<<v>><<from_bytes>>)(<<handle>> c, const fmi<<v>>Byte bytes[], size_t size, fmi<<v>><<state>> *state)
{
  fmu_data *made = NULL;
  const fmu_level level = state ? fmu_unpacked((fmu_instance *)c, (const char *)bytes, size, &made) : FMU_ERROR;
  if (level == FMU_OK) {
    free(*state);
    *state = made;
  }
  return (fmi<<v>>Status)level;
}

<<for name, type, call in accessors|\n>>FMI<<v>>(fmi<<v>>Status, fmi<<v>><<name>>)(<<handle>> c, const fmi<<v>>ValueReference vr[], size_t n,
                         <<type>> values[]<<if counted>>, size_t m<<end>>)
{<<if counted>>
  if (n != m) return fmi<<v>>_refused(c, "<<name>>: expected as many values as variables");<<end>>
  return (fmi<<v>>Status)<<call>>((fmu_instance *)c, vr, n, values);
}
<<end>>
FMI<<v>>(fmi<<v>>Status, fmi<<v>>GetDirectionalDerivative)(<<handle>> c, const fmi<<v>>ValueReference unknowns[], size_t n,
                         const fmi<<v>>ValueReference knowns[], size_t m, const double seed[]<<if counted>>, size_t n_seed<<end>>,
                         double sensitivity[]<<if counted>>, size_t n_sensitivity<<end>>)
{<<if counted>>
  if (n_seed != m || n_sensitivity != n)
    return fmi<<v>>_refused(c, "GetDirectionalDerivative: expected a seed per known and a place per unknown");<<end>><<if linear>>
  return (fmi<<v>>Status)fmu_directional((fmu_instance *)c, unknowns, n, knowns, m, seed, sensitivity);<<else>>
  (void)unknowns;
  (void)n;
  (void)knowns;
  (void)m;
  (void)seed;
  (void)sensitivity;
  return fmi<<v>>_refused(c, "GetDirectionalDerivative: not provided");<<end>>
}
