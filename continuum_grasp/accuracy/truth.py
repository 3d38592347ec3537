"""What a scene does in truth: static poses and natural frequencies of the exact elastic rod."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.accuracy.poses import Pose, poses
from continuum_grasp.errors import SolverError
from continuum_grasp.rod.elastica import Elastica, solve_elastica
from continuum_grasp.rod.frequencies import natural_frequencies
from continuum_grasp.scene.loads import Load
from continuum_grasp.scene.simulate import Scene

__all__ = ["TruePose", "Truth", "find_truth"]

Array = NDArray[np.float64]

STATIONS = 101
"""Places along the finger, base and tip among them, at which shapes are compared."""
_LARGEST_BEND = 3.0 * np.pi
"""A pose that turns the tip further is left out: a load that lasts for a moment does not bend the finger so far."""


@dataclass(frozen=True)
class TruePose:
    """One pose of the exact rod.

    Attributes
    ----------
    pose : Pose
    rod : Elastica
    backbone : (STATIONS, 2) ndarray
        World positions at equally spaced places [m].
    frequencies_hz : (2,) ndarray or None
        First natural frequencies about it; None where the pose is held by what is released.
    """

    pose: Pose
    rod: Elastica
    backbone: Array
    frequencies_hz: Array | None


@dataclass(frozen=True)
class Truth:
    """The exact rod of a scene.

    Attributes
    ----------
    poses : tuple of TruePose
        That at time zero first.
    left_out : tuple of str
        Poses that the exact rod does not have, or that bend it beyond one and a half turns, and why.
    """

    poses: tuple[TruePose, ...]
    left_out: tuple[str, ...]

    @property
    def loads(self) -> tuple[Load, ...]:
        """Loads of every pose, in order: the scene's, then those that hold the initial pose."""
        return self.poses[0].pose.scene.loads

    def curvature_reach(self, start: float, end: float, moving: bool) -> float:
        """Greatest curvature [1/m] of a stretch of the finger in the poses, or swinging about one of them from another.

        The swing goes as far beyond a pose as it starts before it.
        """
        s = np.linspace(start, end, 9)
        s[-1] = np.nextafter(end, start)
        curvatures = np.array([one.rod.curvature(s) for one in self.poses])
        reach = np.abs(curvatures)
        if moving:
            starts = np.concatenate([curvatures, [np.broadcast_to(self.start_curvature(s), s.shape)]])
            reach = reach + np.abs(starts[:, None] - curvatures[None, :]).max(axis=0)
        return float(reach.max())

    def start_curvature(self, s: Array) -> Array:
        """Curvature [1/m] of the initial pose at places (n,) [m]."""
        scene = self.poses[0].pose.scene
        if scene.initial.pose == "equilibrium":
            return np.asarray(self.poses[-1 if scene.initial.held_by else 0].rod.curvature(s))
        if scene.initial.pose == "rest":
            return np.array([next(k for a, b, k in scene.finger.curvature_pieces if at <= b) for at in s])
        return np.zeros_like(s)


def find_truth(scene: Scene) -> Truth:
    """Solve the exact rod in every pose of a scene.

    Raises
    ------
    SolverError
        If the pose at time zero is not found.
    """
    s = np.linspace(0.0, scene.finger.rod.length, STATIONS)
    found: list[TruePose] = []
    left_out: list[str] = []
    for pose in poses(scene):
        try:
            rod = solve_elastica(pose.scene, tolerance=1e-9)
        except SolverError as error:
            if not found and pose.rests:
                raise
            left_out.append(f"{pose.name}: {str(error).splitlines()[0]}")
            continue
        turn = float(abs(rod.angle(s) - scene.finger.base.angle).max())
        if found and turn > _LARGEST_BEND:
            left_out.append(f"{pose.name}: bends the finger by {turn:.3g} rad")
            continue
        frequencies = natural_frequencies(scene.finger, rod) if pose.rests else None
        found.append(TruePose(pose, rod, rod.position(s), frequencies))
    return Truth(tuple(found), tuple(left_out))
