 *   static <<p>>_<<owner>> <<owner>>;
 *   static <<p>>_<<owner>>_work work;
 *   <<p>>_<<owner>>_init(&<<owner>>);             once
 *   code = <<p>>_<<step>>(&<<owner>>, &work, ...);      every period
