static int <<name>>(const real *const arg[], real *const res[])
{
<<if adapter.unused>>  real unused[<<adapter.unused>>];
<<end>><<if adapter.states>>  real x[<<adapter.states>>] = {0};
  for (int j = 0; j < <<adapter.common>>; ++j) x[j] = arg[0][j];
<<end>><<if behind>>  real *behind = 0;
  if (res[1]) behind = res[1] + <<adapter.behind>>;
<<end>><<if adapter.kernel>><<if not adapter.kernel.inputs>>  (void)arg;
<<end>>  <<call>>
<<else>>  (void)arg; (void)res;
<<end>>  return 0;
}
