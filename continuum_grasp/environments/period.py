"""Control periods of many plants in one call of compiled C: cost, motion and readings, in vector lanes."""

from __future__ import annotations

import ctypes

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.core.cache import library_for
from continuum_grasp.core.call import pointer
from continuum_grasp.core.compiler import find_compiler, why_no_compiler
from continuum_grasp.core.source import filled, in_lanes, template
from continuum_grasp.errors import InputError

Array = NDArray[np.float64]


class Periods:
    """Control periods of plants that differ by parameters alone.

    Parameters
    ----------
    slope : casadi.Function
        (x, u, w, p) -> xd (nx).
    cost : casadi.Function
        (x, u, held, w, p, r) -> cost at the start of the period [1]; ``held`` is the input before.
    readings : casadi.Function
        (x, u, w, p) -> y (ny), read at its end.
    """

    def __init__(self, slope: ca.Function, cost: ca.Function, readings: ca.Function) -> None:
        compiler = find_compiler()
        if compiler is None:
            raise InputError(f"environments run in compiled C: {why_no_compiler()}")
        self.sizes = {"x": slope.numel_in(0), "u": slope.numel_in(1), "w": slope.numel_in(2), "p": slope.numel_in(3)}
        self.sizes |= {"r": cost.numel_in(5), "y": readings.numel_out(0)}
        functions = _lane_functions(slope, cost, readings)
        words = {f"n{name}": size for name, size in self.sizes.items()}
        words |= {f"n{name}1": max(size, 1) for name, size in self.sizes.items()}  # C has no empty arrays
        text = filled(template("environments", "period.c"), words)
        source = f"{functions}\n{template('core', 'gather.c')}\n{text}"
        self._code = ctypes.CDLL(str(library_for(source, compiler, "the environments"))).environment_period
        self._code.restype = None

    def __call__(
        self, x: Array, u: Array, held: Array, w: Array, p: Array, r: Array, readings: Array, substeps: int, h: float
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Move states (count, nx) by steps of h [s], in place, and return costs and which plants stopped.

        All arrays have a row per plant; readings (count, ny) are those at the end. Without substeps only these are
        evaluated. A plant stops where a number is not finite; its state and readings stay as they were.
        """
        count = len(x)
        cost, ended = np.empty(count), np.empty(count, dtype=np.bool_)
        whole = ctypes.c_longlong
        arrays = [pointer(one) for one in (x, u, held, w, p, r, cost, readings)]
        self._code(whole(count), whole(substeps), ctypes.c_double(h), *arrays, ctypes.c_void_p(ended.ctypes.data))
        return cost, ended


def _lane_functions(*functions: ca.Function) -> str:
    found = in_lanes(functions, "double")
    if not found:
        raise InputError("this plant has an operation without vector code, so that environments cannot run it in lanes")
    return found
