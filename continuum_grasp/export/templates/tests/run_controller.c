static int mpc_run(check_memory *memory, const <<p>>_real *row, <<p>>_real *out, uint32_t abi_bits, int null,
                   int repeat)
{
  <<p>>_measurement measurement;
  <<p>>_reference reference;
  <<p>>_command command, applied;
  <<p>>_<<loop.start.name>> estimate;
  <<p>>_diagnosis diagnosis;
  <<p>>_real nodes[<<loop.stages.nr>> * <<loop.nodes>>];
  int j, k, code = 0;
  if (row[0] > 0) <<p>>_controller_init(&memory->controller);
  memcpy(&memory->controller.settings, row + 4, sizeof memory->controller.settings);
<<if loop.known>>  memcpy(&memory->controller.known, row + <<known>>, sizeof memory->controller.known);
<<end>>  memcpy(&measurement, row + <<measurement>>, sizeof measurement);
  for (j = 0; j < <<loop.stages.nr>>; ++j)
    for (k = 0; k < <<loop.nodes>>; ++k)
      nodes[j * <<loop.nodes>> + k] = (<<p>>_real)k < row[<<switch>>] ? row[<<wanted>> + j] : row[<<later>> + j];
  memcpy(&reference, nodes, sizeof reference);
  memcpy(&applied, row + <<applied>>, sizeof applied);
  if (row[1] > 0) <<p>>_controller_late(&memory->controller);
  if (row[2] > 0) <<p>>_controller_applied(&memory->controller, &applied);
  memcpy(&command, out, sizeof command);
  memory->controller.abi ^= abi_bits;
  for (k = 0; k < repeat; ++k)
    code = <<p>>_mpc(null == 1 ? 0 : &memory->controller, null == 2 ? 0 : &memory->controller_work,
                   null == 3 ? 0 : &measurement, null == 4 ? 0 : &reference, null == 5 ? 0 : &command);
  memory->controller.abi ^= abi_bits;
  memcpy(out, &command, sizeof command);
  if (code < 0 || repeat == 0) return code;
  for (j = 0; j < <<loop.command.size>>; ++j) /* beyond its settings only by its own warning; no code is -128 */
    if (code < <<P>>_WARN_PREVIOUS_PLAN && (out[j] < row[<<low>> + j] || out[j] > row[<<low>> + <<loop.command.size>> + j])) return -128;
  <<p>>_controller_estimate(&memory->controller, &estimate);
  <<p>>_controller_diagnosis(&memory->controller, &diagnosis);
  memcpy(out + <<loop.command.size>>, &estimate, sizeof estimate);
  out[<<behind>>] = (<<p>>_real)diagnosis.anomalies;
  out[<<behind>> + 1] = (<<p>>_real)diagnosis.iterations;
  out[<<behind>> + 2] = diagnosis.violation;
  out[<<behind>> + 3] = (<<p>>_real)diagnosis.health;
  out[<<behind>> + 4] = diagnosis.mismatch;
  return code;
}
