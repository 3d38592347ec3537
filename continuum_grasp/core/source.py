"""C source of what the core calls: one function, a batch of states, or whole rollouts.

All of it takes and gives doubles; ``real`` is what it computes in.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

from continuum_grasp.core.lanes import lane_function, lane_prelude
from continuum_grasp.core.precision import single

_BATCH = """
static void cg_gather(const double *from, long long stride, long long count, int size, cg_lanes *to)
{
  for (int l = 0; l < CG_LANES; ++l) {
    const double *row = from + (l < count ? l : count - 1) * stride;
    for (int j = 0; j < size; ++j) to[j][l] = (cg_real)row[j];
  }
}
static void cg_scatter(const cg_lanes *from, long long stride, long long count, int size, double *to)
{
  for (long long l = 0; l < count; ++l)
    for (int j = 0; j < size; ++j) to[l * stride + j] = (double)from[j][l];
}
"""

_DOUBLE_INPUTS = """
      arg[1] = u; arg[2] = u + us; arg[3] = u + 2 * us;
      arg[4] = w; arg[5] = w + ws; arg[6] = w + 2 * ws;
      arg[7] = p; arg[8] = &h;"""
_FLOAT_INPUTS = """
      for (int a = 0; a < 3; ++a) {{
        for (int j = 0; j < {nu}; ++j) vu[a][j] = (float)u[a * us + j];
        for (int j = 0; j < {nw}; ++j) vw[a][j] = (float)w[a * ws + j];
        arg[1 + a] = vu[a]; arg[4 + a] = vw[a];
      }}
      arg[7] = vp; arg[8] = &vh;"""


def entry(function: ca.Function, real: str) -> str:
    """Symbol by which a function is called on doubles."""
    return str(function.name()) + ("" if real == "double" else "_on_doubles")


def function_source(function: ca.Function, real: str = "double") -> str:
    """CasADi's C of a function, with its own arguments; its symbol is given by ``entry``."""
    if real == "double":
        return generated(function.name(), function)
    sizes_in, sizes_out = ([size(k) for k in range(count)] for size, count in _interface(function))
    declared = "\n".join(
        f"  float {letter}{k}[{max(size, 1)}];"
        for letter, sizes in (("i", sizes_in), ("o", sizes_out))
        for k, size in enumerate(sizes)
    )
    narrow = "\n".join(
        f"  for (int j = 0; j < {size}; ++j) i{k}[j] = (float)from[{k}][j];" for k, size in enumerate(sizes_in) if size
    )
    widen = "\n".join(
        f"  for (int j = 0; j < {size}; ++j) to[{k}][j] = (double)o{k}[j];" for k, size in enumerate(sizes_out) if size
    )
    return f"""{single(generated(function.name(), function))}
int {entry(function, real)}(const double **from, double **to, long long *iw, double *work, int mem)
{{
{declared}
  const float *arg[{function.sz_arg()}] = {{{", ".join(f"i{k}" for k in range(len(sizes_in)))}}};
  float *res[{function.sz_res()}] = {{{", ".join(f"o{k}" for k in range(len(sizes_out)))}}};
{narrow}
  const int failed = {function.name()}(arg, res, iw, (float *)work, mem);
{widen}
  return failed;
}}
"""


def _interface(function: ca.Function) -> tuple[tuple[Callable[[int], int], int], ...]:
    return (function.nnz_in, function.n_in()), (function.nnz_out, function.n_out())


def generated(name: str, *functions: ca.Function) -> str:
    """CasADi's C of functions, which are its symbols; ``name`` stands before those of its own help functions."""
    options = {"with_header": False, "with_export": False, "static_aux": True, "with_mem": False}
    generator = ca.CodeGenerator(f"{name}.c", options)
    for function in functions:
        generator.add(function)
    return str(generator.dump())


