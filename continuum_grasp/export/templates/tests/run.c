static int <<call.name>>_run(check_memory *memory, const <<p>>_real *row, <<p>>_real *out, uint32_t abi_bits, int null,
<<indent>>int repeat)
{
  <<p>>_model model;
<<for kind, name in declared|\n>>  <<p>>_<<kind>> <<name>>;<<end>>
  int k, code = <<p>>_init(&model);
  (void)memory;
<<for a, at in copied|\n>>  memcpy(&<<if a.is_member>>model.<<end>><<a.name>>, row + <<at>>, sizeof <<if a.is_member>>model.<<end>><<a.name>>);<<end>>
  memcpy(&result, out, sizeof result);
  model.abi ^= abi_bits;
  for (k = 0; k < repeat; ++k)
    code = <<p>>_<<call.name>>(<<for each in passed|, >><<each>><<end>>);
  memcpy(out, &result, sizeof result);
  return code;
}
