<<for name, head, unused, reads in functions|\n>>FMI<<v>>(fmi<<v>>Status, fmi<<v>><<name>>)(<<head>>)
{
<<for one in unused>>  (void)<<one>>;
<<end>><<if reads>>  if (instance && n == 0) return fmi<<v>>OK;
<<end>>  return fmi<<v>>_refused(instance, "<<name>>: this FMU has nothing of the kind");
}
<<end>>