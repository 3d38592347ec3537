static int run_<<call.name>>(check_memory *memory, const <<p>>_real *row, <<p>>_real *out, uint32_t other_abi, int null,
<<indent>>int repeat)
{
  <<p>>_model model;
<<for a in declared|\n>>  <<p>>_<<a.kind.name>> <<a.name>>;<<end>>
  int k, code = <<p>>_init(&model);
  (void)memory;
<<for a, at in copied|\n>>  memcpy(&<<if a.is_member>>model.<<end>><<a.name>>, row + <<at>>, sizeof <<if a.is_member>>model.<<end>><<a.name>>);<<end>>
  memcpy(&<<call.output.name>>, out, sizeof <<call.output.name>>);
  model.abi ^= other_abi;
  for (k = 0; k < repeat; ++k)
    code = <<p>>_<<call.name>>(<<for each in passed|, >><<each>><<end>>);
  memcpy(out, &<<call.output.name>>, sizeof <<call.output.name>>);
  return code;
}
