"""What a scene does in truth: equilibria and natural frequencies of the exact elastic rod in its load cases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.accuracy.load_cases import LoadCase, load_cases
from continuum_grasp.errors import SolverError
from continuum_grasp.rod.elastica import Elastica, solve_elastica
from continuum_grasp.rod.frequencies import natural_frequencies
from continuum_grasp.scene.loads import Load
from continuum_grasp.scene.simulate import Scene

__all__ = ["TrueCase", "Truth", "find_truth"]

Array = NDArray[np.float64]

STATIONS = 101
"""Places along the finger, base and tip among them, at which shapes are compared: 1 % of the length apart."""
_LARGEST_BEND = 3.0 * np.pi
"""A load case that turns a section further [rad] is omitted: a load that lasts for a moment does not bend so far."""


@dataclass(frozen=True)
class TrueCase:
    """One load case of the exact rod.

    Attributes
    ----------
    case : LoadCase
    rod : Elastica
    backbone : (STATIONS, 2) ndarray
        World positions at equally spaced places [m].
    frequencies_hz : (2,) ndarray or None
        First natural frequencies about it; None where something holds it that is released.
    """

    case: LoadCase
    rod: Elastica
    backbone: Array
    frequencies_hz: Array | None


@dataclass(frozen=True)
class Truth:
    """The exact rod of a scene.

    Attributes
    ----------
    cases : tuple of TrueCase
        That at time zero first.
    omitted : tuple of str
        Load cases in which the exact rod has no equilibrium or bends beyond one and a half turns, and why.
    """

    cases: tuple[TrueCase, ...]
    omitted: tuple[str, ...]

    @property
    def loads(self) -> tuple[Load, ...]:
        """Loads of every load case, in order: the scene's, then those that hold the initial pose."""
        return self.cases[0].case.scene.loads

    def curvature_reach(self, start: float, end: float, moving: bool) -> float:
        """Greatest curvature [1/m] of a segment of the finger at rest, or swinging about one load case from another.

        An undamped swing goes as far beyond its equilibrium as it starts before it.
        """
        s = np.linspace(start, end, 9)
        s[-1] = np.nextafter(end, start)
        curvatures = np.array([one.rod.curvature(s) for one in self.cases])
        reach = np.abs(curvatures)
        if moving:
            starts = np.concatenate([curvatures, [np.broadcast_to(self.start_curvature(s), s.shape)]])
            reach = reach + np.abs(starts[:, None] - curvatures[None, :]).max(axis=0)
        return float(reach.max())

    def start_curvature(self, s: Array) -> Array:
        """Curvature [1/m] of the initial pose at places (n,) [m]."""
        scene = self.cases[0].case.scene
        if scene.initial.pose == "equilibrium":
            return np.asarray(self.cases[-1 if scene.initial.held_by else 0].rod.curvature(s))
        if scene.initial.pose == "rest":
            return np.array([next(k for a, b, k in scene.finger.curvature_pieces if at <= b) for at in s])
        return np.zeros_like(s)


def find_truth(scene: Scene) -> Truth:
    """Solve the exact rod in every load case of a scene.

    Raises
    ------
    SolverError
        If the equilibrium at time zero is not found.
    """
    s = np.linspace(0.0, scene.finger.rod.length, STATIONS)
    found: list[TrueCase] = []
    omitted: list[str] = []
    for case in load_cases(scene):
        try:
            rod = solve_elastica(case.scene, tolerance=1e-9)
        except SolverError as error:
            if not found and case.rests:
                raise
            omitted.append(f"{case.name}: {str(error).splitlines()[0]}")
            continue
        turn = float(abs(rod.angle(s) - scene.finger.base.angle).max())
        if found and turn > _LARGEST_BEND:
            omitted.append(f"{case.name}: bends the finger by {turn:.3g} rad")
            continue
        frequencies = natural_frequencies(scene.finger, rod) if case.rests else None
        found.append(TrueCase(case, rod, rod.position(s), frequencies))
    return Truth(tuple(found), tuple(omitted))
