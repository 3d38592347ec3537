"""Forces to scale, and what their arrows mean."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from continuum_grasp.base import Array, amount_text
from continuum_grasp.plotting.drawing.axes import head
from continuum_grasp.plotting.drawing.style import BLUE, GREEN, INK, ORANGE, PURPLE, SKY, YELLOW, Z

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.quiver import Quiver


Force = tuple[Array, Array, str]
"""Point of action (2,) [m], force (2,) [N], and its kind."""

_COLORS = {"contact": BLUE, "load": ORANGE, "tip": GREEN, "support": SKY}
_SPARE = PURPLE, YELLOW, SKY


def force_scale(forces: Iterable[Force], longest: float) -> float:
    """Drawn length per force [m/N]: the greatest is drawn ``longest``; 0 where there is none."""
    greatest = _greatest(forces)
    return longest / greatest if math.isfinite(greatest) and greatest > 0 else 0.0


def _greatest(forces: Iterable[Force]) -> float:
    return max((float(np.hypot(*force)) for _, force, _ in forces), default=0.0)


def draw_forces(ax: Axes, forces: Sequence[Force], scale: float) -> list[Quiver]:
    """Draw forces as arrows from where they act, ``scale`` drawn length per force [m/N]; one patch for each kind."""
    drawn = []
    for kind in _kinds(forces):
        at, force = np.array([(p, f) for p, f, k in forces if k == kind]).transpose(1, 2, 0)
        drawn.append(_arrows(ax, at, force * scale, _color(kind), 1.3))
    return drawn


def draw_arrow(ax: Axes, start: Array, end: Array, color: str, *, width: float = 2.0, **style: Any) -> Quiver:
    """Draw one arrow; ``width`` is that of its line [points]."""
    return _arrows(ax, np.asarray(start)[:, None], np.asarray(end - start)[:, None], color, width, **style)


def _arrows(ax: Axes, at: Array, along: Array, color: str, width: float, **style: Any) -> Quiver:
    """Draw arrows from points (2, K) along vectors (2, K) in the units of the axes, with lines of a width [points].

    An arrow that is shorter than its head gets a smaller one: it points the right way however short it is.
    """
    look: dict[str, Any] = {"headwidth": 4, "headlength": 5, "headaxislength": 4.5, "minlength": 0.5}
    look |= {"angles": "xy", "scale_units": "xy", "scale": 1.0, "units": "inches", "width": width / 72.0}
    return ax.quiver(*at, *along, color=color, **{**look, "zorder": Z.FORCE, **style})


def force_keys(forces: Sequence[Force], names: Mapping[str, str] | None = None) -> list[dict[str, Any]]:
    """Per kind the look of an entry of a legend, with the greatest force; ``names`` are other names of kinds."""
    entries = []
    for kind in _kinds(forces):
        greatest = _greatest(force for force in forces if force[2] == kind)
        label = rf"{(names or {}).get(kind, kind)} $\leq$ {amount_text(greatest, 'N')}"
        look = {"color": _color(kind), "marker": r"$\rightarrow$", "markersize": 13, "linestyle": ""}
        entries.append({"label": label, **look})
    return entries


def explain(
    ax: Axes,
    masses: Sequence[float],
    forces: Sequence[Force],
    name: str | None,
    names: Mapping[str, str] | None = None,
) -> None:
    """Write title and, under it, what dots and arrows mean, with the greatest force of each kind; ``names`` are other
    names of kinds.
    """
    if masses:
        label = ", ".join(f"{1e3 * mass:.3g} g" for mass in dict.fromkeys(masses))
        ax.plot([], [], "o", color=INK, markersize=6, label=label)
    for key in force_keys(forces, names):
        ax.plot([], [], **key)
    texts = ax.get_legend_handles_labels()[1]
    # 6, 40: letters that an entry's sign and its distance take, and that fit over a picture that is taller than wide
    fits = sum(6 + len(text.replace(r"$\leq$", "<")) for text in texts) <= 40
    head(ax, name, columns=4 if fits or np.ptp(ax.get_xlim()) > 1.3 * np.ptp(ax.get_ylim()) else 2)


def _kinds(forces: Sequence[Force]) -> list[str]:
    return list(dict.fromkeys(kind for _, _, kind in forces))


def _color(kind: str) -> str:
    """The color of a kind of force; the same for the same word, which ``hash`` would not give in another process."""
    return _COLORS.get(kind) or _SPARE[sum(kind.encode()) % len(_SPARE)]
