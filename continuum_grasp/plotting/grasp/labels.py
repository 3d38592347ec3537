"""Labels beside what they name, clear of the drawing and of each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise, product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.style import Z

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[Any]

_CELL = 2.0
"""Side of a cell of the map of what is taken [points]: as wide as the widest line."""
_FONT = 8.0
"""Size [points]."""
_PAD = 2.5
"""Free margin around a label [points]."""
_TURNS = np.linspace(0.0, math.tau, 32, endpoint=False)
"""Directions in which a label is tried."""
_NEAR, _FAR, _STEP = 7.0, 170.0, 7.0
"""Distances of a label from what it names that are tried [points]: up to half of the drawing, by a line's height."""
_ASIDE, _DRAWN, _WRITTEN, _TOUCHING, _CROSSED = 9.0, 400.0, 2000.0, 250.0, 60.0
_ON_BODY, _OVER = 80.0, 0.5
"""What a place costs, as points of distance: pointing away from the wished side, share of it on the drawing and on
other labels, touching either at all, a leader over a label; standing on a body, for labels that would rather not, and
each point of a leader over the drawing. A label on another cannot be read: any distance is better.
"""


class Label(NamedTuple):
    """A text, what it names, and on which side of it it would best stand."""

    text: str
    color: str
    at: Array
    """What it names (2,), in data coordinates."""
    away: Array
    """Direction (2,) in which to look first; zeros where there is none."""
    on_body: bool = False
    """Whether it may as well stand on ``bodies``, though not on their outlines; others do where all else is far."""


def place_labels(
    ax: Axes, labels: Sequence[Label], areas: Sequence[Array], lines: Sequence[Array], bodies: Sequence[Array]
) -> None:
    """Write labels where nothing else is drawn, with a thin line to what they name where that is not near.

    The axes have their final limits. ``areas`` and ``bodies`` are filled outlines and ``lines`` lines that are drawn,
    (points, 2) each, in data coordinates; labels may stand on bodies.
    """
    ax.figure.draw_without_rendering()  # type: ignore[union-attr]  # before which axes have no place in pixels
    sheet = _Sheet(ax, areas, lines, bodies)
    for label in labels:
        sheet.write(label)


