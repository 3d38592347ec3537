"""C source of what the core calls: one function, a batch of states, or whole rollouts."""

from __future__ import annotations

import casadi as ca

from continuum_grasp.core.lanes import PRELUDE, lane_function

__all__ = ["batch_source", "function_source", "rollout_source", "rollouts_source"]

_BATCH = """
static void cg_gather(const double *from, long long stride, long long count, int size, cg_lanes *to)
{
  for (int l = 0; l < CG_LANES; ++l) {
    const double *row = from + (l < count ? l : count - 1) * stride;
    for (int j = 0; j < size; ++j) to[j][l] = row[j];
  }
}
static void cg_scatter(const cg_lanes *from, long long stride, long long count, int size, double *to)
{
  for (long long l = 0; l < count; ++l)
    for (int j = 0; j < size; ++j) to[l * stride + j] = from[j][l];
}
"""


def function_source(function: ca.Function) -> str:
    """CasADi's C of a function; its symbol is the function's name."""
    options = {"with_header": False, "with_export": False, "static_aux": True, "with_mem": False}
    generator = ca.CodeGenerator(f"{function.name()}.c", options)
    generator.add(function)
    return str(generator.dump())


def batch_source(function: ca.Function) -> str:
    """C of ``NAME_batch(count, in, stride, out)`` over rows; a stride of zero repeats one row."""
    name, sizes = function.name(), [function.nnz_in(i) for i in range(function.n_in())]
    outputs = [function.nnz_out(i) for i in range(function.n_out())]
    inputs = "\n".join(f"  cg_lanes i{k}[{max(size, 1)}];" for k, size in enumerate(sizes))
    results = "\n".join(f"  cg_lanes o{k}[{max(size, 1)}];" for k, size in enumerate(outputs))
    gather = "\n".join(
        f"    cg_gather(in[{k}] + b * stride[{k}], stride[{k}], m, {size}, i{k});"
        for k, size in enumerate(sizes)
        if size
    )
    scatter = "\n".join(
        f"    cg_scatter(o{k}, {size}, m, {size}, out[{k}] + b * {size});" for k, size in enumerate(outputs) if size
    )
    return f"""#include <math.h>
{PRELUDE}{_BATCH}
{lane_function(function)}
int {name}_batch(long long count, const double *const *in, const long long *stride, double *const *out)
{{
{inputs}
{results}
  const cg_lanes *const vi[] = {{{", ".join(f"i{k}" for k in range(len(sizes)))}}};
  cg_lanes *const vo[] = {{{", ".join(f"o{k}" for k in range(len(outputs)))}}};
  for (long long b = 0; b < count; b += CG_LANES) {{
    const long long m = count - b < CG_LANES ? count - b : CG_LANES;
{gather}
    {name}_lanes(vi, vo);
{scatter}
  }}
  return 0;
}}
"""


def rollout_source(step: ca.Function) -> str:
    """C of ``NAME_rollout``: many steps in one call.

    ``step`` has inputs x, u and w at the start, the middle and the end of the step, p and h, and the next x as output.
    Inputs are rows at half steps (a stride of zero repeats one row). Every ``sub``-th state is kept. The result is the
    number of kept states after the first; fewer than asked for mean that the next one is not finite.
    """
    nx = step.nnz_in(0)
    return f"""{function_source(step)}
long long {step.name()}_rollout(long long keep, long long sub, double h, const double *x0,
    const double *u, long long us, const double *w, long long ws, const double *p,
    long long *iw, double *work, double *X)
{{
  double x[{nx}], next[{nx}];
  const double *arg[{step.sz_arg()}];
  double *res[{step.sz_res()}];
  for (int j = 0; j < {nx}; ++j) X[j] = x[j] = x0[j];
  for (long long k = 0; k < keep; ++k) {{
    for (long long i = 0; i < sub; ++i) {{
      arg[0] = x;
      arg[1] = u; arg[2] = u + us; arg[3] = u + 2 * us;
      arg[4] = w; arg[5] = w + ws; arg[6] = w + 2 * ws;
      arg[7] = p; arg[8] = &h;
      res[0] = next;
      if ({step.name()}(arg, res, iw, work, 0)) return k;
      for (int j = 0; j < {nx}; ++j) x[j] = next[j];
      u += 2 * us;
      w += 2 * ws;
    }}
    for (int j = 0; j < {nx}; ++j) if (!(x[j] - x[j] == 0.0)) return k;
    for (int j = 0; j < {nx}; ++j) X[(k + 1) * {nx} + j] = x[j];
  }}
  return keep;
}}
"""


def rollouts_source(step: ca.Function) -> str:
    """C of ``NAME_rollouts``: many rollouts in one call, in vector lanes where the step is a straight-line function.

    As ``rollout_source``, with a stride per rollout (``ur``, ``wr``) beside that per half step; ``kept`` receives the
    result of each.
    """
    nx, nu, nw, n_p = (step.nnz_in(k) for k in (0, 1, 4, 7))
    name = step.name()
    head = f"""
void {name}_rollouts(long long count, long long keep, long long sub, double h, const double *x0,
    const double *u, long long us, long long ur, const double *w, long long ws, long long wr, const double *p,
    long long *iw, double *work, double *X, long long *kept)
{{"""
    if not step.is_a("SXFunction"):
        return f"""{rollout_source(step)}{head}
  for (long long r = 0; r < count; ++r)
    kept[r] = {name}_rollout(keep, sub, h, x0 + r * {nx}, u + r * ur, us, w + r * wr, ws, p, iw, work,
        X + r * (keep + 1) * {nx});
}}
"""
    return f"""#include <math.h>
{PRELUDE}{_BATCH}
{lane_function(step)}{head}
  cg_lanes x[{nx}], next[{nx}], vp[{max(n_p, 1)}], vh[1], vu[3][{max(nu, 1)}], vw[3][{max(nw, 1)}];
  const cg_lanes *const in[] = {{x, vu[0], vu[1], vu[2], vw[0], vw[1], vw[2], vp, vh}};
  cg_lanes *const out[] = {{next}};
  const long long row = (keep + 1) * {nx};
  (void)iw; (void)work; (void)u; (void)us; (void)ur; (void)w; (void)ws; (void)wr; (void)p;
  cg_gather(p, 0, 1, {n_p}, vp);
  cg_gather(&h, 0, 1, 1, vh);
  for (long long b = 0; b < count; b += CG_LANES) {{
    const long long m = count - b < CG_LANES ? count - b : CG_LANES;
    cg_gather(x0 + b * {nx}, {nx}, m, {nx}, x);
    cg_scatter(x, row, m, {nx}, X + b * row);
    for (long long l = 0; l < m; ++l) kept[b + l] = keep;
    for (long long k = 0, t = 0; k < keep; ++k) {{
      for (long long i = 0; i < sub; ++i, t += 2) {{
        for (int a = 0; a < 3; ++a) {{
          if (us || !t) cg_gather(u + b * ur + (t + a) * us, ur, m, {nu}, vu[a]);
          if (ws || !t) cg_gather(w + b * wr + (t + a) * ws, wr, m, {nw}, vw[a]);
        }}
        {name}_lanes(in, out);
        for (int j = 0; j < {nx}; ++j) x[j] = next[j];
      }}
      cg_scatter(x, row, m, {nx}, X + b * row + (k + 1) * {nx});
      for (long long l = 0; l < m; ++l)
        for (int j = 0; j < {nx}; ++j)
          if (kept[b + l] == keep && !(x[j][l] - x[j][l] == 0.0)) kept[b + l] = k;
    }}
  }}
}}
"""
