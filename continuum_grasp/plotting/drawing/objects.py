"""The object, in any pose."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.style import EDGE, FAINT, OBJECT, Z

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Polygon

    from continuum_grasp.scene.objects import GraspObject

__all__ = ["draw_object", "object_outlines"]

Array = NDArray[Any]

_EDGE_WIDTH = 3.0
"""[points]; half of it lies under the filling."""


def object_outlines(body: GraspObject, pose: Array) -> list[Array]:
    """World outlines (points, 2) [m] of the parts of an object in a pose (3,): x, y [m] and angle [rad]."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    turn = np.array([[c, s], [-s, c]])
    return [pose[:2] + np.asarray(part.outline()) @ turn for part in body.parts]


def draw_object(ax: Axes, outlines: Sequence[Array], *, faint: bool = False, **style: Any) -> list[Polygon]:
    """Draw an object by the outlines of its parts: as one body, or faintly as its outlines alone.

    Returns the patches: once over all parts for a faint one, else first the edges of all parts, then their fillings.
    """
    from matplotlib.patches import Polygon

    if faint:
        layers = [{**FAINT, "zorder": Z.FAINT_OBJECT}]
    else:  # all fillings lie on all edges, so that no edge shows where parts overlap
        edge = {"facecolor": EDGE, "edgecolor": EDGE, "linewidth": _EDGE_WIDTH, "joinstyle": "round"}
        layers = [{**edge, "zorder": Z.OBJECT}, {"facecolor": OBJECT, "linewidth": 0.0, "zorder": Z.OBJECT_FILL}]
    drawn = [Polygon(outline, **{**layer, **style}) for layer in layers for outline in outlines]
    for patch in drawn:
        ax.add_patch(patch)
    return drawn
