"""C source of a real-time iteration: functions of the stages and the templates around them, in one translation unit."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from importlib.resources import files
from itertools import product
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array, InputError
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.core import (
    CSource,
    straight_function,
)

TOLERANCE = {"double": 1e-8, "float": 1e-4}
"""Relative tolerance of the QP's solution [1]: about the square root of the machine epsilon in double; in single
precision a thousand times the epsilon, since gradients are sums of some hundred rounded terms."""
_REGULARIZATION = 3.6e-6
"""Added to the Hessian of an input that crosses its whole range [cost]: keeps Riccati pivots positive where an input
has no effect, and is 5e-7 or less of the weights of all shipped loops."""

Pattern = NDArray[np.bool_]

_ITERATION = ("rti_linearize.c", "rti_riccati.c", "rti_active_set.c", "rti_interior_point.c", "rti.c", "rti_search.c")
"""Templates after the basis and the functions generated for a problem, in their order."""


def regularization(low: Array, high: Array) -> Array:
    """Entries that are added to the inputs' Hessian [cost per input squared], by their limits (nu)."""
    wide = high - low
    # One that cannot move needs no size.
    return np.where(wide > 0.0, _REGULARIZATION / np.square(np.where(wide > 0.0, wide, 1.0)), 1.0)


class SharedSlope(NamedTuple):
    """One function of the rate of stages and filter with the derivatives of both, by names of inputs and outputs.

    The stages ask for all but the last, by the disturbances of the filter.
    """

    given: dict[str, ca.SX]
    found: dict[str, ca.SX]

    @staticmethod
    def of(stage: ca.Function | None, filtered: ca.Function | None) -> SharedSlope | None:
        """Return the slopes by state and input, and by state and disturbances; None if they do not agree."""
        if stage is None or filtered is None:
            return None
        n = stage.size1_out(0)
        s = {name: ca.SX.sym(name, filtered.size1_in(k)) for k, name in enumerate(filtered.name_in())}
        rest = ca.SX(stage.size1_in(0) - n, 1)
        rate, of_stage = stage.call([ca.vertcat(s["z"][:n], rest), s["u"], s["p"]])
        of_filter = filtered.call([*s.values()])[1]
        by_x = of_stage[:, :n]
        if by_x.sparsity() != of_filter[:, :n].sparsity():
            return None
        return SharedSlope(s, {"rate": rate, "by_x": by_x, "by_u": of_stage[:, n:], "by_d": of_filter[:, n:]})

    def lanes(self, stage: str, filtered: str, real: str) -> dict[str, str]:
        """Return C in vector lanes for both functions, by their names; the first one includes the called functions."""
        (kernel,) = CSource([straight_function("slope", self.given, self.found)], real).lane_bodies()
        by_x, by_u = (self.found[name].nnz() for name in ("by_x", "by_u"))
        behind = f"out[1] ? out[1] + {by_x} : 0"
        arguments = "(const cg_lanes *const in[], cg_lanes *const out[])"
        text = "static void {}_lanes{}\n{{\n{}  slope_lanes(given, found);\n}}\n"
        of_stage = (
            "  const cg_lanes *const given[] = {in[0], in[1], in[2], in[2]};\n"
            f"  cg_lanes *const found[] = {{out[0], out[1], {behind}, 0}};\n"
        )
        of_filter = (
            f"  cg_lanes unused[{max(by_u, 1)}];\n"
            f"  cg_lanes *const found[] = {{out[0], out[1], unused, {behind}}};\n"
            "  const cg_lanes *const *given = in;\n"
        )
        return {
            stage: kernel + text.format(stage, arguments, of_stage),
            filtered: text.format(filtered, arguments, of_filter),
        }


