"""The compiled inner loops of the scan, `kernel.c`, and least squares within bounds for many systems at once; without a
C compiler numpy and PIQP do the same.
"""

from __future__ import annotations

import ctypes
import os
from functools import cache
from importlib.resources import files
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.core import CompileError, Compiler
from continuum_grasp.grasp.shape import ROUNDING
from continuum_grasp.nlp import qp_solver


def library() -> ctypes.CDLL | None:
    """The library, compiled unless it is in the cache; None where that cannot be."""
    # A process that had no compiler for a while, or another one, is not bound to what it had then.
    return _library(os.environ.get("CC"), os.environ.get("PATH"))


@cache
def _library(_named: str | None, _path: str | None) -> ctypes.CDLL | None:
    compiler = Compiler.find()
    if compiler is None:
        return None
    source = files(__package__).joinpath("kernel.c").read_text(encoding="utf-8")
    try:
        return ctypes.CDLL(str(compiler.library(source, "the scan of postures")))
    except (CompileError, OSError):
        return None


def called(name: str, out: Array, *arguments: Array | float) -> Array:
    """Call a function of the library: whole and other numbers, arrays of doubles or complex numbers, and its result."""
    held = [np.ascontiguousarray(each) if isinstance(each, np.ndarray) else each for each in (*arguments, out)]
    passed: list[Any] = []
    for each in held:
        if isinstance(each, np.ndarray):
            passed.append(ctypes.c_void_p(each.ctypes.data))
        else:
            passed.append(ctypes.c_double(each) if isinstance(each, float) else each)
    if getattr(library(), name)(*passed):
        raise MemoryError(f"{name}: {len(out)} systems")
    return out


def within_bounds(across: Array, goal: Array, weight: Array, enough: float) -> Array:
    """Unknowns (B, n) in (0, 1) with the least squares of (K x - goal) and ``weight`` x, of transposed systems K' =
    ``across`` (B, n, m), by an interior point method until distances times multipliers are ``enough`` in the mean.

    S. Mehrotra's predictor and corrector, SIAM J. Optim. 2 (1992), doi:10.1137/0802028. The Newton steps are solved in
    the rows of the system, of which there are fewer than columns. Without a compiler PIQP solves the systems, to less
    than that.
    """
    count, size, height = across.shape
    if library():
        # A stiffness that is rounding makes every system regular.
        # 30: most steps: 8 to 11 as a rule, more than 20 in two of a thousand
        sizes = count, height, size, 30, ROUNDING, enough
        return called("within_bounds", np.empty((count, size)), *sizes, across, goal, weight)
    solve = _by_library(size, height).map(count, [False, False, True], [False])
    return np.array(solve(across.transpose(0, 2, 1).reshape(-1, size).T, goal.T, weight)).T


@cache
def _by_library(size: int, height: int) -> ca.Function:
    """Function of a system K' (n, m), goal and weight: the unknowns, by PIQP with the residuals beside them, so that
    its matrices are sparse.
    """
    across, goal, weight = ca.MX.sym("across", size, height), ca.MX.sym("goal", height), ca.MX.sym("weight", size)
    squares, rows = ca.diag(ca.DM([ROUNDING] * size + [1.0] * height)), ca.horzcat(across.T, -ca.MX.eye(height))
    free = [np.inf] * height
    options: dict[str, Any] = {"error_on_fail": False, "piqp": {"eps_abs": 1e-11, "eps_rel": 1e-11}}
    solver = ca.conic("squares", qp_solver(None), {"h": squares.sparsity(), "a": rows.sparsity()}, options)
    solution = solver(
        h=squares,
        g=ca.vertcat(weight, ca.MX(height, 1)),
        a=rows,
        lba=goal,
        uba=goal,
        lbx=ca.DM([0.0] * size + [-bound for bound in free]),
        ubx=ca.DM([1.0] * size + free),
    )
    return ca.Function("squares", [across, goal, weight], [ca.fmin(ca.fmax(solution["x"][:size], 0.0), 1.0)])
