/* The finger, as every function takes it. */
typedef struct {
  uint32_t abi; /* set by <<p>>_init, read by every function */<<model_parameters>>
} <<p>>_model;

/* Make a model ready, with the parameters that it was made from. */
#define <<p>>_init(model) <<p>>_init_abi((model), <<P>>_ABI)
<<P>>_API int <<p>>_init_abi(<<p>>_model *model, uint32_t abi);

