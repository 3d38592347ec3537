"""Rods of few curvature shapes by numpy: the exact rod's equations projected onto them (Ritz and Galerkin).

What a family of curvature shapes can do at best: everything else of the rod is exact. It compares shapes that the
package does not have (the plain clothoid, whose curvature is linear whatever the stiffness), and it is an independent
truth for those that it has. ``RODS`` are some that are not uniform: length, base stiffness and base density are one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from continuum_grasp.base import Array
from continuum_grasp.rod import RodEquations
from continuum_grasp.rod.dimensionless import read_problem
from continuum_grasp.rod.frequencies import mass_matrix
from continuum_grasp.rod.mesh import PanelMesh, panel_edges, with_places
from continuum_grasp.scene import Scene

_PANEL, _NODES = 1 / 48, 6
"""Greatest length of a panel per that of the rod, and its Gauss nodes: exact to rounding for tapers to a tenth."""
_SHARES = 8
"""Steps in which the loads grow: each then turns no section of the scenes compared by more than a radian."""
THICK = 0.02
"""Thickness at the base [m]: half of it is the greatest offset of a tendon."""


def taper(ratio: float, *, cone: bool) -> dict[str, Any]:
    """Thickness that falls linearly to ``ratio`` of that at the base: a cone, or a wedge of constant width."""
    ends = [THICK, ratio * THICK]
    section = {"diameter": ends} if cone else {"thickness": ends, "width": THICK}
    second = math.pi * THICK**4 / 64 if cone else THICK**4 / 12
    area = math.pi * THICK**2 / 4 if cone else THICK**2
    material = {"youngs_modulus": 1.0 / second, "density": 1.0 / area, "rotary_inertia": 0.0}
    return {"length": 1.0, **material, "sections": [{"to": 1.0, **section}]}


def sections(*steps: tuple[float, float, float]) -> dict[str, Any]:
    """Uniform pieces (end, stiffness, density) from the base."""
    names = ("to", "bending_stiffness", "linear_density")
    return {"length": 1.0, "sections": [dict(zip(names, step, strict=True)) for step in steps]}


RODS = {
    "uniform": {"length": 1.0, "bending_stiffness": 1.0, "linear_density": 1.0},
    "wedge 0.5": taper(0.5, cone=False),
    "wedge 0.25": taper(0.25, cone=False),
    "cone 0.25": taper(0.25, cone=True),
    "cone 0.1": taper(0.1, cone=True),
    "step": sections((0.4, 1.0, 1.0), (1.0, 0.1, 0.3)),
}


@dataclass(frozen=True)
class Shapes:
    """Curvature per L at the nodes of a mesh: ``rest + inputs + basis @ q``."""

    rest: Array  # (G,) without inputs
    inputs: Array  # (G,) what tendons and couples bend, where that is in the shape
    basis: Array  # (G, n)


class ShapeRod:
    """The rod of a scene with elements of given lengths [m], at rest and about it.

    ``family``: "arc" (curvature constant on each element), "clothoid" (curvature linear and continuous), "moment"
    (moment linear and continuous). ``matched``: of the last two, "free"; "tip": the tip's curvature follows from the
    inputs there; "known": all of what the inputs bend is in the shape.
    """

    def __init__(self, scene: Scene, lengths: Sequence[float], family: str, matched: str = "tip") -> None:
        self.scene, self.length = scene, scene.finger.profile.length
        self.joints = np.concatenate([[0.0], np.cumsum(lengths)]) / self.length
        self.joints[-1] = 1.0
        problem = read_problem(scene)
        places = with_places(problem.breaks, self.joints)
        self.equations = RodEquations(problem, PanelMesh(panel_edges(places, _PANEL), _NODES))
        self.shapes = self._arcs() if family == "arc" else self._linear(family == "moment", matched)
        self.n = self.shapes.basis.shape[1]

    def _arcs(self) -> Shapes:
        mesh, element = self.equations.mesh, self._element
        basis = (element[:, None] == np.arange(len(self.joints) - 1)).astype(float)
        means = (basis.T @ (mesh.weights * self.equations.rest)) / (basis.T @ mesh.weights)
        return Shapes(basis @ means, np.zeros(mesh.size), basis)

    @property
    def _element(self) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(self.joints, self.equations.mesh.nodes) - 1, 0, len(self.joints) - 2)

    def _linear(self, of_moment: bool, matched: str) -> Shapes:
        equations, mesh, element = self.equations, self.equations.mesh, self._element
        share = (mesh.nodes - self.joints[element]) / np.diff(self.joints)[element]
        hats = np.zeros((mesh.size, len(self.joints)))
        hats[np.arange(mesh.size), element], hats[np.arange(mesh.size), element + 1] = 1.0 - share, share
        at = self.joints * self.length
        profile, unit = equations.problem.profile, equations.problem.stiffness
        stiffness, moments = profile.bending_stiffness(at) / unit, self._moments(self.joints)
        rest = np.zeros(mesh.size)
        if of_moment:
            hats *= stiffness / equations.bending_stiffness[:, None]
            rest = equations.rest
        nodal = moments / stiffness  # what the inputs alone bend at the nodes
        if matched == "free":
            return Shapes(rest, np.zeros(mesh.size), hats)
        inputs = hats[:, -1] * nodal[-1]
        if matched == "known":
            inputs = self._moments(mesh.nodes) / equations.bending_stiffness - hats[:, :-1] @ nodal[:-1]
        if not of_moment:
            rest = hats[:, -1] * float(profile.rest_curvature(self.length)) * self.length
        return Shapes(rest, inputs, hats[:, :-1])

    def _moments(self, s: Array) -> Array:
        """Moment of tendons and couples at places [1]."""
        problem = self.equations.problem
        found = np.zeros(s.shape)
        for tendon in problem.tendons:
            found += tendon.amplitude * tendon.shape(s * problem.length)
        for at, couple in problem.couples:
            found += couple * (s <= at)
        return found

    def rest(self) -> Array:
        """Curvature per L at the nodes in equilibrium, which Newton's method follows while the loads grow."""
        shapes, weights = self.shapes, self.equations.mesh.weights
        q = np.zeros(self.n)
        for share in np.linspace(0.0, 1.0, _SHARES + 1):
            for _ in range(60):
                curvature = shapes.rest + share * shapes.inputs + shapes.basis @ q
                balance = self.equations.balance(curvature, share)
                force = shapes.basis.T @ (weights * balance.missing)
                slope = shapes.basis.T @ (weights[:, None] * balance.slope) @ shapes.basis
                change = np.linalg.solve(slope, -force)
                turn = self.equations.turn(shapes.basis @ change)
                q = q + change * min(1.0, 0.5 / max(turn, 1e-300))
                if turn < 1e-12:
                    break
            else:
                if turn > 1e-9:
                    raise RuntimeError(f"no equilibrium: the last step turned a section by {turn:.2g} rad")
        return shapes.rest + shapes.inputs + shapes.basis @ q

    def tip(self, curvature: Array) -> Array:
        """Position (2,) of the tip [m]."""
        problem, mesh = self.equations.problem, self.equations.mesh
        place = problem.base + problem.length * mesh.to_edges(self.equations.tangents(curvature))[-1]
        return np.array([place.real, place.imag])

    def mass_matrix(self, curvature: Array) -> Array:
        """Mass matrix (n, n) of the shapes."""
        basis = self.shapes.basis
        mass: Array = basis.T @ mass_matrix(self.scene.finger, self.equations, curvature) @ basis
        return mass

    def frequencies(self, curvature: Array, count: int = 2) -> Array:
        """Natural frequencies about an equilibrium [Hz], (count,); NaN where there are fewer shapes."""
        basis, weights, problem = self.shapes.basis, self.equations.mesh.weights, self.equations.problem
        slope = weights[:, None] * self.equations.balance(curvature).slope * (problem.stiffness / problem.length)
        stiffness = basis.T @ (0.5 * (slope + slope.T)) @ basis
        mass = self.mass_matrix(curvature)
        squares = eigh(stiffness, 0.5 * (mass + mass.T), eigvals_only=True)
        found = np.full(count, np.nan)
        found[: len(squares)] = np.sqrt(np.maximum(squares[:count], 0.0)) / (2.0 * np.pi)
        return found
