"""Picture and web page of a result, with the forces that it resists."""

from __future__ import annotations

from typing import TYPE_CHECKING

from continuum_grasp.grasp.report.shown import resisted_forces

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.grasp.result import GraspResult


def picture(result: GraspResult) -> Axes:
    """Draw a grasp, or the closest point to one, or neither: the scene is drawn then."""
    from continuum_grasp.plotting.grasp.picture import plot_grasp

    return plot_grasp(result, resisted=resisted_forces(result))


def page(result: GraspResult) -> str:
    """Write the web page of a result."""
    from continuum_grasp.grasp.report.html.page import result_page

    return result_page(result, resisted=resisted_forces(result))
