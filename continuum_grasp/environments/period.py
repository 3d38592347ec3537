"""Control periods of many plants in one call of compiled C: cost, motion and readings, in vector lanes."""

from __future__ import annotations

import ctypes

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.control.rti.source import load_library
from continuum_grasp.core.call import pointer
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
    use : int
        Which of these is greater than 1 where the model is not valid.
    """

    def __init__(self, slope: ca.Function, cost: ca.Function, readings: ca.Function, use: int) -> None:
        self.sizes = {"x": slope.numel_in(0), "u": slope.numel_in(1), "w": slope.numel_in(2), "p": slope.numel_in(3)}
        self.sizes |= {"r": cost.numel_in(5), "y": readings.numel_out(0)}
        functions = _lane_functions(slope, cost, readings)
        words = {"use": use} | {f"n{name}": size for name, size in self.sizes.items()}
        words |= {f"n{name}1": max(size, 1) for name, size in self.sizes.items()}  # C has no empty arrays
        text = filled(template("environments", "period.c"), words)
        source = f"{functions}\n{template('core', 'gather.c')}\n{text}"
        self._code = load_library(source, "an environment").environment_period
        self._code.restype = None

    def __call__(
        self,
        x: Array,
        u: Array,
        held: Array,
        w: Array,
        p: Array,
        r: Array,
        bounds: Array,
        readings: Array,
        substeps: int,
        h: float,
    ) -> tuple[Array, NDArray[np.int8]]:
        """Move states (count, nx) by steps of h [s], in place; return costs, and where the motion ended.

        All arrays but ``bounds`` (2, nx), least and greatest states, have a row per plant; readings (count, ny) are
        those at the end. Without substeps only these are evaluated. A motion has ended by 1 where a number is not
        finite, with state and readings as they were, and by 2 out of range: where a state is beyond its bounds, or the
        reading ``use`` greater than 1.
        """
        count = len(x)
        cost, ended = np.empty(count), np.empty(count, dtype=np.int8)
        whole = ctypes.c_longlong
        arrays = [pointer(one) for one in (x, u, held, w, p, r, bounds, cost, readings)]
        self._code(whole(count), whole(substeps), ctypes.c_double(h), *arrays, ctypes.c_void_p(ended.ctypes.data))
        return cost, ended


def _lane_functions(*functions: ca.Function) -> str:
    found = in_lanes(functions, "double")
    if not found:
        raise InputError("this plant has an operation without vector code, so that environments cannot run it in lanes")
    return found