def iteration_source(
    stages: Stages, *, real: str = "double", lanes: bool = True, filtered: ca.Function | None = None
) -> str:
    """Write the C of the real-time iterations of a problem, in double or float, as one translation unit.

    ``filtered`` is a step of a filter of the same motion, which has vector lanes with a slope in common where that is
    possible, behind ``EKF_VECTOR``.

    With ``lanes``, stages are linearized side by side in vector lanes (gcc and clang), with the same result to
    rounding; models with an operation that vector lanes do not have are linearized stage by stage. ``InputError`` where
    a stage function is not a straight-line SX function of the expected sizes, or has a constant that single precision
    cannot hold.
    """
    _check(stages)
    stage_functions = [stages.step, stages.cost, stages.terminal]
    source = CSource(stage_functions, real)
    vector = source.lanes() if lanes else ""
    shared = ""
    if vector and filtered is not None:
        slopes = {f.name(): f for f in CSource([stages.step, filtered]).straight}
        shared_slope = SharedSlope.of(slopes.get("stage_slope"), slopes.get("estimator_slope"))
        if shared_slope is not None:
            written = shared_slope.lanes("stage_slope", "estimator_slope", real)
            shared = CSource([*stage_functions, filtered], real).lanes(written)
    functions = _in_one_lane(stages.terminal) if vector else source.plain("stages")
    # Rows are padded to four numbers, which fill a vector register of 32 bytes in double.
    width = f"#define RTI_W {-(-(stages.nx + stages.nu) // 4) * 4}" if lanes else ""
    parts = [
        *dimensions(stages, real),
        f"typedef {real} real;\n",
        width,
        shared or vector,
        functions,
        "#define RTI_VECTOR" if vector else "",
        "#define EKF_VECTOR" if shared else "",
        template("rti.h"),
    ]
    return "\n".join([*parts, *iteration_bodies(stages, lanes=lanes)])


def _in_one_lane(function: ca.Function) -> str:
    """Write a function of numbers that calls the function of lanes, so that rare functions need no scalar code."""
    inputs = [(k, max(function.nnz_in(k), 1), function.nnz_in(k)) for k in range(function.n_in())]
    outputs = [(k, max(function.nnz_out(k), 1), function.nnz_out(k)) for k in range(function.n_out())]
    lines = [f"static int {function.name()}(const real *const arg[], real *const res[])", "{"]
    lines += [f"  cg_lanes i{k}[{least}];" for k, least, _ in inputs] + [
        f"  cg_lanes o{k}[{n}];" for k, n, _ in outputs
    ]
    lines += [f"  for (int j = 0; j < {n}; ++j) i{k}[j] = (cg_lanes){{0}} + arg[{k}][j];" for k, _, n in inputs if n]
    lines.append(f"  const cg_lanes *const in[] = {{{', '.join(f'i{k}' for k, *_ in inputs)}}};")
    lines.append(f"  cg_lanes *const out[] = {{{', '.join(f'o{k}' for k, *_ in outputs)}}};")
    lines.append(f"  {function.name()}_lanes(in, out);")
    lines += [f"  for (int j = 0; j < {n}; ++j) res[{k}][j] = o{k}[j][0];" for k, _, n in outputs if n]
    return "\n".join([*lines, "  return 0;", "}", ""])


def iteration_bodies(stages: Stages, *, lanes: bool) -> list[str]:
    """Write the C after the header."""
    bodies = [_row_functions(stages), _stores(stages), _vector_products(stages, lanes)]
    bodies.append(row_products(stages) if lanes else jacobian_products(stages))
    return [template("rti_basis.c"), *bodies, *(template(name) for name in _ITERATION)]


def scenario_settings(stages: Stages) -> dict[str, NDArray[np.float64]]:
    """Members of ``rti_settings`` that scenarios have, in its order."""
    if stages.scenarios is None:
        return {}
    weights, scale, shift = stages.scenarios
    # An array without entries has one in C, which has no arrays of length zero.
    none = np.zeros((stages.plants, 1)) if not stages.np else None
    return {"share": weights, "scale": scale if none is None else none, "shift": shift if none is None else none}


def template(name: str) -> str:
    """Read a C template of this package."""
    return (files("continuum_grasp.control") / "c" / name).read_text(encoding="utf-8")


def dimensions(stages: Stages, real: str) -> list[str]:
    """Write the macros of the dimensions, for C that computes in ``real``."""
    sizes = {"N": stages.stages, "NX": stages.nx, "NU": stages.nu, "NC": stages.nc, "NS": stages.ns}
    sizes |= {"NP": stages.np, "NR": stages.nr}
    lines = [f"#define RTI_{name} {size}" for name, size in sizes.items()]
    if stages.scenarios is not None:
        lines += ["#define RTI_ROBUST", f"#define RTI_SCENARIOS {stages.plants}"]
    if stages.checks_gaps:
        lines.append("#define RTI_CHECKS_GAPS")
    if real == "float":
        lines.append("#define RTI_SINGLE")
    return lines


