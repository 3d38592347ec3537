 *   <<p>>_model model;
 *   <<p>>_init(&model);                     once; then change model.parameters, where there are any, as you like
 *   code = <<p>>_...(&model, ..., &output);
