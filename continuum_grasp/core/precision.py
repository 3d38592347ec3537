"""Single precision: generated C made to compute in ``float`` throughout."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from continuum_grasp.base import InputError

PRECISIONS = ("double", "float")
"""C types that controllers and packages may compute in."""

_GREATEST = float(np.finfo(np.float32).max)
_LEAST = float(np.finfo(np.float32).tiny)

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