def _check(stages: Stages) -> None:
    """Refuse functions that are not as the template calls them: each output dense and of its size."""
    nx, nu, nc, ns = stages.nx, stages.nu, stages.nc, stages.ns
    nz = nx + nu
    sizes = {
        stages.step: [nx, nx * nx, nx * nu],
        stages.cost: [1, nz, nz * nz, nc, nc * nz],
        stages.terminal: [1, nx, nx * nx, ns, ns * nx],
    }
    for function, expected in sizes.items():
        counts = [function.nnz_out(k) for k in range(function.n_out())]
        if counts != expected:
            raise InputError(f"{function.name()}: expected dense outputs of {expected} entries, got {counts}")


def _nonzeros(function: ca.Function, output: int) -> Pattern:
    """Structural nonzeros of an output."""
    return _patterns(function)[output].copy()


@lru_cache(maxsize=3)  # the functions of stages: each is asked for again and again, and calling one takes 30 ms
def _patterns(function: ca.Function) -> list[Pattern]:
    """Structural nonzeros of the outputs."""
    symbols = [ca.SX.sym(name, function.size1_in(k)) for k, name in enumerate(function.name_in())]
    patterns = list[Pattern]()
    for value in function.call(symbols):
        sparsity = ca.sparsify(value).sparsity()
        pattern = np.zeros(sparsity.shape, dtype=bool)
        pattern[tuple(np.array(sparsity.get_triplet(), dtype=int))] = True
        patterns.append(pattern)
    return patterns


def _row_functions(stages: Stages) -> str:
    """Write the products with the rows' Jacobian C over its structural nonzeros, at a stage or at the last node."""
    pattern = _nonzeros(stages.cost, 4)
    pattern[: stages.ns, : stages.nx] |= _nonzeros(stages.terminal, 4)
    entries = [np.flatnonzero(row) for row in pattern]
    values = [
        f"  y[{i}] = c[{i}]" + "".join(f" + C[{i}][{j}] * z[{j}]" for j in row) + ";" for i, row in enumerate(entries)
    ]
    gradient = [f"  q[{j}] += C[{i}][{j}] * w[{i}];" for i, row in enumerate(entries) for j in row]
    hessian = []
    for i, row in enumerate(entries):
        for j in row:
            hessian.append(f"  {{ const real a = C[{i}][{j}] * w[{i}];")
            hessian += [f"    G[{j}][{k}] += a * C[{i}][{k}];" for k in row if k <= j]
            hessian.append("  }")
    rows = max(stages.nc, 1)
    return _inline(
        (
            f"row_values(const real c[{rows}], real (*C)[RTI_NZ], const real z[RTI_W], real y[{rows}])",
            "c C z y",
            values,
        ),
        (f"row_gradient(real (*C)[RTI_NZ], const real w[{rows}], real q[RTI_W])", "C w q", gradient),
        (f"row_hessian(real (*C)[RTI_NZ], const real w[{rows}], real (*G)[RTI_W])", "C w G", hessian),
    )


def _inline(*functions: tuple[str, str, list[str]]) -> str:
    """Write inline functions by head, arguments and body, which need not read all of them."""
    lines: list[str] = []
    for head, arguments, body in functions:
        # Compilers warn of arguments that nothing reads.
        unused = " ".join(f"(void){name};" for name in arguments.split())
        lines += [f"static inline void rti_{head}", "{", f"  {unused}", *body, "}"]
    return "\n".join([*lines, ""])


