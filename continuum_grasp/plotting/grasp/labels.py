"""Labels beside what they name, clear of the drawing and of each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.plotting.drawing.style import Font, Z

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_CELL = 2.0
"""Side of a cell of the map of taken places [points]: as wide as the widest line."""
_TURNS = np.linspace(0.0, math.tau, 32, endpoint=False)
"""Directions in which a label is tried."""
_LINE = 7.0
"""Height of a line [points]: the least distance of a label from what it names, and the step to the next one."""
_FAR = 170.0
"""Greatest distance that is tried [points]: half of the drawing."""


class _Cost:
    """Costs of a place, as points of distance; a label on another cannot be read, so that any distance is better."""

    ASIDE = 9.0
    """Pointing away from the wished side."""
    DRAWN = 400.0
    """Share of the label on the drawing."""
    WRITTEN = 2000.0
    """Share of the label on other labels."""
    TOUCHING = 250.0
    """Touching either at all."""
    CROSSED = 60.0
    """A leader over a label."""
    ON_BODY = 80.0
    """Standing on a body, for labels that would rather not."""
    OVER = 0.5
    """Each point of a leader over the drawing."""


class Label(NamedTuple):
    """A text, what it names, and on which side of it it would best stand."""

    text: str
    color: str
    at: Array
    """Point that the label names (2,), in data coordinates."""
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
    figure = ax.get_figure(root=True)
    if figure.get_layout_engine() is None:  # type: ignore[union-attr]
        ax.apply_aspect()
    else:  # before which axes have no place in pixels
        figure.draw_without_rendering()  # type: ignore[union-attr]
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
        self.shape = np.maximum(1, np.ceil(self.size / _CELL).astype(int))
        closed = [np.concatenate([a, a[:1]]) for a in (*areas, *bodies)]
        self.bodies = self._painted(bodies, [])
        self.taken = self._painted(areas, [*lines, *closed])
        self.texts = np.zeros(self.shape, dtype=bool)

    def write(self, label: Label) -> None:
        """Place one label and mark its box as taken."""
        look: dict[str, Any] = {"color": label.color, "fontsize": Font.SMALL, "multialignment": "center"}
        look |= {"linespacing": 1.15, "ha": "center", "va": "center", "zorder": Z.LABEL}
        text = self.ax.text(0, 0, label.text, **look)
        shown = text.get_window_extent()
        # 2.5: free margin around a label [points]
        half = 0.5 * np.array([shown.width, shown.height]) * self.points_per_pixel + 2.5
        at = self.points.transform(label.at)
        wanted = None
        if np.any(label.away):
            way = self.points.transform(label.at + label.away) - at
            wanted = math.atan2(way[1], way[0])
        center = self._best(at, half, wanted, 0.0 if label.on_body else _Cost.ON_BODY)
        x, y = self.points.inverted().transform(center)
        text.set_position((float(x), float(y)))
        low = self._cells(center - half)
        high = self._cells(center + half)
        self.texts[low[0] : high[0] + 1, low[1] : high[1] + 1] = True
        end = np.clip(at, center - half, center + half)
        if float(np.hypot(*(end - at))) > 1.6 * _LINE:  # at all places but the nearest
            path = np.array([label.at, self.points.inverted().transform(end)])
            look = {"color": label.color, "linewidth": 0.7, "alpha": 0.8, "zorder": Z.LEADER}
            self.ax.plot(*path.T, scalex=False, scaley=False, **look)
            self.taken |= self._painted([], [path])

    def _best(self, at: Array, half: Array, wanted: float | None, on_body: float) -> Array:
        """Center of the box that costs least [points]; on a body it costs ``on_body`` more."""
        ways = np.stack([np.cos(_TURNS), np.sin(_TURNS)], axis=1)
        edges = (half / np.maximum(np.abs(ways), 1e-9)).min(axis=1)
        aside = 0.0 * _TURNS if wanted is None else 1.0 - np.cos(_TURNS - wanted)
        distances = np.arange(_LINE, _FAR, _LINE)
        centers = at + (distances[None, :, None] + edges[:, None, None]) * ways[:, None, :]
        costs = (distances[None, :] + _Cost.ASIDE * aside[:, None]).ravel()
        centers = centers.reshape(-1, 2)
        inside = ((centers >= half) & (centers + half <= self.size)).all(axis=1)
        if not inside.any():
            return at
        centers, costs = centers[inside], costs[inside]
        low = centers - half
        high = centers + half
        drawn, written, bodies = (self._share(map_, low, high) for map_ in (self.taken, self.texts, self.bodies))
        costs += _Cost.DRAWN * drawn + _Cost.WRITTEN * written + np.where(drawn + written > 0, _Cost.TOUCHING, 0.0)
        costs += np.where(bodies > 0, on_body, 0.0) + self._crossed(at, np.clip(at, low, high))
        return np.asarray(centers[np.argmin(costs)])

    def _crossed(self, start: Array, ends: Array) -> Array:
        """Cost of what lines to labels (K, 2) would cross: texts, counted in cells up to a few, and the drawing."""
        along = np.linspace(0.0, 1.0, int(_FAR / _CELL))[:, None, None]
        x, y = np.moveaxis(self._cells(start + along * (ends - start)), -1, 0)
        cells = np.hypot(*(ends - start).T) / _CELL
        return np.asarray(
            _Cost.CROSSED * np.minimum(4.0, self.texts[x, y].mean(axis=0) * cells)
            + _Cost.OVER * _CELL * self.taken[x, y].mean(axis=0) * cells
        )

    def _share(self, taken: Array, low: Array, high: Array) -> Array:
        """Part of boxes (K, 2) that is taken."""
        # a summed-area table: the share of a box costs four look-ups, however large it is
        sums = np.zeros(self.shape + 1, dtype=int)
        sums[1:, 1:] = taken.cumsum(axis=0).cumsum(axis=1)
        a, c = self._cells(low).T
        b, d = self._cells(high).T + 1
        return np.asarray((sums[b, d] - sums[a, d] - sums[b, c] + sums[a, c]) / ((b - a) * (d - c)))

    def _cells(self, points: Array) -> Array:
        return np.asarray(np.clip((points / _CELL).astype(int), 0, self.shape - 1))

    def _painted(self, areas: Sequence[Array], lines: Sequence[Array]) -> Array:
        """Cells that filled outlines and lines cover, (points, 2) each in data coordinates."""
        from PIL import Image, ImageDraw

        sheet = Image.new("L", (int(self.shape[0]), int(self.shape[1])))
        draw = ImageDraw.Draw(sheet)
        for area in areas:
            draw.polygon(self._corners(area), fill=1)
        for line in lines:  # a line is up to a cell wide, on either side of its cell
            draw.line(self._corners(line), fill=1, width=3)
        return np.asarray(sheet).T.astype(bool)

    def _corners(self, points: Array) -> list[tuple[float, float]]:
        cells = self.points.transform(points) / _CELL - 0.5
        return [(float(x), float(y)) for x, y in cells]
