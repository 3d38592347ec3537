"""Parts of a drawn finger: base clamp, point masses, forces to scale."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.axes import BLUE, GREEN, INK, ORANGE, SPARE, head

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Polygon
    from matplotlib.quiver import Quiver

__all__ = [
    "Force",
    "base_direction",
    "draw_clamp",
    "draw_forces",
    "explain",
    "force_scale",
    "kind_color",
    "mass_positions",
    "masses_of",
]

_KIND_COLORS = {"contact": BLUE, "load": ORANGE, "tip": GREEN}

Force = tuple[NDArray[Any], NDArray[Any], str]
"""Where it acts (2,) [m], force (2,) [N], and what kind it is."""


def base_direction(backbone: NDArray[Any]) -> NDArray[Any]:
    """Unit tangent (2,) at the base of a backbone (points, 2), by a one-sided difference of second order."""
    p = backbone
    tangent = -3 * p[0] + 4 * p[1] - p[2] if len(p) > 2 else p[1] - p[0]
    size = float(np.hypot(*tangent))
    return tangent / size if size > 0 else np.array([0.0, 1.0])


def draw_clamp(ax: Axes, backbone: NDArray[Any], length: float) -> Polygon:
    """A hatched block that holds the base, across the finger of this length [m]."""
    from matplotlib.patches import Polygon

    along = base_direction(backbone)
    across = np.array([-along[1], along[0]])
    half, depth = 0.06 * length, 0.035 * length
    face = [backbone[0] - half * across, backbone[0] + half * across]
    corners = np.array([*face, face[1] - depth * along, face[0] - depth * along])
    block = Polygon(corners, closed=True, facecolor="#DDDDDD", edgecolor="#777777", hatch="////", linewidth=0.0)
    ax.add_patch(block)
    ax.plot(*np.transpose(face), color=INK, linewidth=1.5, solid_capstyle="butt", zorder=3)
    return block


def masses_of(scene: Any) -> list[tuple[float, float]]:
    """Positions along the finger [m] and masses [kg] of a scene; none where it has no finger."""
    masses = getattr(getattr(scene, "finger", None), "masses", ())
    return [(float(m.at), float(m.mass)) for m in masses if m.mass > 0]


def mass_positions(backbone: NDArray[Any], masses: Sequence[tuple[float, float]], length: float) -> NDArray[Any]:
    """World positions (len(masses), 2) on a backbone whose points are evenly spaced from base to tip."""
    s = np.linspace(0.0, length, len(backbone))
    at = [min(at, length) for at, _ in masses]
    return np.column_stack([np.interp(at, s, backbone[:, k]) for k in (0, 1)])


def force_scale(loads: Sequence[Force], length: float) -> float:
    """Drawn length per force [m/N]: the greatest is a quarter of the finger long; 0 without force."""
    greatest = max((float(np.hypot(*force)) for _, force, _ in loads), default=0.0)
    return 0.25 * length / greatest if math.isfinite(greatest) and greatest > 0 else 0.0


def draw_forces(ax: Axes, loads: Sequence[Force], scale: float) -> dict[str, Quiver]:
    """Forces as arrows from where they act, to scale.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    loads : sequence of (position (2,) [m], force (2,) [N], kind)
    scale : float
        Drawn length per force [m/N].

    Returns
    -------
    dict of str to matplotlib.quiver.Quiver
        The arrows of each kind.
    """
    drawn = {}
    for kind in _kinds(loads):
        position = np.array([p for p, _, k in loads if k == kind])
        force = np.array([f for _, f, k in loads if k == kind])
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
            color=kind_color(kind),
            zorder=5,
        )
    return drawn


def explain(ax: Axes, masses: Sequence[tuple[float, float]], loads: Sequence[Force], name: str | None) -> None:
    """Title and, under it, what dots and arrows mean, with the greatest force of each kind."""
    if masses:
        label = ", ".join(f"{1e3 * mass:.3g} g" for mass in dict.fromkeys(mass for _, mass in masses))
        ax.plot([], [], "o", color=INK, markersize=6, label=label)
    for kind in _kinds(loads):
        greatest = max(float(np.hypot(*force)) for _, force, k in loads if k == kind)
        label = rf"{kind} $\leq$ {greatest:.3g} N"
        ax.plot([], [], color=kind_color(kind), marker=r"$\rightarrow$", markersize=13, linestyle="", label=label)
    entries = bool(masses) + len(_kinds(loads))
    slim = np.ptp(ax.get_xlim()) < 1.3 * np.ptp(ax.get_ylim())
    head(ax, name, entries, columns=2 if slim and entries > 2 else 4)


def _kinds(loads: Sequence[Force]) -> list[str]:
    return list(dict.fromkeys(kind for _, _, kind in loads))


def kind_color(kind: str) -> str:
    """The colour of a kind of force; the same for the same word."""
    return _KIND_COLORS.get(kind) or SPARE[sum(kind.encode()) % len(SPARE)]