def _stores(stages: Stages) -> str:
    """Write ``rti_store_step`` and ``rti_store_cost``: copies of the structural nonzeros of a stage out of its lane."""
    step = [f"  o->M[at][{i}][{j}] = RTI_AT(M[{j}][{i}], l);" for i, j in np.argwhere(_reached(stages))]
    node = "at" if stages.scenarios is None else "rti_node(at)"
    cost = [f"  o->H[{node}][{i}][{j}] = RTI_AT(H[{i}][{j}], l);" for i, j in np.argwhere(_nonzeros(stages.cost, 2))]
    cost += [f"  o->C[{node}][{i}][{j}] = RTI_AT(C[{j}][{i}], l);" for i, j in np.argwhere(_nonzeros(stages.cost, 4))]
    by_cost = "rti_wide (*H)[RTI_NZ], rti_wide (*C)[RTI_SIZE(RTI_NC)]"
    return _inline(
        ("store_step(rti_work *o, int at, int l, rti_wide (*M)[RTI_NX])", "o l M at", step),
        (f"store_cost(rti_work *o, int at, int l, {by_cost})", "o l H C at", cost),
    )


def _vector_products(stages: Stages, lanes: bool) -> str:
    """Write q += H z, q += M' p and next += M z over structural nonzeros, in vector lanes by blocks that have some."""
    hessian = _nonzeros(stages.cost, 2)
    reached = _reached(stages)
    hessian[: stages.nx, : stages.nx] |= _nonzeros(stages.terminal, 2)

    def rows(matrix: str, pattern: Pattern, by: str) -> list[str]:
        if not lanes:
            return [f"  q[{j}] += {by}[{i}] * {matrix}[{i}][{j}];" for i, j in np.argwhere(pattern)]
        lines = [_BLOCK_TYPE]
        for b, used in enumerate(_blocks(pattern).T):
            terms = [f"{by}[{i}] * {_taken(f'{matrix}[{i}]', b)}" for i in np.flatnonzero(used)]
            lines += [f"  *(block *)(q + {b * _BLOCK}) += {' + '.join(terms)};"] if terms else []
        return lines

    sums = [
        f"  next[{i}] += " + " + ".join(f"M[{i}][{j}] * z[{j}]" for j in np.flatnonzero(row)) + ";"
        for i, row in enumerate(reached)
        if row.any()
    ]
    return _inline(
        ("add_hessian(real q[RTI_W], real (*H)[RTI_W], const real z[RTI_W])", "q H z", rows("H", hessian, "z")),
        ("add_transposed(real q[RTI_W], real (*M)[RTI_W], const real p[RTI_NX])", "q M p", rows("M", reached, "p")),
        ("following(real next[RTI_W], real (*M)[RTI_W], const real z[RTI_W])", "M z", sums),
    )


_BLOCK = 4
"""Numbers of a row that are taken together [1], as ``RTI_W`` is padded."""
_BLOCK_TYPE = (
    f"  typedef real block __attribute__((vector_size({_BLOCK} * sizeof(real)), aligned(sizeof(real)), may_alias));"
)


def _blocks(pattern: Pattern) -> Pattern:
    """Whether the blocks of each row have an entry."""
    padded = np.pad(pattern, ((0, 0), (0, -pattern.shape[1] % _BLOCK)))
    found: Pattern = np.stack([padded[:, k::_BLOCK] for k in range(_BLOCK)]).max(axis=0)
    return found


def _taken(row: str, block: int) -> str:
    return f"*(const block *)({row} + {block * _BLOCK})"


_MOST = 1500
"""Multiplications of a product [1] beyond which loops are used: unrolled, they would take over 10 kB."""


def jacobian_products(stages: Stages) -> str:
    """Write ``rti_chain_rule`` and ``rti_congruence`` if they are short; otherwise the templates have loops.

    Not for vector lanes, where loops over whole rows are faster.
    """
    rate, driven = (_nonzeros(stages.step, output) for output in (1, 2))
    reached = _reached(stages)
    hessian = _nonzeros(stages.cost, 2)
    inputs = range(stages.nx, stages.nx + stages.nu)
    hessian[inputs, inputs] = True  # by the regularization
    return _chain(rate, driven, reached) + _carry(reached, hessian)


