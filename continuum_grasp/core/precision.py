"""Single precision: generated C made to compute in ``float`` throughout."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from continuum_grasp.base import InputError
from continuum_grasp.model import FingerModel

PRECISIONS = ("double", "float")
"""C types that controllers and packages may compute in."""

_GREATEST = float(np.finfo(np.float32).max)
_LEAST = float(np.finfo(np.float32).tiny)
_ROUNDING = 0.5 * float(np.finfo(np.float32).eps)  # unit roundoff 2^-24

TOKEN = re.compile(
    r"(?P<comment>/\*.*?\*/|//[^\n]*)|(?P<text>\"(?:\\.|[^\"\\])*\"|'(?:\\.|[^'\\])*')|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<number>(?:\d+\.\d*|\.\d+)(?:[eE][-+]?\d+)?|\d+[eE][-+]?\d+)(?![\w.])|\d\w*",
    re.DOTALL,
)
"""C tokens in which digits may stand: comments, texts, names, real numbers without a suffix, all other numbers."""


def precision_of(given: Any) -> str:
    """The name of a C type itself; InputError if nothing computes in it."""
    if not isinstance(given, str) or given not in PRECISIONS:
        raise InputError(f"precision: expected one of {', '.join(PRECISIONS)}, got {given!r:.60}")
    return given


def single(source: str) -> str:
    """C that CasADi generated, with ``float`` as its real type, literals of that type, and its mathematical functions.

    Setting ``casadi_real`` alone would leave every literal and every call of the library in double precision.
    """
    tokens = TOKEN.sub(lambda m: literal(float(m["number"]), "float", m["number"]) if m["number"] else m[0], source)
    return "#define casadi_real float\n" + tokens.replace("#include <math.h>", "#include <tgmath.h>")


def literal(value: float, real: str, text: str | None = None) -> str:
    """A constant as a literal of a C type, written as ``text`` where given; InputError if float cannot hold it."""
    text = repr(value) if text is None else text
    if real == "double":
        return text
    if abs(value) > _GREATEST or 0.0 < abs(value) < _LEAST:
        raise InputError(
            f"the model has a constant of {value:g}, beyond single precision ({_LEAST:.2g} to {_GREATEST:.2g}): take "
            "double precision, or a smaller bending_range or a coarser accuracy (1e-8, say) of the model where its "
            "series are long"
        )
    return f"{text}f"


def check_solvable(model: FingerModel) -> None:
    """Refuse a model of whose accelerations single precision leaves no digit, at the straight finger.

    That is where rounding times the condition of the mass matrix, its diagonal scaled to ones, exceeds one. Scaling
    leaves a factorization without pivoting as it is, and this one is within a factor n of the best (A. van der Sluis,
    doi:10.1007/BF02165096).
    """
    mass = np.array(model.mass_matrix(np.zeros(model.n), np.zeros(model.nu), model.p_nominal))
    scale = 1.0 / np.sqrt(np.diag(mass))
    condition = float(np.linalg.cond(scale[:, None] * mass * scale))
    if not condition * _ROUNDING <= 1.0:
        raise InputError(
            f"single precision may lose all digits of this model's accelerations (condition of the mass matrix "
            f"{condition:.1g}, expected up to {1.0 / _ROUNDING:.1g}): take double precision, or fewer elements"
        )
