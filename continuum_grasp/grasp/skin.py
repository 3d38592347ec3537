"""The skin of a finger in grasps: half its thickness along it, with corners rounded."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import Polynomial

from continuum_grasp.scene.profile import Curve

ROUNDED = 0.01
"""Part of the length, to either side of a corner, over which it is rounded [1], so that the skin turns steadily where
contacts pass it. A kink of slope d is off by d * ROUNDED / 4 of the length at most: 0.1 mm of 0.2 m for d = 0.2."""
_SAME = 1e-9
"""Jump of the slope [1] below which there is no corner."""


@lru_cache(maxsize=64)
def skin(thickness: Curve) -> Curve:
    """Half thickness [m] whose kinks and jumps are rounded by cubics, with a continuous slope."""
    length, corners = thickness.edges[-1], []
    for k, at in enumerate(thickness.edges[1:-1], 1):
        before, after = thickness.local(k - 1, at), thickness.local(k, at)
        jump, bend = after(0.0) - before(0.0), after.deriv()(0.0) - before.deriv()(0.0)
        if abs(jump) > _SAME * length or abs(bend) > _SAME:
            # Not beyond half-way to the next edge.
            most = 0.5 * min(at - thickness.edges[k - 1], thickness.edges[k + 1] - at)
            corners.append((k, at, min(ROUNDED * length, most)))
    if not corners:
        return thickness
    widths = {k: width for k, _, width in corners}
    edges, pieces = [0.0], []
    for k, (a, b) in enumerate(zip(thickness.edges[:-1], thickness.edges[1:], strict=True)):
        start, end = a + widths.get(k, 0.0), b - widths.get(k + 1, 0.0)
        edges.append(end)
        pieces.append(tuple(thickness.local(k, start).coef.tolist()))
        if k + 1 in widths:
            edges.append(b + widths[k + 1])
            pieces.append(_cubic(thickness.local(k, end), thickness.local(k + 1, edges[-1]), edges[-1] - end))
    return Curve(tuple(edges), tuple(pieces))


def _cubic(start: Polynomial, end: Polynomial, width: float) -> tuple[float, ...]:
    """The cubic with values and slopes of two polynomials at zero, at both ends of an interval."""
    (a, s), (b, t) = ((float(p(0.0)), float(p.deriv()(0.0))) for p in (start, end))
    rise = (b - a) / width
    return a, s, (3.0 * rise - 2.0 * s - t) / width, (s + t - 2.0 * rise) / width**2


@lru_cache(maxsize=64)
def steepest(curve: Curve) -> float:
    """Greatest slope of a skin without sign [1]."""
    at = np.concatenate([np.linspace(a, b, 33) for a, b in zip(curve.edges[:-1], curve.edges[1:], strict=True)])
    return float(np.abs(np.diff(curve(at)) / np.maximum(np.diff(at), 1e-12 * curve.edges[-1]))[np.diff(at) > 0.0].max())
