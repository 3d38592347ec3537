"""Margins of a grasp: friction at each contact against its limit, pure forces that it resists, and errors of its object
for which it holds, beside the best grasp without errors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, InputError, amount_text, prefixed
from continuum_grasp.plotting.drawing.bodies import draw_body, draw_object, draw_supports, finger_outline
from continuum_grasp.plotting.drawing.bodies import object_outlines as outlines_of
from continuum_grasp.plotting.drawing.style import Color, Inch
from continuum_grasp.plotting.drawing.styled_axes import StyledAxes, bend_box
from continuum_grasp.plotting.grasp.view import GraspView

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.grasp import GraspResult, Robustness


def plot_resistance(resisted: ArrayLike, *, ax: Axes | None = None) -> Axes:
    """Draw the greatest force in each of D directions (D, 2) [N], in order around the circle, that a grasp resists on
    top of the weight.

    The outline encloses the forces that are resisted; the dashed circle the forces in any direction. Rows that are not
    finite are left out.
    """
    from matplotlib.patches import Circle, Polygon

    styled = StyledAxes.on(ax, 3.2, 3.2)
    ax = styled.ax
    forces = _finite(resisted)
    least, greatest = resistance_extremes(forces)
    if len(forces) > 2:
        ax.add_patch(Polygon(forces, facecolor=Color.BLUE, alpha=0.16, linewidth=0.0, zorder=2))
        ax.add_patch(
            Polygon(forces, facecolor="none", edgecolor=Color.BLUE, linewidth=1.4, joinstyle="round", zorder=3)
        )
    if least > 0.02 * greatest:  # a smaller circle is hidden by the cross
        ax.add_patch(Circle((0, 0), least, facecolor="none", edgecolor=Color.ORANGE, linestyle=(0, (4, 2)), zorder=4))
    ax.plot(0, 0, "+", color=Color.INK, markersize=7, zorder=5)
    corners = np.concatenate([forces, np.zeros((1, 2))])
    center = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    reach = 0.56 * float(np.ptp(corners, axis=0).max()) or 1.0  # half, and a margin of 6 %
    ax.set(aspect="equal", xlim=center[0] + np.array([-reach, reach]), ylim=center[1] + np.array([-reach, reach]))
    ax.locator_params(nbins=5)
    styled.label(styled.shown_label("force x [N]", "x"), styled.shown_label("force y [N]", "y"), fontsize=8)
    ax.tick_params(labelsize=8)
    return ax


def resistance_extremes(resisted: ArrayLike) -> tuple[float, float]:
    """Least and greatest of the resisted forces [N]; zeros where there is none."""
    sizes = np.hypot(*_finite(resisted).T)
    return (float(sizes.min()), float(sizes.max())) if sizes.size and math.isfinite(sizes.max()) else (0.0, 0.0)


def resistance_words(resisted: ArrayLike) -> str:
    """Meaning of the outline of the resisted forces, in a sentence of two lines."""
    least, greatest = resistance_extremes(resisted)
    unlimited = np.isinf(np.asarray(resisted, dtype=float)).any()
    factor, unit = prefixed("N", greatest)
    best = "without limit in the best" if unlimited else f"up to {factor * greatest:.2g} {unit} in the best"
    least = least if least > 1e-4 * greatest else 0.0  # less is the optimizer's tolerance
    return f"resisted force: {factor * least:.2g} {unit} in any direction,\n{best}"


def _finite(resisted: ArrayLike) -> Array:
    forces = np.asarray(resisted, dtype=float).reshape(-1, 2)
    return np.asarray(forces[np.isfinite(forces).all(axis=1)])


DISCS = 4
"""Discs side by side."""
_PITCH, _TALL = 2.5, 3.1
"""Width and height of what one takes, with its name below, in radii of a disc."""


def plot_friction(result: GraspResult, *, ax: Axes | None = None) -> Axes:
    """Draw the friction force of each contact in a disc whose rim is the friction coefficient times the normal force.

    Friction in the plane is drawn to the right, lift upward. A dot on the rim is about to slip: its distance from the
    rim is the friction margin. Nothing is drawn where there is no grasp.
    """
    from matplotlib.patches import Circle

    view = GraspView(result)
    rows = friction_rows(view)
    ax = StyledAxes.on(ax, Inch.PANEL, Inch.DISCS * max(rows, 1) + 0.2).ax
    ax.set_axis_off()
    ax.set_aspect("equal", adjustable="box", anchor="NW")
    ax.set_xlim(0.0, DISCS * _PITCH)
    ax.set_ylim(-max(rows, 1) * _TALL, 0.75)
    if rows:
        words = "friction: sideways in the plane, up lift; rim: slips"
        ax.text(0.0, 0.35, words, fontsize=8, color=Color.SLATE, va="center")
    for k, contact in enumerate(view.contacts):
        row, column = divmod(k, DISCS)
        x = (column + 0.5) * _PITCH
        y = -row * _TALL - 1.25
        color = view.color(contact.name)
        limit = result.scene.friction(contact.name) * contact.normal_force
        ax.add_patch(Circle((x, y), 1.0, facecolor=color, alpha=0.14, linewidth=0.0))
        ax.add_patch(Circle((x, y), 1.0, facecolor="none", edgecolor=color, linewidth=0.8))
        ax.plot([x - 1.0, x + 1.0], [y, y], color=Color.GRAY, linewidth=0.5)
        ax.plot([x, x], [y - 1.0, y + 1.0], color=Color.GRAY, linewidth=0.5)
        if limit > 0.0 and float(
            result.force_text(contact.normal_force, result.force_units[1])
        ):  # else of two roundings
            across, lift = contact.friction_force / limit, contact.lift / limit
            beyond = max(1.0, math.hypot(across, lift))  # what rounding puts beyond the rim
            end = x + across / beyond, y + lift / beyond
            ax.plot([x, end[0]], [y, end[1]], color=color, linewidth=1.6, solid_capstyle="round")
            ax.plot(*end, "o", markersize=4.5, color=color, markeredgecolor="white", markeredgewidth=0.8)
        # 13: letters of a contact's name that fit below a disc
        name = contact.name if len(contact.name) <= 13 else contact.name.replace(".", ".\n")
        ax.text(x, y - 1.15, name, fontsize=7, color=color, ha="center", va="top", linespacing=1.0)
    return ax


def friction_rows(view: GraspView) -> int:
    """Number of rows of discs."""
    return -(-len(view.contacts) // DISCS)


_LOWEST = -0.5
"""Least margin that is drawn: draws below, contacts that part among them, are in the first bar."""


def plot_robustness(result: GraspResult) -> list[Axes]:
    """Draw the grasp for all errors and that without errors, and the friction margins of both in random draws.

    Of tendons with friction also postures with other friction states.
    """
    if result.robustness is None:
        raise InputError(
            "this result has no trials with errors: expected one of a scene with robust, or with tendons.friction",
            key="robust",
        )
    left, right = StyledAxes.figure(9.0, 4.2).subplots(1, 2)
    return [_shapes(left, result, result.robustness), _margins(right, result.robustness)]


def _shapes(ax: Axes, result: GraspResult, robustness: Robustness) -> Axes:
    scene = result.scene
    drawn = []
    both: list[tuple[Mapping[str, Array], str, str, float]] = [
        (robustness.nominal_arrays, Color.GRAY, robustness.names[1], 0.35)
    ]
    if robustness.robust is not None:
        both.append((result.arrays, Color.BLUE, robustness.names[2], 0.3))
    # As one body each: postures with other friction states.
    for k in range(len(result.arrays.get("held.object.pose", ()))):
        held = {key.removeprefix("held."): value[k] for key, value in result.arrays.items() if key.startswith("held.")}
        both.insert(k, (held, Color.GRAY, "other friction" if k == 0 else "", 0.2))
    for arrays, color, name, alpha in both:
        for k, (finger, grasp_finger) in enumerate(scene.named_fingers.items()):
            outline = finger_outline(arrays[f"{finger}.backbone"], grasp_finger)
            draw_body(ax, outline, facecolor=color, alpha=alpha, label=name if k == 0 else "")
            drawn.append(outline)
    pose = np.asarray(both[-1][0]["object.pose"])
    outlines = outlines_of(scene.object, pose)
    draw_object(ax, outlines)
    points = np.concatenate([*drawn, *outlines])
    unit = StyledAxes(ax).show_box(bend_box([points], 0.06 * float(np.ptp(points, axis=0).max()), slimmest=0.0))
    draw_supports(ax, scene.supports)
    StyledAxes(ax).label(f"x [{unit}]", f"y [{unit}]")
    StyledAxes(ax).head(scene.name)
    return ax


def _margins(ax: Axes, robustness: Robustness) -> Axes:
    edges = np.linspace(_LOWEST, 1.0, 30 + 1)
    trials = [(robustness.nominal, Color.GRAY, robustness.names[1])]
    if robustness.robust is not None:
        trials.append((robustness.robust, Color.BLUE, robustness.names[2]))
    for trial, color, name in trials:
        margins = np.clip(np.nan_to_num(trial.margins, nan=_LOWEST, neginf=_LOWEST), _LOWEST, 1.0)
        share = np.full(margins.size, 100.0 / margins.size)
        text = f"{name}: {trial.held} of {margins.size} draws hold, {amount_text(trial.tension, 'N', '.4g')}"
        ax.hist(margins, edges.tolist(), weights=share, color=color, alpha=0.55, label=text)
    ax.axvline(0.0, color=Color.INK, linewidth=1.0, linestyle=(0, (4, 2)))
    StyledAxes(ax).label("least friction margin of a draw [1]", "draws [%]")
    StyledAxes(ax).head(None, columns=1)
    return ax
