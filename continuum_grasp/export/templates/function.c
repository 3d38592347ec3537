<<P>>_API static int accept_<<name>>(<<declared>>)
{
<<accept>>
  return <<P>>_OK;
}

<<P>>_API <<prototype>>
{
  <<p>>_real <<arrays>>, result[<<size>>];
  int code = <<output>> ? accept_<<name>>(<<given>>) : <<P>>_ERR_NULL;
  if (code < 0) return code;
<<body>>
  if (!all_finite(result, <<size>>)) return <<P>>_ERR_RESULT;
  write_<<struct>>(result, <<output>>);
  return code;
}
