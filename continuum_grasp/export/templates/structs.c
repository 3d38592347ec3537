<<for struct in read>><<P>>_API static void <<struct.name>>_read(const <<p>>_<<struct.name>> *from, <<p>>_real *to)
{
<<for k, place in struct.numbered>>  to[<<k>>] = from-><<place>>;
<<end>>}

<<end>><<for struct in written>><<P>>_API static void <<struct.name>>_written(const <<p>>_real *from, <<p>>_<<struct.name>> *to)
{
<<for k, place in struct.numbered>>  to-><<place>> = from[<<k>>];
<<end>>}

<<end>>