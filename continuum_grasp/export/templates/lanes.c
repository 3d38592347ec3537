<<for name, is_pair, text in functions>>static lanes each_<<name>>(lanes a<<if is_pair>>, lanes b<<end>>)
{
  int k;
  for (k = 0; k < LANES; ++k) a[k] = <<text>>;
  return a;
}

<<end>>