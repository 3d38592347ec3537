"""C source of what the core calls: one function, a batch of states, or whole rollouts."""

from __future__ import annotations

import casadi as ca

from continuum_grasp.core.lanes import PRELUDE, lane_function

__all__ = ["batch_source", "function_source", "rollout_source"]

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
