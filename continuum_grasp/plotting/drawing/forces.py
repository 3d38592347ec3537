"""Forces to scale, and what their arrows mean."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.axes import head
from continuum_grasp.plotting.drawing.style import BLUE, GREEN, INK, ORANGE, PURPLE, SKY, YELLOW, Z

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.quiver import Quiver
    from matplotlib.text import Annotation

Array = NDArray[Any]

Force = tuple[Array, Array, str]
"""Where it acts (2,) [m], force (2,) [N], and what kind it is."""

_COLORS = {"contact": BLUE, "load": ORANGE, "tip": GREEN, "support": SKY}
_SPARE = PURPLE, YELLOW, SKY


def sizes_of(forces: Iterable[Force]) -> list[float]:
    """Sizes of forces [N]."""
    return [float(np.hypot(*force)) for _, force, _ in forces]


def force_scale(sizes: Iterable[float], longest: float) -> float:
    """Drawn length per force: the greatest of the sizes [N] is drawn ``longest``; 0 where there is none."""
    greatest = max(sizes, default=0.0)
    return longest / greatest if math.isfinite(greatest) and greatest > 0 else 0.0


def draw_forces(ax: Axes, forces: Sequence[Force], scale: float) -> dict[str, Quiver]:
    """Draw forces as arrows from where they act, ``scale`` drawn length per force [m/N]; returns those of each kind."""
    drawn = {}
    for kind in _kinds(forces):
        position = np.array([p for p, _, k in forces if k == kind])
        force = np.array([f for _, f, k in forces if k == kind])
        drawn[kind] = ax.quiver(
            *position.T,
            *(force * scale).T,
            angles="xy",
            scale_units="xy",
            scale=1.0,
            units="dots",
            width=ax.figure.dpi / 55,
            headwidth=4,
            headlength=5,
            headaxislength=4.5,
            minlength=0.5,
            color=_color(kind),
            zorder=Z.FORCE,
        )
    return drawn


def draw_arrow(
    ax: Axes, start: Array, end: Array, color: str, *, shape: str = "-|>", width: float = 2.0, **style: Any
) -> Annotation:
    """Draw one arrow; ``width`` is that of its line [points]."""
    look = {"arrowstyle": shape, "color": color, "linewidth": width, "shrinkA": 0, "shrinkB": 0}
    return ax.annotate("", (end[0], end[1]), (start[0], start[1]), arrowprops=look, **{"zorder": Z.FORCE, **style})


def force_keys(forces: Sequence[Force], words: Mapping[str, str] | None = None) -> list[dict[str, Any]]:
    """Per kind the look of an entry of a legend, with the greatest force; ``words`` are other names of kinds."""
    found = []
    for kind in _kinds(forces):
        greatest = max(sizes_of(force for force in forces if force[2] == kind))
        label = rf"{(words or {}).get(kind, kind)} $\leq$ {greatest:.3g} N"
        look = {"color": _color(kind), "marker": r"$\rightarrow$", "markersize": 13, "linestyle": ""}
        found.append({"label": label, **look})
    return found


def explain(ax: Axes, masses: Sequence[tuple[float, float]], forces: Sequence[Force], name: str | None) -> None:
    """Write title and, under it, what dots and arrows mean, with the greatest force of each kind."""
    if masses:
        label = ", ".join(f"{1e3 * mass:.3g} g" for mass in dict.fromkeys(mass for _, mass in masses))
        ax.plot([], [], "o", color=INK, markersize=6, label=label)
    keys = force_keys(forces)
    for key in keys:
        ax.plot([], [], **key)
    entries = bool(masses) + len(keys)
    slim = np.ptp(ax.get_xlim()) < 1.3 * np.ptp(ax.get_ylim())
    head(ax, name, entries, columns=2 if slim and entries > 2 else 4)


def _kinds(forces: Sequence[Force]) -> list[str]:
    return list(dict.fromkeys(kind for _, _, kind in forces))


def _color(kind: str) -> str:
    """The color of a kind of force; the same for the same word."""
    return _COLORS.get(kind) or _SPARE[sum(kind.encode()) % len(_SPARE)]
