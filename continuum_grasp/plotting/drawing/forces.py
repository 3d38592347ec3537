"""Forces to scale, and what their arrows mean."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from continuum_grasp.base import Array, amount_text
from continuum_grasp.plotting.drawing.style import Color, Z
from continuum_grasp.plotting.drawing.styled_axes import StyledAxes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.quiver import Quiver


Force = tuple[Array, Array, str]
"""Point of action (2,) [m], force (2,) [N], and its kind."""

_COLORS = {"contact": Color.BLUE, "load": Color.ORANGE, "tip": Color.GREEN, "support": Color.SKY}
_SPARE = Color.PURPLE, Color.YELLOW, Color.SKY


_LONGEST = 0.25
"""Length of the greatest force per length of the finger: the direction is seen, the finger not dwarfed."""


@dataclass(frozen=True)
class ForceArrows:
    """Forces at one or several instants beside a finger of a length [m], drawn to one scale."""

    frames: Sequence[Sequence[Force]]
    length: float

    @classmethod
    def above(cls, frames: Iterable[Iterable[Force]], length: float, least: float) -> ForceArrows:
        """Arrows of the forces that are greater than ``least`` [N], by instant."""
        return cls([[force for force in forces if np.hypot(*force[1]) > least] for forces in frames], length)

    @cached_property
    def forces(self) -> list[Force]:
        """Forces of all instants."""
        return [force for forces in self.frames for force in forces]

    @cached_property
    def scale(self) -> float:
        """Drawn length per force [m/N]; 0 where there is none."""
        greatest = _greatest(self.forces)
        return _LONGEST * self.length / greatest if math.isfinite(greatest) and greatest > 0 else 0.0

    @property
    def ends(self) -> list[Array]:
        """Tips of the arrows."""
        return [np.asarray(at) + self.scale * np.asarray(force) for at, force, _ in self.forces]

    def draw(self, ax: Axes, frame: int | None = None) -> list[Quiver]:
        """Draw all forces, or the forces at an instant by its number, from where they act; one patch for each kind."""
        drawn = []
        chosen = self.forces if frame is None else self.frames[frame]
        for kind in _kinds(chosen):
            at, force = np.array([(p, f) for p, f, k in chosen if k == kind]).transpose(1, 2, 0)
            drawn.append(_arrows(ax, at, force * self.scale, _color(kind), 1.3))
        return drawn

    def keys(self, names: Mapping[str, str] | None = None) -> list[dict[str, Any]]:
        """Per kind the look of an entry of a legend, with the greatest force; ``names`` are other names of kinds."""
        entries = []
        for kind in _kinds(self.forces):
            greatest = _greatest(force for force in self.forces if force[2] == kind)
            label = rf"{(names or {}).get(kind, kind)} $\leq$ {amount_text(greatest, 'N')}"
            look = {"color": _color(kind), "marker": r"$\rightarrow$", "markersize": 13, "linestyle": ""}
            entries.append({"label": label, **look})
        return entries


def _greatest(forces: Iterable[Force]) -> float:
    return max((float(np.hypot(*force)) for _, force, _ in forces), default=0.0)


def draw_arrow(ax: Axes, start: Array, end: Array, color: str, *, width: float = 2.0, **style: Any) -> Quiver:
    """Draw one arrow; ``width`` is the width of its line [points]."""
    return _arrows(ax, np.asarray(start)[:, None], np.asarray(end - start)[:, None], color, width, **style)


def _arrows(ax: Axes, at: Array, along: Array, color: str, width: float, **style: Any) -> Quiver:
    """Draw arrows from points (2, K) along vectors (2, K) in the units of the axes, with lines of a width [points].

    An arrow that is shorter than its head gets a smaller one: it points the right way however short it is.
    """
    look: dict[str, Any] = {"headwidth": 4, "headlength": 5, "headaxislength": 4.5, "minlength": 0.5}
    look |= {"angles": "xy", "scale_units": "xy", "scale": 1.0, "units": "inches", "width": width / 72.0}
    return ax.quiver(*at, *along, color=color, **{**look, "zorder": Z.FORCE, **style})


def draw_moment(ax: Axes, center: Array, moment: float, **style: Any) -> list[Any]:
    """Draw a moment other than zero as an arc with a head around a point (2,); nothing of zero."""
    if not moment:
        return []
    turn = np.sign(moment) * np.linspace(-0.5 * np.pi, 0.9 * np.pi, 60)
    # 0.1: radius per side of the picture: there is place for the head
    radius = 0.1 * max(np.ptp(ax.get_xlim()), np.ptp(ax.get_ylim()))
    arc = center + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    arrow = draw_arrow(ax, arc[-6], arc[-1], Color.ORANGE, width=1.8, **{"zorder": Z.MOMENT, **style})
    return [*ax.plot(*arc[:-4].T, color=Color.ORANGE, linewidth=1.8, zorder=Z.MOMENT, **style), arrow]


def explain(
    ax: Axes,
    masses: Sequence[float],
    arrows: ForceArrows,
    name: str | None,
    names: Mapping[str, str] | None = None,
) -> None:
    """Write title and, under it, what dots and arrows mean, with the greatest force of each kind; ``names`` are other
    names of kinds.
    """
    if masses:
        label = ", ".join(f"{1e3 * mass:.3g} g" for mass in dict.fromkeys(masses))
        ax.plot([], [], "o", color=Color.INK, markersize=6, label=label)
    for key in arrows.keys(names):
        ax.plot([], [], **key)
    texts = ax.get_legend_handles_labels()[1]
    # 6, 40: letters that an entry's sign and its distance take, and that fit over a picture that is taller than wide
    fits = sum(6 + len(text.replace(r"$\leq$", "<")) for text in texts) <= 40
    wide = np.ptp(ax.get_xlim()) > 1.3 * np.ptp(ax.get_ylim())
    StyledAxes(ax).head(name, columns=4 if fits or wide else 2)


def _kinds(forces: Sequence[Force]) -> list[str]:
    return list(dict.fromkeys(kind for _, _, kind in forces))


def _color(kind: str) -> str:
    """The color of a kind of force; the same for the same word, which ``hash`` would not give in another process."""
    return _COLORS.get(kind) or _SPARE[sum(kind.encode()) % len(_SPARE)]
