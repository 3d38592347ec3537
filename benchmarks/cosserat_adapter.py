"""An outside referee's view of this package: cosseratbench (0.3) runs planar rods, held at one end, by its interface.

``python -m benchmarks.bench_referee`` needs an interpreter with ``pip install "cosseratbench[all]" "mujoco<4"`` and the
package. A package that declares the entry point ``continuum_grasp = "benchmarks.cosserat_adapter:ContinuumGrasp"`` in
the group ``cosseratbench.solvers`` makes the referee's own command line find the class.

The model is planar, inextensible and held at its base. A pin is a joint: the first ten-thousandth of the rod has a
millionth of its stiffness. The adapter refuses whatever else a scenario asks for, as the referee's interface requires.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from cosseratbench import Capability, Scenario, Trajectory
from cosseratbench.scenario import End, EndCondition, parallel_transport
from scipy.optimize import least_squares

import continuum_grasp as cg
from continuum_grasp.core import Core

PIN = 1e-4
"""Length of the joint that stands for a pin, per length of the rod [1]: it moves the pivot by half of that."""
SOFT = 1e-6
"""Stiffness of that joint, per the rod's [1]."""
NODES = 100
"""Pieces of the rod, at whose ends its first shape is fitted."""
FLAT = 1e-9
"""Distance from the plane, per length of the rod [1], up to which a rod is planar."""


class ContinuumGrasp:
    """Clothoids, as many as ``elements``; the nodes that the referee asks for are places along them."""

    name = "continuum_grasp"
    backend_version = cg.__version__
    capabilities: frozenset[Capability] = frozenset()

    def __init__(self, elements: int = 4, time_step_scale: float = 1.0) -> None:
        self.elements = elements
        self.scale = time_step_scale

    def settings(self, scenario: Scenario, *, n_elements: int, n_frames: int) -> dict[str, Any]:
        """Numerical choices, which the referee stores beside its results."""
        step = None if scenario.quasi_static else self._step(scenario, n_frames)
        return {"elements": self.elements, "family": "matched_clothoid", "time_step": step}

    def run(self, scenario: Scenario, *, n_elements: int, n_frames: int) -> Trajectory:
        """Equilibrium of a quasi-static scenario in every frame, the motion of another."""
        case = PlanarCase(scenario, self.elements)
        times = np.linspace(0.0, scenario.duration, n_frames)
        if scenario.quasi_static:
            shape = cg.equilibrium(case.finger_scene).backbone(points=n_elements + 1)
            planar = np.repeat(shape[None], n_frames, axis=0)
        else:
            planar = case.motion(self._step(scenario, n_frames), n_frames, n_elements + 1)
        positions = case.in_space(planar)
        normal = np.asarray(scenario.rods[0].normal, dtype=float)
        directors = np.array([parallel_transport(frame, normal) for frame in positions])
        return Trajectory(times, (positions,), (directors,))

    def _step(self, scenario: Scenario, n_frames: int) -> float:
        """Time between frames [s], which the integrator divides as the fastest mode asks for."""
        return self.scale * scenario.duration / (n_frames - 1)