def row_products(stages: Stages) -> str:
    """Write ``rti_congruence`` for vector lanes: by blocks of rows, without those that are structurally zero.

    The template's loops over whole rows take four times as long for rows of 16 numbers (gcc 12 unrolls them before it
    vectorizes), and twice as long for drives, whose states follow from few others.
    """
    reached = _reached(stages)
    used = _blocks(reached)
    nx, blocks = used.shape
    # Only the lower triangle; sums of whole rows continue beyond it.
    lower = {(j, b) for j, column in enumerate(reached.T) for b in range(j // _BLOCK + 1) if column.any()}
    lines = [_BLOCK_TYPE]
    lines += [f"  block g{j}_{b} = {_taken(f'H[{j}]', b)};" for j, b in sorted(lower)]
    for i in range(nx):
        lines.append("  {")
        for b in range(blocks):
            terms = [f"P[{max(i, q)}][{min(i, q)}] * {_taken(f'M[{q}]', b)}" for q in np.flatnonzero(used[:, b])]
            lines.append(f"    const block m{b} = {' + '.join(terms) or '{0}'};")
        lines += [f"    g{j}_{b} += M[{i}][{j}] * m{b};" for j, b in sorted(lower) if reached[i, j]]
        lines.append("  }")
    for j, b in product(range(reached.shape[1]), range(blocks)):
        value = f"g{j}_{b}" if (j, b) in lower else _taken(f"H[{j}]", b)
        lines.append(f"  *(block *)(G[{j}] + {b * _BLOCK}) = {value};")
    return _function("RTI_UNROLLED_CONGRUENCE", _CONGRUENCE, "", lines)


_CONGRUENCE = (
    "static inline void rti_congruence(real (*G)[RTI_W], real (*H)[RTI_W], real (*P)[RTI_W], real (*M)[RTI_W])"
)


def _reached(stages: Stages) -> Pattern:
    """Structural nonzeros of [A B] after any number of steps: a path through nx states has nx links at most."""
    rate, driven = (_nonzeros(stages.step, output) for output in (1, 2))
    reached = np.hstack([rate, driven])
    for _ in range(len(rate)):
        reached |= rate @ reached
    return reached


def _chain(rate: Pattern, driven: Pattern, reached: Pattern) -> str:
    """M = A M + [0 B], all by columns: the derivatives after one more step."""
    lines: list[str] = []
    count = 0
    nx = len(rate)
    for j, column in enumerate(reached.T):
        sums = {}
        for r in range(nx):
            terms = [f"A[{q}][{r}] * M[{j}][{q}]" for q in np.flatnonzero(rate[r] & column)]
            count += len(terms)
            if j >= nx and driven[r, j - nx]:
                terms.append(f"B[{j - nx}][{r}]")
            if column[r]:
                sums[r] = " + ".join(terms) or "0"
        if sums:
            lines += ["  {", *(f"    const real c{r} = {text};" for r, text in sums.items())]
            lines += [*(f"    M[{j}][{r}] = c{r};" for r in sums), "  }"]
    head = "static inline void rti_chain_rule(real (*A)[RTI_NX], real (*B)[RTI_NX], real (*M)[RTI_NX])"
    return _function("RTI_UNROLLED_CHAIN_RULE", head, "AB", lines) if count <= _MOST else ""


def _carry(reached: Pattern, hessian: Pattern) -> str:
    """G = H + M' P M, its lower triangle."""
    lines: list[str] = []
    count = 0
    rows = [np.flatnonzero(column) for column in reached.T]
    for j, nonzeros in enumerate(rows):
        needed = sorted({i for row in rows[: j + 1] for i in row}) if len(nonzeros) else []
        lines.append("  {")
        for i in needed:
            terms = [f"P[{max(i, q)}][{min(i, q)}] * M[{q}][{j}]" for q in nonzeros]
            lines.append(f"    const real v{i} = {' + '.join(terms)};")
        for k, row in enumerate(rows[: j + 1]):
            terms = [f"H[{j}][{k}]"] * bool(hessian[j, k]) + [f"M[{i}][{k}] * v{i}" for i in row] * bool(needed)
            lines.append(f"    G[{j}][{k}] = {' + '.join(terms) or '0'};")
        lines.append("  }")
        count += len(needed) * len(nonzeros) + sum(len(row) for row in rows[: j + 1]) * bool(needed)
    return _function("RTI_UNROLLED_CONGRUENCE", _CONGRUENCE, "", lines) if count <= _MOST else ""


def _function(flag: str, head: str, unused: Iterable[str], lines: list[str]) -> str:
    voids = "".join(f"  (void){name};\n" for name in unused)
    return "\n".join([f"#define {flag} 1", head, "{", f"{voids}{lines[0]}", *lines[1:], "}", ""]) if lines else ""
