"""The bent rod integrated densely from its curvature profile."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.rod.mesh import PanelMesh, panel_edges, with_places
from continuum_grasp.scene import Finger


class DenseRod:
    """Position and angle of a planar rod whose curvature is given at the Gauss nodes of panels along it.

    Joints of elements, places where something of the finger jumps, and marks are panel edges. Curvatures may have
    leading axes, one for each of several rods, and may be complex, for derivatives by complex steps.

    ``joints`` are the ends of the elements from base to tip [m], ``panel`` the greatest length of a panel as a part of
    the finger's. ``base`` is world x, y [m] and angle [rad], the finger's where not given;
    ``marks`` are further panel edges [m], point masses where not given.
    """

    def __init__(
        self,
        finger: Finger,
        joints: Array,
        panel: float = 1 / 400,
        base: Sequence[float] | Array | None = None,
        *,
        marks: Sequence[float] | None = None,
    ) -> None:
        pose = (*finger.base.position, finger.base.angle) if base is None else base
        self.start = np.asarray(pose[:2], dtype=float)
        self.start_angle = float(pose[2])
        self.joints = np.asarray(joints, dtype=float)
        marks = [mass.at for mass in finger.masses] if marks is None else marks
        inner = [at for at in (*marks, *finger_breaks(finger)) if at < self.joints[-1]]
        # 5: Gauss points per panel
        self.mesh = PanelMesh(panel_edges(with_places(self.joints, inner), panel * self.joints[-1]), 5)
        self.nodes = self.mesh.nodes
        self.edges = self.mesh.edges
        self.weights = self.mesh.weights

    def angle(self, curvature: Array) -> Array:
        """World angle of the section's X axis at the Gauss points (..., G) [rad]."""
        return np.asarray(self.start_angle + self.mesh.to_nodes(curvature))

    def edge_angle(self, curvature: Array) -> Array:
        """World angle of the section's X axis at the panel edges (..., P + 1) [rad]."""
        return np.asarray(self.start_angle + self.mesh.to_edges(curvature))

    def edge_points(self, curvature: Array, angle: Array | None = None) -> Array:
        """World positions of the panel edges (..., P + 1, 2) [m]; ``angle`` as `angle` gives, where it is known."""
        angle = self.angle(curvature) if angle is None else angle
        walked = [self.mesh.to_edges(-np.sin(angle)), self.mesh.to_edges(np.cos(angle))]
        return np.asarray(self.start + np.stack(walked, axis=-1))

    def edge_index(self, s: float) -> int:
        """Index of the panel edge at a position, for joints, ends and marks."""
        return int(np.argmin(np.abs(self.edges - s)))

    def bends(self, curvature: Array) -> Array:
        """Bending angle of each element (..., N) [rad]."""
        return np.diff(self.mesh.to_edges(curvature)[..., [self.edge_index(s) for s in self.joints]], axis=-1)

    def first_moment(self, density: Array, angle: Array) -> Array:
        """Integral of a density, given at the Gauss points (G,), times the position (..., 2); angles as `angle`."""
        # The mass beyond a section moves with its tangent.
        lever = self.weights * (self.mesh.to_edges(density)[-1] - self.mesh.to_nodes(density))
        walked = np.stack([-np.sin(angle) @ lever, np.cos(angle) @ lever], axis=-1)
        return np.asarray(self.start * float(self.weights @ density) + walked)

    def at(self, curvature: Array, s: Array) -> tuple[Array, Array]:
        """World positions (K, 2) [m] and angles (K,) [rad] of one rod at any places (K,) [m] along it."""
        s = np.asarray(s, dtype=float)
        walked = self.mesh.integrate(1j * np.exp(1j * self.angle(curvature)), s)
        turned = np.real(self.mesh.integrate(curvature, s))
        return self.start + np.stack([walked.real, walked.imag], axis=-1), self.start_angle + turned


def finger_breaks(finger: Finger) -> list[float]:
    """Places along a finger [m] where its rod, its thickness or the moments of its tendons may jump or have kinks."""
    profile = finger.profile
    depths = () if profile.half_depth is None else profile.half_depth.breaks
    shapes = (at for channel in finger.channels for at in channel.shape.breaks)
    return sorted({*profile.breaks, *profile.half_thickness.breaks, *depths, *shapes})
