static int run_<<name>>(check_memory *memory, const <<p>>_real *row, <<p>>_real *out, uint32_t other_abi, int null,
<<indent>>int repeat)
{
  <<p>>_model model;
<<declared>>
  int k, code = <<p>>_init(&model);
  (void)memory;
<<copied>>
  memcpy(&<<output>>, out, sizeof <<output>>);
  model.abi ^= other_abi;
  for (k = 0; k < repeat; ++k)
    code = <<p>>_<<name>>(<<passed>>);
  memcpy(out, &<<output>>, sizeof <<output>>);
  return code;
}
