/* Ranges; the greatest finite number where any will do. */
<<bounds>>

<<readers>>
<<writers>>
<<check>>
<<P>>_API static int all_finite(const <<p>>_real *numbers, int count)
{
  int k;
  for (k = 0; k < count; ++k)
    if (!<<p>>_is_finite(&numbers[k])) return 0;
  return 1;
}

<<P>>_API int <<p>>_init_abi(<<p>>_model *model, uint32_t abi)
{
  if (!model) return <<P>>_ERR_NULL;
  if (abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  model->abi = abi;<<nominal>>
  return <<P>>_OK;
}

<<functions>>
