static int mission_step_run(check_memory *memory, const <<p>>_real *row, <<p>>_real *out, uint32_t abi_bits, int null,
                            int repeat)
{
  <<p>>_measurement measurement;
  <<p>>_command command;
  <<p>>_<<loop.start.name>> estimate;
  int k, code = 0;
  if (row[0] > 0) <<p>>_mission_init(&memory->mission);
  memcpy(&measurement, row + <<measurement>>, sizeof measurement);
  if (row[1] > 0) <<p>>_mission_release(&memory->mission);
  if (row[2] > 0) <<p>>_mission_abort(&memory->mission);
<<if watches>>  <<p>>_mission_height(&memory->mission, row[<<height>>]);
<<end>><<for k, name in reported>>  if (row[<<reported_at>>] == (<<p>>_real)<<k>>) <<p>>_mission_<<name>>(&memory->mission);
<<end>>  memcpy(&command, out, sizeof command);
  memory->mission.abi ^= abi_bits;
  for (k = 0; k < repeat; ++k)
    code = <<p>>_mission_step(null == 1 ? 0 : &memory->mission, null == 2 ? 0 : &memory->mission_work,
                            null == 3 ? 0 : &measurement, null == 4 ? 0 : &command);
  memory->mission.abi ^= abi_bits;
  memcpy(out, &command, sizeof command);
  if (code < 0 || repeat == 0) return code;
  <<p>>_controller_estimate(&memory->mission.controller, &estimate);
  memcpy(out + <<loop.command.size>>, &estimate, sizeof estimate);
  out[<<behind>>] = (<<p>>_real)<<p>>_mission_phase(&memory->mission);
  out[<<behind>> + 1] = (<<p>>_real)<<p>>_mission_decision(&memory->mission);
  out[<<behind>> + 2] = (<<p>>_real)<<p>>_mission_forces(&memory->mission);
  return code;
}
