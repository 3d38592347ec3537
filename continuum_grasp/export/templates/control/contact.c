static void write_felt(const <<p>>_contact_report *from, <<p>>_contact *to)
{
  to->verdict = (<<p>>_real)from->verdict;
<<for field in loop.touch.fields>><<if field.shape>>  memcpy(to-><<field.name>>, from-><<field.name>>, sizeof to-><<field.name>>);
<<end>><<end>>}
