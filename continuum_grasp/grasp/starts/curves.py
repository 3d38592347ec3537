"""Curves whose curvature is linear between knots, many at once, and their distances from an object.

Lengths are in units of the finger's length; planar vectors are complex; a curve starts at 0 with tangent i. B curves
with K knots: ``knots`` (B, K), ``curvatures`` (B, K). Loops run in `curves.c`; without a C compiler in numpy.
"""

from __future__ import annotations

import ctypes
import math
import os
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any, Literal

import numpy as np

from continuum_grasp.base import Indices
from continuum_grasp.base import Numbers as Array
from continuum_grasp.core import CompileError, Compiler
from continuum_grasp.model import PartOutline

EXACT = 1e-12
"""Residual, in lengths of the finger or sizes of the object and rad, at which something touches: rounding after a few
operations."""


def _library() -> ctypes.CDLL | None:
    """The library, compiled unless it is in the cache; None where that cannot be."""
    # A process that had no compiler for a while, or another one, is not bound to what it had then.
    return _loaded(os.environ.get("CC"), os.environ.get("PATH"))


@cache
def _loaded(_named: str | None, _path: str | None) -> ctypes.CDLL | None:
    compiler = Compiler.find()
    if compiler is None:
        return None
    source = files(__package__).joinpath("curves.c").read_text(encoding="utf-8")
    try:
        return ctypes.CDLL(str(compiler.library(source, "distances from objects")))
    except (CompileError, OSError):
        return None


def _called(name: str, out: Array, *arguments: Array | int) -> Array:
    """Call a function of the library: whole numbers, arrays of doubles or complex numbers, and its result."""
    held = [np.ascontiguousarray(each) if isinstance(each, np.ndarray) else each for each in (*arguments, out)]
    passed: list[Any] = [ctypes.c_void_p(each.ctypes.data) if isinstance(each, np.ndarray) else each for each in held]
    if getattr(_library(), name)(*passed):
        raise MemoryError(f"{name}: {len(out)} curves")
    return out


def turning(knots: Array, curvatures: Array, at: Array) -> Array:
    """Angle of the section (B, S) at positions ``at`` (B, S)."""
    spans = np.diff(knots, axis=1)
    turned = np.cumsum(0.5 * spans * (curvatures[:, 1:] + curvatures[:, :-1]), axis=1)
    before = np.concatenate([np.zeros((len(knots), 1)), turned], axis=1)
    piece = _pieces(knots, at, "right")
    first, span, bent, after, whole = (
        np.take_along_axis(row, piece, axis=1) for row in (knots, spans, curvatures, curvatures[:, 1:], before)
    )
    u = np.clip(at - first, 0.0, span)
    return np.asarray(whole + u * (bent + 0.5 * (after - bent) / np.maximum(span, 1e-300) * u))


def curvature_at(knots: Array, curvatures: Array, at: Array) -> Array:
    """Curvature (B, S) at positions ``at`` (B, S)."""
    # Where it steps, the value is that before the step.
    piece = _pieces(knots, at, "left")
    first, span, bent, after = (
        np.take_along_axis(row, piece, axis=1) for row in (knots, np.diff(knots, axis=1), curvatures, curvatures[:, 1:])
    )
    share = np.clip((at - first) / np.maximum(span, 1e-300), 0.0, 1.0)
    return np.asarray(bent + share * (after - bent))


def _pieces(knots: Array, at: Array, side: Literal["left", "right"]) -> Indices:
    """Intervals between knots (B, K) in which positions (B, S) are; the outer ones also beyond the ends."""
    found = [np.searchsorted(row, places, side) for row, places in zip(knots, at, strict=True)]
    return np.asarray(np.clip(np.array(found, dtype=int).reshape(at.shape) - 1, 0, knots.shape[1] - 2))


def sample(knots: Array, curvatures: Array, at: Array) -> Array:
    """Points (B, S) at increasing positions ``at`` (B, S), the first of them 0."""
    if _library():
        return _called("sample", np.empty(at.shape, complex), *knots.shape, at.shape[1], knots, curvatures, at)
    step = np.diff(at, axis=1)
    # Samples lie close to each other.
    inner = at[:, :-1, None] + step[..., None] * (0.5 + np.array([-0.5, 0.5]) / math.sqrt(3.0))
    angle = turning(knots, curvatures, inner.reshape(len(inner), 2 * step.shape[1])).reshape(inner.shape)
    move = np.empty(step.shape, complex)
    # Real functions: numpy's complex exponential takes longer.
    move.real = -0.5 * step * np.sin(angle).sum(axis=2)
    move.imag = 0.5 * step * np.cos(angle).sum(axis=2)
    return np.concatenate([np.zeros((len(move), 1), complex), np.cumsum(move, axis=1)], axis=1)


def rough_distance(shapes: tuple[PartOutline, ...], points: Array) -> Array:
    """Signed distance from the nearest of some outlines, to within 1e-5 of its size."""
    if _library():
        return _called("distances", np.empty(points.shape), points.size, _numbers(shapes), points)
    return np.asarray(np.min([shape.rough_distance(points) for shape in shapes], axis=0))


@lru_cache(maxsize=64)
def _numbers(shapes: tuple[PartOutline, ...]) -> Array:
    """Outlines of an object as `curves.c` has them."""
    return np.array([len(shapes), *(each for shape in shapes for each in shape.rough_numbers)])


def wrapped(angle: Array) -> Array:
    """Angles [rad] as they are within half a turn."""
    return np.asarray(np.remainder(angle + math.pi, math.tau) - math.pi)
