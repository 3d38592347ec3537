"""C source of products with the Jacobian of a stage, unrolled over its structural nonzeros."""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.control.ocp.stages import Stages

__all__ = ["jacobian_products"]

Pattern = NDArray[np.bool_]

_MOST = 1500
"""Multiplications of a product [1] beyond which loops are used: unrolled, they would take over 10 kB."""


def jacobian_products(stages: Stages) -> str:
    """Write ``rti_chain_rule`` and ``rti_add_congruence`` where they are short; otherwise the templates have loops.

    Not for vector lanes, where loops over whole rows are faster.
    """
    rate, driven = (_pattern(stages.step, output) for output in (1, 2))
    return _chain(rate, driven) + _carry(_reached(rate, driven))


def _pattern(function: ca.Function, output: int) -> Pattern:
    """Structural nonzeros of an output."""
    sparsity = ca.sparsify(function.call(function.sx_in())[output]).sparsity()
    pattern = np.zeros(sparsity.shape, dtype=bool)
    pattern[tuple(np.array(sparsity.get_triplet(), dtype=int))] = True
    return pattern


def _reached(rate: Pattern, driven: Pattern) -> Pattern:
    """Structural nonzeros of [A B] of a stage after any number of steps."""
    found = np.hstack([rate, driven])
    while True:
        further = found | _product(rate, found)
        if np.array_equal(further, found):
            return found
        found = further


def _product(a: Pattern, b: Pattern) -> Pattern:
    found: Pattern = (a.astype(int) @ b.astype(int)) > 0
    return found


def _chain(rate: Pattern, driven: Pattern) -> str:
    """M = A M + [0 B], all by columns: the derivatives after one more step."""
    reached = _reached(rate, driven)
    lines: list[str] = []
    count, nx = 0, len(rate)
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


def _carry(reached: Pattern) -> str:
    """G += M' P M, its lower triangle."""
    lines: list[str] = []
    count, rows = 0, [np.flatnonzero(column) for column in reached.T]
    for j, own in enumerate(rows):
        if not len(own):
            continue
        needed = sorted({i for row in rows[: j + 1] for i in row})
        lines.append("  {")
        for i in needed:
            lines.append(f"    const real v{i} = {' + '.join(f'P[{i}][{q}] * M[{q}][{j}]' for q in own)};")
        for k, row in enumerate(rows[: j + 1]):
            if len(row):
                lines.append(f"    G[{j}][{k}] += {' + '.join(f'M[{i}][{k}] * v{i}' for i in row)};")
        lines.append("  }")
        count += len(needed) * len(own) + sum(len(row) for row in rows[: j + 1])
    head = "static inline void rti_add_congruence(real (*G)[RTI_W], real (*P)[RTI_W], real (*M)[RTI_W])"
    return _function("RTI_UNROLLED_CONGRUENCE", head, "", lines) if count <= _MOST else ""


def _function(flag: str, head: str, unused: Iterable[str], lines: list[str]) -> str:
    voids = "".join(f"  (void){name};\n" for name in unused)
    return "\n".join([f"#define {flag} 1", head, "{", f"{voids}{lines[0]}", *lines[1:], "}", ""]) if lines else ""