@dataclass
class PlanarCase:
    """A scenario as a scene of this package, or ``NotImplementedError`` with what is outside of its model."""

    scenario: Scenario
    elements: int

    def __post_init__(self) -> None:
        (rod, *more) = self.scenario.rods
        if more or self.scenario.obstacles:
            raise NotImplementedError("one rod that touches nothing")
        if rod.start is EndCondition.FREE or rod.end is not EndCondition.FREE:
            raise NotImplementedError("a rod that is held at its start and free at its end")
        if rod.start_motion is not None or any(load.at is End.START for load in rod.loads):
            raise NotImplementedError("a base that stands still")
        self.rod = rod
        points = np.asarray(rod.centerline, dtype=float)
        self.origin = points[0]
        # A rod that starts extended has its extended length here, with the mass of the whole.
        self.length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        vectors = [*(points[1:] - self.origin), np.asarray(self.scenario.gravity)]
        vectors += [np.asarray(load.force) for load in rod.loads]
        # A clamped rod leaves its base along itself; a pinned one may point anywhere, and hangs.
        hangs = rod.start is EndCondition.PINNED and np.linalg.norm(self.scenario.gravity) > 0.0
        first = np.asarray(self.scenario.gravity) if hangs else points[1] - points[0]
        first = first / np.linalg.norm(first)
        across = [v - (v @ first) * first for v in vectors]
        widest = max(across, key=np.linalg.norm)
        second = widest / np.linalg.norm(widest)
        self.axes = np.array([first, second])
        if any(np.linalg.norm(v - self.axes.T @ (self.axes @ v)) > FLAT * max(1.0, np.linalg.norm(v)) for v in vectors):
            raise NotImplementedError("a rod, a weight and loads in one plane")

    def in_space(self, planar: np.ndarray) -> np.ndarray:
        """Places of the plane (..., 2) in the scenario's axes (..., 3) [m]."""
        return self.origin + planar @ self.axes

    @property
    def linear_density(self) -> float:
        """Mass per length of the rod as it starts [kg/m]."""
        return self.rod.material.density * self.rod.area * self.rod.length / self.length

    def places(self, count: int) -> np.ndarray:
        """Distances along the rod of evenly spaced places of the rod without extension [m]."""
        if self.rod.rest_arc_length is None:
            return np.linspace(0.0, self.length, count)
        spans = np.linalg.norm(np.diff(np.asarray(self.rod.centerline), axis=0), axis=1)
        arc = np.concatenate([[0.0], np.cumsum(spans)])
        return np.interp(np.linspace(0.0, self.rod.length, count), self.rod.rest_arc_length, arc)

    @cached_property
    def finger_scene(self) -> cg.Scene:
        """The scene: the undeformed finger lies along the first axis of the plane."""
        rod, length = self.rod, self.length
        stiffness = rod.material.youngs_modulus * rod.second_moment_of_area
        given: dict[str, Any] = {"linear_density": self.linear_density, "bending_stiffness": stiffness}
        elements: Any = self.elements
        if rod.start is EndCondition.PINNED:
            joint = {**given, "bending_stiffness": SOFT * stiffness, "to": PIN * length}
            given = {"sections": [joint, {**given, "to": length}]}
            elements = [PIN * length, *[(1.0 - PIN) * length / self.elements] * self.elements]
        finger = cg.Finger(rod=cg.Rod(length=length, **given), base={"angle": -np.pi / 2})
        loads = [cg.ForceLoad(kind="force", at=length, force=tuple(self.axes @ load.force)) for load in rod.loads]
        gravity = tuple(float(value) for value in self.axes @ np.asarray(self.scenario.gravity))
        return cg.Scene(finger=finger, gravity=gravity, loads=loads, fidelity={"elements": elements})

    def motion(self, step: float, frames: int, points: int) -> np.ndarray:
        """Places along the rod (frames, points, 2) [m], from the scenario's shape at rest."""
        time = cg.Timing(duration=step * (frames - 1), step=step)
        scene = self.finger_scene.replaced(initial=cg.Initial(q=tuple(self.shape())), time=time)
        moved = cg.simulate(scene)
        return self.along(moved.core, moved.q, points)

    def along(self, core: Core, q: np.ndarray, points: int) -> np.ndarray:
        """Places (T, points, 2) of shapes q (T, n) at the nodes of the referee [m]."""
        s = np.tile(self.places(points), len(q))[:, None]
        shapes = np.repeat(q, points, axis=0)
        u = np.zeros((len(shapes), core.model.nu))
        return np.asarray(core.batch("position", shapes, u, s, None)).reshape(len(q), points, 2)

    def shape(self) -> np.ndarray:
        """Coordinates whose backbone lies nearest to the scenario's nodes."""
        nodes = (self.rod.nodes(NODES) - self.origin) @ self.axes.T
        core = Core(cg.FingerModel(self.finger_scene))

        def off(q: np.ndarray) -> np.ndarray:
            return (self.along(core, q[None], NODES + 1)[0] - nodes).ravel()

        return np.asarray(least_squares(off, np.zeros(core.model.n)).x)