class _Sheet:
    """The axes as a map of cells, in points from their lower left corner."""

    def __init__(self, ax: Axes, areas: Sequence[Array], lines: Sequence[Array], bodies: Sequence[Array]) -> None:
        from matplotlib.transforms import Affine2D

        self.ax = ax
        self.points_per_pixel = scale = 72.0 / ax.figure.dpi
        self.points = ax.transData + Affine2D().translate(-ax.bbox.x0, -ax.bbox.y0).scale(scale)
        self.size = np.array([ax.bbox.width, ax.bbox.height]) * scale
        shape = np.maximum(1, np.ceil(self.size / _CELL).astype(int))
        self.taken, self.texts, self.bodies = (np.zeros(shape, dtype=bool) for _ in range(3))
        for body in bodies:
            self.bodies |= self._inside(self.points.transform(body))
        for area in areas:
            self.taken |= self._inside(self.points.transform(area))
        for line in [*lines, *(np.concatenate([a, a[:1]]) for a in (*areas, *bodies))]:
            self._trace(self.points.transform(line))

    def write(self, label: Label) -> None:
        """Place one label and mark its box as taken."""
        look: dict[str, Any] = {"color": label.color, "fontsize": _FONT, "multialignment": "center"}
        look |= {"linespacing": 1.15, "ha": "center", "va": "center", "zorder": Z.LABEL}
        text = self.ax.text(0, 0, label.text, **look)
        shown = text.get_window_extent()
        half = 0.5 * np.array([shown.width, shown.height]) * self.points_per_pixel + _PAD
        at = self.points.transform(label.at)
        wanted = None
        if np.any(label.away):
            way = self.points.transform(label.at + label.away) - at
            wanted = math.atan2(way[1], way[0])
        center = self._best(at, half, wanted, 0.0 if label.on_body else _ON_BODY)
        x, y = self.points.inverted().transform(center)
        text.set_position((float(x), float(y)))
        low, high = self._cells(center - half), self._cells(center + half)
        self.texts[low[0] : high[0] + 1, low[1] : high[1] + 1] = True
        end = np.clip(at, center - half, center + half)
        if float(np.hypot(*(end - at))) > 1.6 * _NEAR:  # at all places but the nearest
            path = np.array([label.at, self.points.inverted().transform(end)]).T
            look = {"color": label.color, "linewidth": 0.7, "alpha": 0.8, "zorder": Z.LEADER}
            self.ax.plot(*path, scalex=False, scaley=False, **look)
            self._trace(np.array([at, end]))

    def _best(self, at: Array, half: Array, wanted: float | None, on_body: float) -> Array:
        """Center of the box that costs least [points]; on a body it costs ``on_body`` more."""
        # summed-area tables: the share of a box costs four look-ups, however large it is
        full, words, bodies = _sums(self.taken), _sums(self.texts), _sums(self.bodies)
        best, least = at, math.inf
        for turn in _TURNS:
            way = np.array([math.cos(turn), math.sin(turn)])
            edge = min(half[0] / max(abs(way[0]), 1e-9), half[1] / max(abs(way[1]), 1e-9))
            aside = 0.0 if wanted is None else 1.0 - math.cos(turn - wanted)
            for distance in np.arange(_NEAR, _FAR, _STEP):
                cost = distance + _ASIDE * aside
                if cost >= least:
                    break  # farther ones cost more
                center = at + (distance + edge) * way
                low, high = center - half, center + half
                if (low < 0).any() or (high > self.size).any():
                    break
                drawn, written = self._share(full, low, high), self._share(words, low, high)
                cost += _DRAWN * drawn + _WRITTEN * written + (_TOUCHING if drawn + written > 0 else 0.0)
                cost += on_body if self._share(bodies, low, high) > 0 else 0.0
                cost += self._crossed(at, np.clip(at, low, high))
                if cost < least:
                    best, least = center, cost
        return best

    def _crossed(self, start: Array, end: Array) -> float:
        """Cost of what a line to the label would cross: texts, counted in cells up to a few, and the drawing."""
        count = max(2, int(np.hypot(*(end - start)) / _CELL))
        x, y = self._cells(start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)).T
        return float(_CROSSED * min(4, self.texts[x, y].sum()) + _OVER * _CELL * self.taken[x, y].sum())

    def _share(self, sums: Array, low: Array, high: Array) -> float:
        a, b = self._cells(low), self._cells(high) + 1
        inside = sums[b[0], b[1]] - sums[a[0], b[1]] - sums[b[0], a[1]] + sums[a[0], a[1]]
        return float(inside) / max(1, int(np.prod(b - a)))

    def _cells(self, points: Array) -> Array:
        return np.asarray(np.clip((points / _CELL).astype(int), 0, np.array(self.taken.shape) - 1))

    def _trace(self, line: Array) -> None:
        for start, end in pairwise(line):
            count = max(2, int(np.hypot(*(end - start)) / _CELL * 2))
            points = start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
            inside = ((points >= 0) & (points <= self.size)).all(axis=1)
            cells = self._cells(points[inside])
            for shift in product((-1, 0, 1), repeat=2):  # a line is up to a cell wide, on either side of its cell
                wide = np.clip(cells + shift, 0, np.array(self.taken.shape) - 1)
                self.taken[wide[:, 0], wide[:, 1]] = True

    def _inside(self, outline: Array) -> Array:
        """Cells whose centers lie inside an outline."""
        from matplotlib.path import Path

        nx, ny = self.taken.shape
        x, y = np.meshgrid((np.arange(nx) + 0.5) * _CELL, (np.arange(ny) + 0.5) * _CELL, indexing="ij")
        centers = np.column_stack([x.ravel(), y.ravel()])
        return Path(outline).contains_points(centers).reshape(nx, ny)


def _sums(taken: Array) -> Array:
    """Cells taken below and left of each corner."""
    total = np.zeros(np.array(taken.shape) + 1, dtype=int)
    total[1:, 1:] = taken.cumsum(axis=0).cumsum(axis=1)
    return total
