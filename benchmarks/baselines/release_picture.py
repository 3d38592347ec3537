"""The picture of error against real-time factor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

DPI = 120
CAPTION = (
    "A line joins what nothing of the same library beats in both. /s: steps per second. MuJoCo: fastest setting at the "
    "error of its chain; plain: without the staggered start; rule: steps good to 1e-4 of the length."
)
STYLES = {
    "ours": ("continuum_grasp", "#1b6ca8", "o"),
    "mujoco": ("MuJoCo hinge chains", "#d1495b", "s"),
    "pyelastica": ("PyElastica", "#6a4c93", "D"),
    "soromox": ("SoRoMoX", "#2e8b57", "^"),
    "jsrm": ("JSRM", "#e09f3e", "v"),
}
"""Name, color and marker of each library."""


@dataclass(frozen=True)
class Point:
    """One contestant in the picture."""

    library: str
    label: str
    factor: float
    """Real-time factor."""
    error: float
    """[m]"""


def draw(panels: Mapping[str, Sequence[Point]], file: Path) -> None:
    """Draw one panel per scene and save the picture."""
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(6.6 * columns, 7.6 * rows), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    axes = np.ravel(figure.subplots(rows, columns, sharey="row", squeeze=False))
    for ax, (title, points) in zip(axes, panels.items(), strict=True):
        _panel(ax, points)
        ax.set_title(f"0.6 m rod {title}", fontsize=11)
        ax.set_xlabel("real-time factor, one core (right is faster)")
    figure.supxlabel(CAPTION, fontsize=9, color="0.35")
    for ax in axes[::columns]:
        ax.set_ylabel("r.m.s. error of the tip over 1 s [mm] (down is better)")
    figure.canvas.draw()
    for ax, points in zip(axes, panels.values(), strict=True):
        _label(ax, points)
    figure.savefig(file)


def _panel(ax: Axes, points: Sequence[Point]) -> None:
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.grid(True, which="major", color="0.9", linewidth=0.8)
    ax.spines[["top", "right"]].set_visible(False)
    for library, (name, color, marker) in STYLES.items():
        own = [p for p in points if p.library == library]
        if not own:
            continue
        best = _front(own)
        ax.plot([p.factor for p in best], [1e3 * p.error for p in best], color=color, alpha=0.45, linewidth=1.5)
        ax.scatter([p.factor for p in own], [1e3 * p.error for p in own], 38, color, marker, label=name, zorder=3)
    ax.margins(x=0.18, y=0.1)
    ax.legend(loc="lower left", frameon=False, fontsize=9)


def _front(points: Sequence[Point]) -> list[Point]:
    """Those than which none is both faster and closer."""
    retained: list[Point] = []
    for point in sorted(points, key=lambda p: -p.factor):
        if not retained or point.error < retained[-1].error:
            retained.append(point)
    return retained


def _label(ax: Axes, points: Sequence[Point]) -> None:
    """Put each label where it covers the least of markers and other labels."""
    renderer = ax.figure.canvas.get_renderer()
    at = ax.transData.transform([(p.factor, 1e3 * p.error) for p in points])
    taken = [mpl.transforms.Bbox.from_extents(x - 7, y - 7, x + 7, y + 7) for x, y in at]
    inside = ax.get_window_extent(renderer)
    for point, center in zip(points, at, strict=True):
        text = ax.annotate(
            point.label, (point.factor, 1e3 * point.error), xytext=(0, 0), textcoords="offset pixels", fontsize=7.5
        )
        text.set_color(STYLES[point.library][1])
        text.set_path_effects([withStroke(linewidth=2.5, foreground="white")])
        size = text.get_window_extent(renderer)
        best = min(_places(size.width, size.height), key=lambda d: _cost(center, d, size, taken, inside))
        text.set_position(best)
        taken.append(mpl.transforms.Bbox.from_bounds(*(center + best), size.width, size.height))


def _places(width: float, height: float) -> list[tuple[float, float]]:
    """Offsets of a label's lower left corner from its point, the pleasant ones first [pixels]."""
    near = [(10, -0.4 * height), (-10 - width, -0.4 * height), (-0.5 * width, 10), (-0.5 * width, -10 - height)]
    near += [(8, 8), (8, -8 - height), (-8 - width, 8), (-8 - width, -8 - height)]
    return near + [(10, k * height) for k in (1.0, -2.0, 2.2, -3.2)] + [(-10 - width, k * height) for k in (1.0, -2.0)]


def _cost(
    center: np.ndarray,
    offset: tuple[float, float],
    size: mpl.transforms.Bbox,
    taken: Sequence[mpl.transforms.Bbox],
    inside: mpl.transforms.Bbox,
) -> float:
    box = mpl.transforms.Bbox.from_bounds(*(center + offset), size.width, size.height)
    cost = 0.02 * float(np.hypot(*offset))
    for other in taken:
        shared = mpl.transforms.Bbox.intersection(box, other)
        if shared is not None:
            cost += 2.0 + shared.width * shared.height
    outside = max(0.0, inside.x0 - box.x0) + max(0.0, box.x1 - inside.x1 - 30.0)
    return cost + 20.0 * outside
