"""Roots of many functions of one variable at a time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def refine(f: Callable[[Array], Array], low: Array, high: Array, steps: int = 60, tolerance: float = 1e-15) -> Array:
    """Roots between ``low`` and ``high``, where ``f`` (n,) -> (n,) has different signs (Chandrupatla's method)."""
    b, a = np.array(low, dtype=float), np.array(high, dtype=float)
    c = a.copy()
    fa, fb = f(a), f(b)
    fc = fa.copy()
    t = np.full_like(a, 0.5)
    best = b.copy()
    for _ in range(steps):
        x = a + t * (b - a)
        fx = f(x)
        same = np.sign(fx) == np.sign(fa)
        c, fc = np.where(same, a, b), np.where(same, fa, fb)
        b, fb = np.where(same, b, a), np.where(same, fb, fa)
        a, fa = x, fx
        best = np.where(np.abs(fa) < np.abs(fb), a, b)
        width = np.abs(b - a)
        limit = tolerance * (1.0 + np.abs(best)) / np.maximum(width, 1e-300)
        if ((limit > 0.5) | (fa == 0.0)).all():
            break
        with np.errstate(all="ignore"):
            xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
            smooth = (phi**2 < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
            quick = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        t = np.where(smooth & np.isfinite(quick), quick, 0.5)
        t = np.clip(t, np.minimum(limit, 0.5), 1.0 - np.minimum(limit, 0.5))
    return best