def batch_source(function: ca.Function, real: str = "double") -> str:
    """C of ``NAME_batch(count, in, stride, out)`` over rows; a stride of zero repeats one row."""
    name, sizes = function.name(), [function.nnz_in(i) for i in range(function.n_in())]
    outputs = [function.nnz_out(i) for i in range(function.n_out())]
    inputs = "\n".join(f"  cg_lanes i{k}[{max(size, 1)}];" for k, size in enumerate(sizes))
    results = "\n".join(f"  cg_lanes o{k}[{max(size, 1)}];" for k, size in enumerate(outputs))
    gather = "\n".join(
        f"    if (!b || stride[{k}]) cg_gather(in[{k}] + b * stride[{k}], stride[{k}], m, {size}, i{k});"
        for k, size in enumerate(sizes)
        if size
    )
    scatter = "\n".join(
        f"    cg_scatter(o{k}, {size}, m, {size}, out[{k}] + b * {size});" for k, size in enumerate(outputs) if size
    )
    return f"""{lane_prelude(real)}{_BATCH}
{lane_function(function, real)}
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


def rollout_source(step: ca.Function, real: str = "double") -> str:
    """C of ``NAME_rollout``: many steps in one call.

    ``step`` has inputs x, u and w at the start, the middle and the end of the step, p and h, and the next x as output.
    Inputs are rows at half steps (a stride of zero repeats one row). Every ``sub``-th state is stored. The result is
    the number of stored states after the first; fewer than requested: the next one is not finite. The state stays in
    ``real`` from step to step. ``NAME_levels`` does the same with steps of several lengths: ``ratio`` times h, the
    longer ones stored at every ``every``-th instant only.
    """
    nx, nu, nw, n_p = (step.nnz_in(k) for k in (0, 1, 4, 7))
    code, before, inputs = generated(step.name(), step), "", _DOUBLE_INPUTS
    if real == "float":
        code, inputs = single(code), _FLOAT_INPUTS
        before = f"""
  float vu[3][{max(nu, 1)}], vw[3][{max(nw, 1)}], vp[{max(n_p, 1)}];
  const float vh = (float)h;
  for (int j = 0; j < {n_p}; ++j) vp[j] = (float)p[j];"""
    return f"""{code}
long long {step.name()}_rollout(long long keep, long long sub, double h, const double *x0,
    const double *u, long long us, const double *w, long long ws, const double *p,
    long long *iw, double *work, double *X)
{{
  {real} x[{nx}], next[{nx}];
  const {real} *arg[{step.sz_arg()}];
  {real} *res[{step.sz_res()}];{before}
  for (int j = 0; j < {nx}; ++j) X[j] = (double)(x[j] = ({real})x0[j]);
  for (long long k = 0; k < keep; ++k) {{
    for (long long i = 0; i < sub; ++i) {{
      arg[0] = x;{inputs.format(nu=nu, nw=nw)}
      res[0] = next;
      if ({step.name()}(arg, res, iw, ({real} *)work, 0)) return k;
      for (int j = 0; j < {nx}; ++j) x[j] = next[j];
      u += 2 * us;
      w += 2 * ws;
    }}
    for (int j = 0; j < {nx}; ++j) if (!(x[j] - x[j] == 0)) return k;
    for (int j = 0; j < {nx}; ++j) X[(k + 1) * {nx} + j] = (double)x[j];
  }}
  return keep;
}}
void {step.name()}_levels(long long levels, const long long *ratio, long long every, long long keep, long long sub,
    double h, const double *x0, const double *u, long long us, const double *w, long long ws, const double *p,
    long long *iw, double *work, double *const *X, long long *valid)
{{
  for (long long l = 0; l < levels; ++l) {{
    const long long r = ratio[l], e = r == 1 ? 1 : every;
    valid[l] = {step.name()}_rollout(keep / e, sub * e / r, h * (double)r, x0 + l * {nx}, u, us * r, w, ws * r, p,
        iw, work, X[l]);
  }}
}}
"""


def rollouts_source(step: ca.Function, real: str = "double") -> str:
    """C of ``NAME_rollouts``: many rollouts in one call, in vector lanes where the step is a straight-line function.

    As ``rollout_source``, with a stride per rollout (``ur``, ``wr``) beside that per half step; ``valid`` receives the
    result of each.
    """
    nx, nu, nw, n_p = (step.nnz_in(k) for k in (0, 1, 4, 7))
    name = step.name()
    head = f"""
void {name}_rollouts(long long count, long long keep, long long sub, double h, const double *x0,
    const double *u, long long us, long long ur, const double *w, long long ws, long long wr, const double *p,
    long long *iw, double *work, double *X, long long *valid)
{{"""
    if not step.is_a("SXFunction"):
        return f"""{rollout_source(step, real)}{head}
  for (long long r = 0; r < count; ++r)
    valid[r] = {name}_rollout(keep, sub, h, x0 + r * {nx}, u + r * ur, us, w + r * wr, ws, p, iw, work,
        X + r * (keep + 1) * {nx});
}}
"""
    return f"""{lane_prelude(real)}{_BATCH}
{lane_function(step, real)}{head}
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
    for (long long l = 0; l < m; ++l) valid[b + l] = keep;
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
          if (valid[b + l] == keep && !(x[j][l] - x[j][l] == 0)) valid[b + l] = k;
    }}
  }}
}}
"""
