<<P>>_API static int <<call.name>>_accepted(<<declared>>)
{
<<if checks>>  int code;
<<end>>  if (<<for name in pointers| || >>!<<name>><<end>>) return <<P>>_ERR_NULL;
  if (model->abi != <<P>>_ABI) return <<P>>_ERR_ABI;
<<for a in arrays>>  <<a.kind.name>>_read(<<if a.is_member>>&model-><<end>><<a.name>>, <<a.array>>);
<<if a.drawn>>  if (!all_finite(<<a.array>>, <<a.size>>)) return <<P>>_ERR_NON_FINITE;
<<else>>  if ((code = check(<<a.array>>, <<a.kind.name>>_low, <<a.kind.name>>_high, <<a.size>>)) < 0) return code;
<<end>><<end>><<for a, low, high in numbers>>  if (!<<p>>_is_finite(&<<a.array>>)) return <<P>>_ERR_NON_FINITE;
  if (<<a.array>> < <<low>> || <<a.array>> > <<high>>) return <<P>>_<<a.code.name>>;
<<end>><<call.guard>>  return <<P>>_OK;
}

<<P>>_API <<prototype>>
{
  <<p>>_real <<for a in arrays|, >><<a.array>>[<<a.size>>]<<end>>, result[<<call.output.size>>];
  int code = <<call.output.name>> ? <<call.name>>_accepted(model, <<for a in call.inputs|, >><<a.name>><<end>>, <<for a in arrays|, >><<a.array>><<end>>) : <<P>>_ERR_NULL;
  if (code < 0) return code;
<<body>>
  if (!all_finite(result, <<call.output.size>>)) return <<P>>_ERR_RESULT;
  <<call.output.kind.name>>_written(result, <<call.output.name>>);
  return code;
}
