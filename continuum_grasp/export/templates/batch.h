#ifdef <<P>>_BATCH
/* The step for many states at once, in the vector lanes of the machine, where the library was compiled with <<P>>_BATCH
   by gcc or clang: the same bits as by <<p>>_step. Writes next and codes of every state; returns how many were refused, or
   a negative code where a pointer is null. */
long <<p>>_step_batch(const <<p>>_model *model, const <<p>>_state *states, const <<p>>_input *inputs,
                      <<if forces>>const <<p>>_forces *forces, <<end>><<p>>_real h, <<p>>_state *next, int *codes, long count);
#endif
