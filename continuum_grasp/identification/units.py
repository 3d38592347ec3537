"""Units that data files may use."""

from __future__ import annotations

import difflib
import math

from continuum_grasp.errors import InputError

__all__ = ["factor_to_si", "unit_of_quantity"]

_DEGREE = math.pi / 180.0  # rad
_UNITS: dict[str, dict[str, float]] = {
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": _DEGREE},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "N": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "gf": 9.80665e-3, "kgf": 9.80665},
    "N m": {"N m": 1.0, "N mm": 1e-3, "mN m": 1e-3},
    "kg": {"kg": 1.0, "g": 1e-3, "mg": 1e-6},
    "Hz": {"Hz": 1.0, "kHz": 1e3, "rad/s": 0.5 / math.pi},
    "1/s": {"1/s": 1.0, "1/ms": 1e3},
    "1/m": {"1/m": 1.0, "1/cm": 1e2, "1/mm": 1e3},
}
_QUANTITIES = {"x": "m", "y": "m", "angle": "rad", "bend": "rad", "t": "s", "frequency": "Hz", "decay_rate": "1/s"}


def unit_of_quantity(quantity: str) -> str:
    """SI unit of a measured quantity."""
    return _QUANTITIES[quantity]


def factor_to_si(unit: str, si: str) -> float:
    """Factor from a unit to the SI unit of the same dimension.

    Parameters
    ----------
    unit : str
        What the data is in.
    si : str
        What is wanted, such as ``m`` or ``N m``.

    Raises
    ------
    InputError
        If the unit is unknown, or of another dimension.
    """
    if unit == si:
        return 1.0
    known = _UNITS.get(si, {si: 1.0})
    if unit in known:
        return known[unit]
    spaced = unit.replace("*", " ").replace("·", " ").replace("°", "deg")
    if spaced in known:
        return known[spaced]
    near = difflib.get_close_matches(unit, known, n=1, cutoff=0.75)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise InputError(f"expected a unit like {', '.join(known)}, got {unit!r}{hint}")
