"""Curves along a finger as polynomials on few common pieces.

Places are in units of the finger's length. On each piece, every curve is a polynomial of the distance from the start
of the piece; its degree is at most `DEGREE`. The stiffness of a linear taper is one such polynomial.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial, chebyshev

from continuum_grasp.base import Array
from continuum_grasp.scene import SAME, Curve, Panels

DEGREE = 4
"""Greatest degree of the polynomials [1]: the stiffness of a rod whose width and thickness change linearly has it."""
MISFIT = 1e-5
"""Greatest distance of a curve from its polynomial, per greatest value of the curve [1]: the tip of a spiral with stops
that bends by 22 rad is off by 4e-7 of its length (`tests/model/test_stage.py`)."""
_EXACT = 1e-13
"""Chebyshev coefficient per greatest value of the curve up to which a term is rounding [1]."""
_SAMPLES = 0.5 - 0.5 * np.cos(np.pi * np.arange(9) / 8.0)
"""Places between two edges of curves, per their distance, at which curves and polynomials are compared."""


@dataclass(frozen=True)
class CurvePiece:
    """A part of a finger between two places, with the coefficients of each curve in powers of ``s - start``."""

    start: float
    end: float
    polynomials: tuple[tuple[float, ...], ...]


def pieces_of(length: float, curves: Sequence[Curve], cuts: Iterable[float] = ()) -> tuple[CurvePiece, ...]:
    """Cut a finger of a length [m] into few pieces on which polynomials come within `MISFIT` of all curves.

    No polynomial follows a jump or a kink, so pieces end there. A knot of a spline ends a piece only if polynomials
    miss the spline otherwise. Pieces end at the places ``cuts`` [m], too, which increase.
    """
    scales = [max(map(abs, curve.extremes)) or 1.0 for curve in curves]
    inside = [at for at in cuts if SAME * length < at < (1.0 - SAME) * length]
    pieces = list[CurvePiece]()
    for start, end in pairwise([0.0, *inside, length]):
        left = [_Sampled.of(curves, *panel) for panel in Panels.of(length, curves, start, end)]
        while left:
            piece, used = None, 0
            # Take as many panels as one polynomial per curve follows.
            while used < len(left) and (longer := _fitted(left[: used + 1], scales, length)) is not None:
                piece, used = longer, used + 1
            if piece is None:
                middle = 0.5 * (left[0].start + left[0].end)
                ends = (left[0].start, middle), (middle, left[0].end)
                left[:1] = [_Sampled.of(curves, *panel) for panel in ends]
                continue
            pieces.append(piece)
            left = left[used:]
    return tuple(pieces)


@dataclass(frozen=True)
class _Sampled:
    """Values (curves, places) of curves at places between two edges [m]."""

    start: float
    end: float
    places: Array
    values: Array

    @classmethod
    def of(cls, curves: Sequence[Curve], start: float, end: float) -> _Sampled:
        places = start + (end - start) * _SAMPLES
        sides = np.array([[curve(places), curve(places, tip_side=True)] for curve in curves])
        # At a jump the panel has the value from inside.
        values = np.where(places > start, sides[:, 0], sides[:, 1])
        return cls(start, end, places, values)


def _fitted(panels: Sequence[_Sampled], scales: Sequence[float], length: float) -> CurvePiece | None:
    """Fit a polynomial to each curve on some panels; None if one of them misses its curve."""
    start, end = panels[0].start / length, panels[-1].end / length
    distance = np.concatenate([panel.places for panel in panels]) / length - start
    values = np.hstack([panel.values for panel in panels])
    table = chebyshev.chebvander(2.0 * distance / (end - start) - 1.0, DEGREE)
    series = np.linalg.lstsq(table, values.T, rcond=None)[0]
    if np.any(np.abs(table @ series - values.T).max(axis=0) > MISFIT * np.array(scales)):
        return None
    polynomials = []
    for scale, coefficients in zip(scales, series.T, strict=True):
        # Without terms of rounding, a constant has no others.
        count = int(np.flatnonzero(np.abs(coefficients) > _EXACT * scale).max(initial=0)) + 1
        shifted = Chebyshev(coefficients[:count], domain=[0.0, end - start])
        polynomials.append(tuple(shifted.convert(kind=Polynomial).coef.tolist()))
    return CurvePiece(start, end, tuple(polynomials))
