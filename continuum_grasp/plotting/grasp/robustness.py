"""A grasp that holds for errors of its object beside the best one without errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.errors import InputError
from continuum_grasp.plotting.drawing.axes import head, label, new_figure, quiet, show_box
from continuum_grasp.plotting.drawing.bodies import draw_body, draw_object, draw_supports, finger_outline
from continuum_grasp.plotting.drawing.bodies import object_outlines as outlines_of
from continuum_grasp.plotting.drawing.style import BLUE, GRAY, INK

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes

    from continuum_grasp.grasp.result import GraspResult
    from continuum_grasp.grasp.robust.result import Robustness


_LOWEST = -0.5
"""Least margin that is drawn: draws below, contacts that part among them, are in the first bar."""
_BARS = 30


def plot_robustness(result: GraspResult) -> list[Axes]:
    """Draw the grasp for all errors and that without errors, and the friction margins of both in random draws.

    Of tendons with friction also postures with other friction states.
    """
    if result.robustness is None:
        raise InputError(
            "this result has no trials with errors: expected one of a scene with robust, or with tendons.friction",
            key="robust",
        )
    left, right = new_figure(9.0, 4.2).subplots(1, 2)
    return [_shapes(quiet(left), result, result.robustness), _margins(quiet(right), result.robustness)]


def _shapes(ax: Axes, result: GraspResult, robustness: Robustness) -> Axes:
    scene, drawn = result.scene, []
    both: list[tuple[Mapping[str, Array], str, str, float]] = [
        (robustness.nominal_arrays, GRAY, robustness.names[1], 0.35)
    ]
    if robustness.robust is not None:
        both.append((result.arrays, BLUE, robustness.names[2], 0.3))
    # As one body each: postures with other friction states.
    for k in range(len(result.arrays.get("held.object.pose", ()))):
        held = {key.removeprefix("held."): value[k] for key, value in result.arrays.items() if key.startswith("held.")}
        both.insert(k, (held, GRAY, "other friction" if k == 0 else "", 0.2))
    for arrays, color, name, alpha in both:
        for k, (finger, grasp_finger) in enumerate(scene.named_fingers.items()):
            line = np.asarray(arrays[f"{finger}.backbone"])
            outline = finger_outline(line[:, 1:3], grasp_finger, s=line[:, 0], angle=line[:, 3])
            draw_body(ax, outline, facecolor=color, alpha=alpha, label=name if k == 0 else "")
            drawn.append(outline)
    pose = np.asarray(both[-1][0]["object.pose"])
    outlines = outlines_of(scene.object, pose)
    draw_object(ax, outlines)
    points = np.concatenate([*drawn, *outlines])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.06 * float((high - low).max())
    unit = show_box(ax, (low[0] - margin, high[0] + margin, low[1] - margin, high[1] + margin))
    draw_supports(ax, scene.supports)
    label(ax, f"x [{unit}]", f"y [{unit}]")
    head(ax, scene.name)
    return ax


def _margins(ax: Axes, robustness: Robustness) -> Axes:
    edges = np.linspace(_LOWEST, 1.0, _BARS + 1)
    trials = [(robustness.nominal, GRAY, robustness.names[1])]
    if robustness.robust is not None:
        trials.append((robustness.robust, BLUE, robustness.names[2]))
    for trial, color, name in trials:
        margins = np.clip(np.nan_to_num(trial.margins, nan=_LOWEST, neginf=_LOWEST), _LOWEST, 1.0)
        share = np.full(margins.size, 100.0 / margins.size)
        text = f"{name}: {trial.held} of {margins.size} draws hold, {trial.tension:.4g} N"
        ax.hist(margins, edges.tolist(), weights=share, color=color, alpha=0.55, label=text)
    ax.axvline(0.0, color=INK, linewidth=1.0, linestyle=(0, (4, 2)))
    label(ax, "least friction margin of a draw [1]", "draws [%]")
    head(ax, None, columns=1)
    return ax
