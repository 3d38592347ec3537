"""Divide measured points into the fewest runs that are straight or round within the noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array
from continuum_grasp.scene.objects.measured.noise import Noise

_STEPS = 12
"""Newton steps for circles; they start at zero, below the root, and converge monotonically."""
_LEAST = 5
"""Least number of points of an arc: two more than a circle needs."""
_WIDEST = 0.75 * np.pi
"""Half the greatest turn of an arc [rad]: chords of longer arcs say little of their places."""


class PointRun(NamedTuple):
    """Points ``first`` to ``last``, exclusive, of a closed curve, counted on beyond its end; on an arc or a line."""

    first: int
    last: int
    is_arc: bool
    is_blur: bool = False
    """Whether the points belong to a corner that blur has rounded, which says nothing about the adjacent lines."""


def pieces_of(
    points: Array, nodes: NDArray[np.int_], noise: Noise, spare: float, worth: float, blurred: float = 0.0
) -> tuple[list[PointRun], float]:
    """Divide a closed curve at some of its ``nodes`` into lines and arcs with the least information.

    The information is the sum of squared residuals over the noise's density, without a free ``spare`` variance, plus
    the ``worth`` of each parameter: three for a line, four for an arc, including the place of its end.
    Dynamic programming finds the least (H. Akaike, "A new look at the statistical model identification", IEEE
    Transactions on Automatic Control, 1974).

    Parameters
    ----------
    points : Array
        Points (n, 2), each once.
    nodes : Array
        Increasing indices of the points that may be ends of pieces.
    noise : Noise
    spare : float
        Variance of the points that does not count against a curve, such as rounding to pixels.
    worth : float
        Least sum of squared residuals, per variance, that a parameter must explain [1].
    blurred : float, optional
        Length of a corner that blur has rounded: such a corner costs one parameter.

    Returns
    -------
    pieces : list of PointRun
    information : float
        The least [1].
    """
    density = noise.density
    size = float(np.ptp(points, axis=0).max())
    scaled = (points - points.mean(axis=0)) / size
    sums = _sums(scaled, nodes)
    line, arc = _residuals(sums)
    variance, free = density / size**2, spare / size**2 * sums[0]
    of_line = np.maximum(line - free, 0.0) / variance + 3.0 * worth
    of_arc = np.maximum(arc - free, 0.0) / variance + 4.0 * worth
    of_arc[(sums[0] < _LEAST) | (_turned(scaled, nodes) > 2.0 * _WIDEST)] = np.inf
    costs, is_arc = np.minimum(of_line, of_arc), of_arc < of_line
    # Points of a corner count like noise, the same for any curve.
    of_blur = np.where(_lengths(points, nodes) <= blurred, sums[0] / noise.share + worth, np.inf)
    start = 0
    found: list[tuple[int, int, bool]] = []
    least = np.inf
    for _ in range(2):
        found, least = _least(costs, of_blur, start)
        # The first start may lie within a piece: the beginning of a piece far from it does not.
        half = found[len(found) // 2 :]
        start = next((low for low, _, is_blur in half if not is_blur), start) % len(nodes)
    ends = np.concatenate([nodes, nodes + len(points), nodes + 2 * len(points)])
    pieces = [
        PointRun(int(ends[a]), int(ends[b]), bool(is_arc[a % len(nodes), b - a - 1]) and not is_blur, is_blur)
        for a, b, is_blur in found
    ]
    return pieces, least


def _least(costs: Array, of_blur: Array, start: int) -> tuple[list[tuple[int, int, bool]], float]:
    """Find the runs from node to node, once around from ``start``, with the least total cost, and this cost.

    Node numbers continue beyond the end. A run may be a blurred corner if the run before it is not one.
    """
    count = len(costs)
    best = np.full((2, count + 1), np.inf)
    best[0, 0] = 0.0
    come_from = np.zeros((2, count + 1), dtype=int)
    for low in range(count):
        row = (start + low) % count
        for kind, before, table in ((0, best[:, low].min(), costs), (1, best[0, low] if low else np.inf, of_blur)):
            cost = before + table[row, : count - low]
            better = cost < best[kind, low + 1 :]
            best[kind, low + 1 :][better] = cost[better]
            come_from[kind, low + 1 :][better] = low
    runs = []
    high = count
    kind = int(best[:, count].argmin())
    while high > 0:
        low = int(come_from[kind, high])
        runs.append((start + low, start + high, kind == 1))
        kind = int(best[:, low].argmin()) if kind == 0 else 0
        high = low
    return runs[::-1], float(best[:, count].min())


def _sums(points: Array, nodes: NDArray[np.int_]) -> Array:
    """Sums (9, m, m) of products of the coordinates of the points from each node to the first, second ... after it."""
    x, y = points.T
    z = x * x + y * y
    columns = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y, z * x, z * y, z * z])
    whole = np.concatenate([np.zeros((9, 1)), np.cumsum(np.concatenate([columns, columns], axis=1), axis=1)], axis=1)
    count = len(nodes)
    ends = np.concatenate([nodes, nodes + len(points)])
    after = np.arange(count)[:, None] + np.arange(1, count + 1)
    return np.asarray(whole[:, ends[after]] - whole[:, nodes, None])


def _lengths(points: Array, nodes: NDArray[np.int_]) -> Array:
    """Length of the curve (m, m) from each node to those after it."""
    steps = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    along = np.concatenate([[0.0], np.cumsum(np.concatenate([steps, steps]))])
    count = len(nodes)
    after = np.concatenate([nodes, nodes + len(points)])[np.arange(count)[:, None] + np.arange(1, count + 1)]
    return np.asarray(along[after] - along[nodes, None])


def _turned(points: Array, nodes: NDArray[np.int_]) -> Array:
    """Turn of the direction (m, m) from each node to those after it, by the chords between nodes [rad]."""
    count = len(nodes)
    corners = points[nodes]
    chords = np.diff(corners[np.arange(2 * count + 1) % count], axis=0)
    angles = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0]))
    after = np.arange(count)[:, None] + np.arange(count)
    return np.asarray(np.abs(angles[after] - angles[:count, None]))


def _residuals(sums: Array) -> tuple[Array, Array]:
    """Sums of squared distances of runs of points from their best lines and circles.

    The circles are fitted by the method of G. Taubin ("Estimation of planar curves, surfaces, and nonplanar space
    curves defined by implicit equations", IEEE Transactions on Pattern Analysis and Machine Intelligence, 1991), by
    Newton's method on the characteristic polynomial.
    """
    count = sums[0]
    mx, my, xx, xy, yy, zx, zy, zz = sums[1:] / np.maximum(count, 1.0)
    # Moments about the mean; z becomes (x - mx)^2 + (y - my)^2.
    cxx, cxy, cyy = xx - mx * mx, xy - mx * my, yy - my * my
    m2 = mx * mx + my * my
    z = xx + yy
    mz = cxx + cyy
    cxz = (zx - mx * z) - 2.0 * (mx * cxx + my * cxy)
    cyz = (zy - my * z) - 2.0 * (mx * cxy + my * cyy)
    # The mean of the squared new z, from the old ones.
    dot_xz, dot_yz = zx, zy
    quad = mx * mx * xx + 2.0 * mx * my * xy + my * my * yy
    czz = zz - 4.0 * (mx * dot_xz + my * dot_yz) + 2.0 * m2 * z + 4.0 * quad - 4.0 * m2 * m2 + m2 * m2
    det = cxx * cyy - cxy * cxy
    line = np.maximum(0.5 * mz - np.sqrt(0.25 * (cxx - cyy) ** 2 + cxy * cxy), 0.0)
    a3 = 4.0 * mz
    a2 = -3.0 * mz * mz - czz
    a1 = czz * mz + 4.0 * det * mz - cxz**2 - cyz**2 - mz**3
    a0 = cxz**2 * cyy + cyz**2 * cxx - czz * det - 2.0 * cxz * cyz * cxy + mz * mz * det
    root = np.zeros_like(mz)
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(_STEPS):
            value = a0 + root * (a1 + root * (a2 + root * a3))
            slope = a1 + root * (2.0 * a2 + root * 3.0 * a3)
            step = np.where(slope != 0.0, value / slope, 0.0)
            root = np.clip(root - np.nan_to_num(step), 0.0, line)
    return count * line, count * np.minimum(root, line)
