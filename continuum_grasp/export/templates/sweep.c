/* <<text>> */
<<head>>
{<<if rows>>
  static const <<real>> rows[<<made.links>>][<<row>>] = {<<rows>>};<<end>>
  <<real>> drive[<<drive>>], <<if tip>>tip[1], tip_rate[1], <<end>><<if lags>>lagging[<<lags>>], <<end>>base[2], q[<<full>>], qd[<<full>>], rates[<<full>>];
  <<real>> spins[<<made.links>> + 1][<<spun>>], shape[<<made.links>>][<<shape>>], body[<<made.links>>][<<body>>], gain[<<made.links>>][<<gain>>];
  <<real>> start[<<start>>], end[<<end_size>>];<<if loads>>
  static const int loaded[<<loads>>] = {<<loaded>>};
  <<real>> turns[<<made.links>> + 1][2], before[2 * <<loads>>], force[<<made.links>>][<<force>>], acting[<<loads>> * <<force>>];<<end>>
  int i, k;
  <<head_call>>
  for (i = 0; i < <<made.unknowns>>; ++i) {
    q[i] = x[i];
    qd[i] = x[<<made.unknowns>> + i];
  }<<if tip>>
  q[<<made.unknowns>>] = tip[0];
  qd[<<made.unknowns>>] = tip_rate[0];<<end>>
  for (i = 0; i < <<spun>>; ++i) spins[0][i] = <<zero>>;
  for (k = 0; k < <<made.links>>; ++k) {
    <<carry_call>>
    <<outward_call>>
  }<<if loads>>
  turns[0][0] = <<one>>;
  turns[0][1] = <<zero>>;
  for (k = 0; k < <<made.links>>; ++k) <<turn_call>>
  for (k = 0; k < <<loads>>; ++k)
    for (i = 0; i < 2; ++i) before[2 * k + i] = turns[loaded[k]][i];
  <<loads_call>>
  for (k = 0; k < <<made.links>>; ++k)
    for (i = 0; i < <<force>>; ++i) force[k][i] = <<zero>>;
  for (k = 0; k < <<loads>>; ++k)
    for (i = 0; i < <<force>>; ++i) force[loaded[k]][i] = force[loaded[k]][i] + acting[k * <<force>> + i];<<end>>
  <<tip_call>>
  for (k = <<made.links>> - 1; k >= 0; --k) {
    <<inward_call>>
  }
  <<root_call>>
  for (i = 0; i < <<made.shared>>; ++i) rates[i] = start[<<section>> + i];
  for (k = 0; k < <<made.links>>; ++k) {
    <<onward_call>>
  }
  for (i = 0; i < <<made.unknowns>>; ++i) {
    xd[i] = qd[i];
    xd[<<made.unknowns>> + i] = rates[i];
  }<<if lags>><<driven_call>>
  for (i = 0; i < <<lags>>; ++i) xd[2 * <<made.unknowns>> + i] = lagging[i];<<end>>
}
