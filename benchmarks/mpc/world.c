/* A period of the plant of world.py, whose generated function `world` stands above. */
void advance(double *z, const double *u, const double *p, double *y)
{
  static long long int iw[SZ_IW + 1];
  static double w[SZ_W + 1], next[NZ + 1];
  const double *arg[SZ_ARG + 1] = {z, u, p};
  double *res[SZ_RES + 1] = {next, y};
  world(arg, res, iw, w, 0);
  for (int i = 0; i < NZ; ++i) z[i] = next[i];
}
