/* Whether what several numbers set together, which is none of them, is out of its range. */
<<P>>_API static int left_range(<<for name in subject.guard.inputs|, >>const <<p>>_real *<<name>><<end>>)
{
  <<p>>_real use[1];
  <<p>>_kernel_<<subject.guard.name>>(<<for name in subject.guard.inputs|, >><<name>><<end>>, use);
  return !<<p>>_is_finite(use) || use[0] < -1 || use[0] > 1;
}
