  {
    <<p>>_real values[<<size>>];
    memcpy(values, &controller-><<name>>, sizeof values);
    if (!read_parameter(S, <<k>>, <<size>>, values)) {
      ssSetErrorStatus(S, "<<name>>: <<size>> numbers, or []");
      return;
    }
    memcpy(&controller-><<name>>, values, sizeof values);
  }
