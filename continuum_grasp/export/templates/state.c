<<P>>_API int <<p>>_state_init_abi(<<p>>_state *state, uint32_t abi)
{
  static const <<p>>_real start[] = {<<start>>};
  if (!state) return <<P>>_ERR_NULL;
  if (abi != <<P>>_ABI) return <<P>>_ERR_ABI;
  state_written(start, state);
  return <<P>>_OK;
}
