"""Contents of a picture of a grasp: shapes in millimeters, colors, scales."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.base import Array, check_arguments
from continuum_grasp.plotting.drawing import bodies
from continuum_grasp.plotting.drawing.style import Color
from continuum_grasp.plotting.drawing.styled_axes import Box, StyledAxes, bend_box, wrapped
from continuum_grasp.scene import Finger, GraspObject

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.grasp import Contact, GraspResult
    from continuum_grasp.scene import GraspScene


FINGERS = (Color.BLUE, Color.GREEN, "#9A4C80", "#7A6200")
"""Colors of fingers: dark enough for the text that every finger has."""
_SUPPORT = Color.ORANGE
_PLACES = 81
"""Points of an unloaded backbone: chords of a quarter circle stray by 5e-5 of its length, a tenth of a pixel."""


@dataclass(frozen=True)
class GraspView:
    """A result turned into shapes: a grasp, what there is in its place, or a scene without any numbers, whose fingers
    are drawn unloaded and whose object is where it starts.
    """

    result: GraspResult

    @property
    def found(self) -> bool:
        """Whether there are numbers to draw."""
        return "object.pose" in self.result.arrays

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """Contacts that hold the object; none where there is no grasp: the forces of an attempt are not in balance."""
        return self.result.contacts if self.result.verified else ()

    @cached_property
    def places(self) -> list[list[Contact]]:
        """Contacts by place: a support's two with a face that is too short to be seen are drawn as one."""
        left, right, bottom, top = self.box
        # 0.015: distance of dots that touch each other, per side of the picture
        near = 0.015 * max(right - left, top - bottom)
        places: list[list[Contact]] = []
        for contact in self.contacts:
            owner = contact.name.split(".")[0]
            last = places[-1][-1] if places else None
            is_same = last is not None and owner == last.name.split(".")[0] and owner not in self.scene.named_fingers
            if is_same and last is not None and math.dist(last.position, contact.position) < near:
                places[-1].append(contact)
            else:
                places.append([contact])
        return places

    @property
    def scene(self) -> GraspScene:
        """The scene of the grasp."""
        return self.result.scene

    @cached_property
    def pose(self) -> Array:
        """World x, y [m] and angle [rad] of the object (3,)."""
        return np.asarray(self.result.object_pose if self.found else self.scene.object.pose, dtype=float)

    @cached_property
    def center_of_mass(self) -> Array:
        """World position of the center of mass (2,) [m]."""
        return self.pose[:2] + turned(np.array(self.scene.object.com), self.pose[2])

    @cached_property
    def outlines(self) -> list[Array]:
        """Outlines of the object's parts in the world, (points, 2) each [m]."""
        return bodies.object_outlines(self.scene.object, self.pose)

    @cached_property
    def backbones(self) -> dict[str, Array]:
        """Per finger position along it, x, y [m] and the angle of the section's X axis [rad], (points, 4)."""
        if self.found:
            return {name: np.asarray(finger.backbone) for name, finger in self.result.fingers.items()}
        return {name: unloaded(finger) for name, finger in self.scene.named_fingers.items()}

    def body(self, name: str) -> Array:
        """Outline of a finger with its rounded end, (points, 2) [m]."""
        return bodies.finger_outline(self.backbones[name], self.scene.named_fingers[name])

    @cached_property
    def box(self) -> Box:
        """Limits of what must be seen, with a margin for labels."""
        points = [*self.outlines, *(self.body(name) for name in self.scene.named_fingers)]
        for wall in self.scene.walls:
            if math.isfinite(wall.half_length):  # the others are everywhere
                along = turned(np.array(wall.normal), 0.5 * math.pi)
                points.append(np.array(wall.point) + np.outer([-wall.half_length, wall.half_length], along))
        points += [np.array([peg.position]) + peg.radius * bodies.CIRCLE for peg in self.scene.pegs]
        points.append(self.center_of_mass[None, :] + self.force_scale * self.weight[None, :])
        side = float(np.ptp(np.concatenate(points), axis=0).max())
        # for labels 14 mm around everything, but 0.13 to 0.2 of the greater side
        margin = min(max(14e-3, 0.13 * side), 0.2 * side)
        return bend_box(points, margin, slimmest=0.0)

    @cached_property
    def weight(self) -> Array:
        """Weight of the object in the plane (2,) [N]."""
        return self.scene.object.mass * np.array(self.scene.gravity[:2])

    @cached_property
    def extent(self) -> float:
        """Diameter of a disc about as large as the object [m]."""
        points = np.concatenate(self.outlines)
        # the geometric mean of width and height: neither a slab's thickness nor its length scales the arrows
        return float(np.sqrt(np.prod(points.max(axis=0) - points.min(axis=0))))

    @cached_property
    def greatest_force(self) -> float:
        """Greatest of all contact forces and the weight in the plane [N]."""
        forces = [float(np.hypot(*contact.force)) for contact in self.contacts]
        return max([float(np.hypot(*self.weight)), *forces])

    @cached_property
    def force_scale(self) -> float:
        """Drawn length per force [m/N]."""
        # 0.36: length of the greatest force as a part of the object's width: it stays near, and the least is still seen
        return 0.36 * self.extent / self.greatest_force if self.greatest_force > 0 else 0.0

    def color(self, name: str) -> str:
        """Color of a finger, a support, or what a contact's name begins with; gray where there is no grasp."""
        if not self.result.verified:
            return Color.SLATE
        names = list(self.scene.named_fingers)
        owner = name.split(".")[0]
        return FINGERS[names.index(owner)] if owner in names else _SUPPORT


