"""A grasp: object, supports, bent fingers with their thickness, contacts, friction cones and forces to scale."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.plotting.drawing.axes import new_figure, quiet
from continuum_grasp.plotting.drawing.objects import draw_object
from continuum_grasp.plotting.drawing.style import INK
from continuum_grasp.plotting.drawing.surroundings import draw_supports
from continuum_grasp.plotting.grasp.bodies import draw_fingers
from continuum_grasp.plotting.grasp.contacts import draw_contacts, draw_scale, draw_weight, weight_words
from continuum_grasp.plotting.grasp.labels import Label, place_labels
from continuum_grasp.plotting.grasp.panel import ROW, Row, panel_rows, write_panel
from continuum_grasp.plotting.grasp.resistance import plot_resistance, resistance_extremes, resistance_words
from continuum_grasp.plotting.grasp.view import MM, GraspView

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from continuum_grasp.grasp.result import GraspResult

__all__ = ["plot_grasp"]

Array = NDArray[Any]

_DRAWING = (6.2, 5.4)
"""Greatest width and height of the drawing [inch]."""
_NARROW = (4.6, 5.0)
"""The same where it stands alone, as on a small screen."""
_LEFT, _BELOW, _ABOVE = 0.65, 0.55, 0.62
"""Margins for the axes' ticks and labels, and for two lines of title [inch]."""
_BETWEEN, _PANEL, _POLYGON = 0.3, 2.9, 2.05
"""Distance to the numbers, their width for four columns, and the side of the resisted forces below them [inch]."""
_FAILED = "#A03000"
"""Color of the title where there is no grasp: a red that is read on white."""


def plot_grasp(
    result: GraspResult,
    *,
    ax: Axes | None = None,
    tendons: bool = True,
    numbers: bool = True,
    resisted: ArrayLike | None = None,
) -> Axes:
    """Draw a grasp in the plane of the fingers, in millimeters.

    Parameters
    ----------
    result : GraspResult
        Where there is no verified grasp the closest point is drawn, and where there is none the scene as it starts;
        the title says so.
    ax : matplotlib.axes.Axes, optional
        Where to draw; None: axes in a new figure.
    tendons : bool, optional
        Draw the tendons.
    numbers : bool, optional
        Write the forces: beside the drawing in a new figure, in the labels in axes that are given.
    resisted : array_like, shape (D, 2), optional
        Greatest resisted force in each of D directions around the circle [N], drawn below the numbers.

    Returns
    -------
    matplotlib.axes.Axes
        Arrows are the forces that the object bears, and its weight; the light wedges are the friction cones.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp import plotting
    >>> scene = cg.load("configs/grasp/pinch.yaml", ["solver.max_iterations=1"])
    >>> result = cg.optimize_grasp(scene, raise_on_failure=False)
    >>> plotting.plot_grasp(result).get_xlabel()
    'x [mm]'
    """
    view = GraspView(result)
    alone = ax is None
    if ax is None:
        ax = _sheet(view, panel_rows(view) if numbers else [], resisted)
    low, high = view.box
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    ax.set_xlabel("x [mm]", color=INK)
    ax.set_ylabel("y [mm]", color=INK)
    ax.set_title(_title(result), fontsize=10, color=INK if result.solved else _FAILED, loc="left")
    draw_object(ax, view.outlines)
    areas = [*draw_supports(ax, result.scene.supports, MM), *draw_fingers(ax, view, tendons)]
    cones, arrows = draw_contacts(ax, view)
    areas += [*cones, *draw_scale(ax, view)]
    place_labels(
        ax, _labels(view, forces=numbers and not alone), areas, [*arrows, *draw_weight(ax, view)], view.outlines
    )
    return ax


def _sheet(view: GraspView, rows: list[Row], resisted: ArrayLike | None) -> Axes:
    """Axes in a new figure, which holds what stands beside them too."""
    low, high = view.box
    size = (high - low) * min(np.array(_DRAWING if rows else _NARROW) / (high - low))
    polygon = bool(rows) and resisted is not None and resistance_extremes(resisted)[1] > 0
    text = ROW * len(rows)
    tall = max(size[1], text + (_POLYGON + 1.0 if polygon else 0.0))
    beside = _BETWEEN + _PANEL if rows else 0.0
    width, height = _LEFT + size[0] + beside + 0.15, _BELOW + tall + _ABOVE
    figure = new_figure(float(width), float(height))
    figure.set_layout_engine("none")
    ax = quiet(_at(figure, _LEFT, height - _ABOVE - size[1], size[0], size[1]))
    ax.set_anchor("NW")
    right = _LEFT + size[0] + _BETWEEN
    if rows:
        write_panel(_at(figure, right, height - _ABOVE - text, _PANEL, text), rows)
    if polygon and resisted is not None:
        forces = quiet(_at(figure, right + 0.55, height - _ABOVE - text - 0.6 - _POLYGON, _POLYGON, _POLYGON))
        plot_resistance(resisted, ax=forces)
        forces.set_title(resistance_words(resisted), fontsize=8, color=INK, loc="left", x=-0.26)
    return ax


def _at(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes at a place of a figure, all in inches."""
    wide, high = figure.get_size_inches()
    return figure.add_axes((left / wide, bottom / high, width / wide, height / high))


def _title(result: GraspResult) -> str:
    name = result.scene.name or "grasp"
    if result.solved:
        return f"{name}\n{result.status.value}, verified"
    what = "the closest point found" if result.arrays else "the scene as it starts"
    return f"{name}\nno grasp ({result.status.value}): {what}"


def _labels(view: GraspView, forces: bool) -> list[Label]:
    """Of contacts and weight; with the forces where they do not stand beside the picture."""
    found = []
    for contact in view.contacts:
        numbers = f"\n{contact.normal_force:.2f} N, friction {abs(contact.friction_force):.2f} N" if forces else ""
        found.append(Label(contact.name + numbers, view.color(contact.name), MM * contact.position, contact.normal))
    words = weight_words(view)
    if words:
        found.append(Label(words, INK, view.center_of_mass, np.zeros(2), on_body=True))
    if not view.found:
        for name in view.fingers:
            base = view.backbones[name][0, 1:3]
            found.append(Label(name, view.color(name), base, np.zeros(2)))
    return found
