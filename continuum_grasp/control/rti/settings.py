"""Bounds, penalty weights and weights of real-time iterations, in the memory layout of the C."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.errors import InputError

_TOLERANCE = {8: 1e-8, 4: 1e-4}
"""Relative tolerance of the QP's solution [1] by bytes of a number: about the square root of the machine epsilon in
double; in single precision a thousand times the epsilon, since gradients are sums of some hundred rounded terms."""
_ITERATIONS = 40
"""Default cap of the interior-point method [1], which bounds the time of a call; in the shipped closed loops a QP takes
at most 32 factorizations in all (configs/mpc/keep_out.yaml)."""
_REGULARIZATION = 1e-9
"""Added to the inputs' Hessian [cost per input squared]: keeps Riccati pivots positive where an input has no effect;
the least shipped weight, effort 1e-3 over 10 ms, is 1e4 times larger."""


class Settings:
    """Bounds, penalty weights and weights, which may be changed between iterations.

    Attributes read as arrays or numbers and can be assigned; so can entries of arrays.

    Parameters
    ----------
    stages : Stages
        The problem, whose values are the initial ones.
    real : type
        numpy's double or single precision.

    Attributes
    ----------
    u_min, u_max : (nu,) ndarray
        Hard bounds of the inputs; +-1e30 is none.
    c_min, c_max : (nc,) ndarray
        Bounds of the soft constraints.
    linear, quadratic : (nc,) ndarray
        Penalty weights: a violation s costs ``linear s + quadratic s^2 / 2``; a constraint with neither is ignored.
    weights, terminal_weights : (nr,) ndarray
        Weights of the squared errors of the outputs.
    stage : float
        Length of a stage [s] in the integration; cost and input rates use the one of ``Stages``.
    substeps : int
        Runge-Kutta steps per stage.
    iterations : int
        Iteration cap of the interior-point method.
    tolerance : float
        Of the solution, relative.
    regularization : float
        Added to the Hessian's diagonal of the inputs.
    """

    def __init__(self, stages: Stages, real: Any) -> None:
        nu, nc, nr = stages.nu, max(stages.nc, 1), max(stages.nr, 1)
        arrays = {"u_min": nu, "u_max": nu, "c_min": nc, "c_max": nc, "linear": nc, "quadratic": nc}
        arrays |= {"weights": nr, "terminal_weights": nr}
        numbers = [("stage", real), ("substeps", np.intc), ("iterations", np.intc)]
        numbers += [("tolerance", real), ("regularization", real)]
        layout = np.dtype([*[(name, real, (size,)) for name, size in arrays.items()], *numbers], align=True)
        memory = np.zeros((), layout)
        nominal = {name: getattr(stages, name) for name in arrays}
        own = {"iterations": _ITERATIONS, "tolerance": _TOLERANCE[np.dtype(real).itemsize]}
        own |= {"regularization": _REGULARIZATION, "stage": stages.stage, "substeps": stages.substeps}
        fields = {name: memory[name] for name in layout.names or ()}
        fields |= {name: fields[name][: len(value)] for name, value in nominal.items()}
        self.__dict__.update(_memory=memory, _fields=fields, size=layout.itemsize)
        self.__dict__["address"] = ctypes.c_void_p(memory.ctypes.data)
        for name, value in {**nominal, **own}.items():
            setattr(self, name, value)

    def __getattr__(self, name: str) -> Any:
        fields = self.__dict__.get("_fields", {})
        if name not in fields:
            raise AttributeError(f"no setting {name!r}; there are {', '.join(fields)}")
        return fields[name] if fields[name].ndim else fields[name].item()

    def __setattr__(self, name: str, value: ArrayLike) -> None:
        if name not in self._fields:
            raise InputError(f"unknown setting {name!r}: expected one of {', '.join(self._fields)}", key=name)
        try:
            self._fields[name][...] = value
        except (ValueError, TypeError) as error:
            raise InputError(f"expected {self._fields[name].shape}, got {value!r:.60}", key=name) from error