def turned(points: Array, angle: float) -> Array:
    """Points or vectors (..., 2) turned by an angle [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return np.stack([c * points[..., 0] - s * points[..., 1], s * points[..., 0] + c * points[..., 1]], axis=-1)


def lighter(color: str, share: float) -> str:
    """A color mixed with white; 1 is white."""
    parts = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
    return "#" + "".join(f"{round(p + (255 - p) * share):02X}" for p in parts)


def unloaded(finger: Finger) -> Array:
    """The backbone of a finger that nothing bends but its rest curvature (points, 4) [m, rad]."""
    s = np.linspace(0.0, finger.rod.length, _PLACES)
    step = s[1]
    curvature = finger.profile.rest_curvature(0.5 * (s[1:] + s[:-1]))
    angle = finger.base.angle + np.concatenate([[0.0], np.cumsum(curvature * step)])
    # each chord by the angle of its middle: of second order in the step
    middle = 0.5 * (angle[1:] + angle[:-1])
    path = np.concatenate([np.zeros((1, 2)), step * np.cumsum(np.stack([-np.sin(middle), np.cos(middle)], 1), axis=0)])
    return np.column_stack([s, np.array(finger.base.position) + path, angle])


@check_arguments
def plot_object(body: GraspObject, *, ax: Axes | None = None) -> Axes:
    """Draw an object in its own frame: the corners, its convex pieces, and its center of mass.

    Parameters
    ----------
    body : object of a scene
    ax : matplotlib.axes.Axes, optional
        Axes to draw into [m]; None: axes in a new figure.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp import plotting
    >>> plotting.plot_object(cg.load("configs/grasp/gear.yaml").object).get_title()
    '48 corners, 13 convex pieces, 79.72 mm x 79.72 mm'
    """
    outlines = bodies.object_outlines(body, np.zeros(3))
    points = np.concatenate(outlines)
    styled = StyledAxes.plane(ax, bend_box(outlines, 0.1 * body.size), colorbar=False)
    ax = styled.ax
    bodies.draw_object(ax, outlines)
    pieces = [np.array(piece.outline()) for piece in body.pieces]
    for piece in pieces:
        ax.plot(*np.concatenate([piece, piece[:1]]).T, color=Color.INK, linewidth=0.5, linestyle=":", zorder=9)
    corners = [outline for outline in outlines if len(outline) < 200]
    ax.plot(*np.concatenate([np.zeros((0, 2)), *corners]).T, ".", color=Color.INK, markersize=3, zorder=9)
    ax.plot(*body.com, "+", color=Color.INK, markersize=9, zorder=9)
    wide, high = 1e3 * np.ptp(points, axis=0)
    count = sum(len(corner) for corner in corners)
    shape = "convex" if len(pieces) == 1 else f"{len(pieces)} convex pieces"
    title = f"{count} corners, {shape}, {wide:.4g} mm x {high:.4g} mm"
    ax.set_title(wrapped(title, ax.figure.bbox.width / ax.figure.dpi), fontsize=9)
    return ax
