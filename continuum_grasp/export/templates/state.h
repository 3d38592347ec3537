/* A straight finger at rest, and the object where the scene has it. */
#define <<p>>_state_init(state) <<p>>_state_init_abi((state), <<P>>_ABI)
<<P>>_API int <<p>>_state_init_abi(<<p>>_state *state, uint32_t abi);
