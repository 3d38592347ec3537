"""A grasp at one design, and how it changes with the numbers of the scene: envelope theorem and KKT conditions.

With the objective f, constraints g, bounds of the unknowns x and numbers n of the scene, all along a direction t of
designs, and the Lagrangian L = f + lambda_g g + lambda_x (x - bound):

    optimal value   dV/dt = (dL/dn) dn/dt - lambda_x dbound/dt
    solution        [H + S  J'] [dx      ]     [d(grad L)/dt - S dbound/dt]
                    [J     -D ] [dlambda ] = - [dg/dt                     ]

S = lambda_x / (x - bound) and D = g / lambda_g of inequalities: the optimality conditions of an interior-point method
at its barrier parameter, so that no set of active limits has to be chosen. A. V. Fiacco, Introduction to Sensitivity
and Stability Analysis in Nonlinear Programming, 1983; H. Pirnay, R. Lopez-Negrete, L. T. Biegler, Math. Program.
Comput. 4 (2012), doi:10.1007/s12532-012-0043-2.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from scipy.linalg import LinAlgError, LinAlgWarning, lstsq, solve

from continuum_grasp.base import Array, InputError
from continuum_grasp.grasp.certificate.certificate import certify
from continuum_grasp.grasp.problem.solver_run import GraspAttempt, GraspSolverRun
from continuum_grasp.grasp.problem.values import tension_weight
from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.grasp.starts.supports import support_contacts
from continuum_grasp.grasp.starts.values import GraspStart
from continuum_grasp.grasp.values import GraspStatus
from continuum_grasp.model import Feature
from continuum_grasp.scene import GraspScene

if TYPE_CHECKING:
    from continuum_grasp.grasp.robust.joint import JointSolverRun

_REGULAR = 1e-11
"""Added to the Hessian [units of the problem]: directions of separating lines that do not matter have no curvature."""
_LEAST = 1e-15
"""Least distance from a bound, and least multiplier, that differs from zero [units of the problem]."""
_SHAPES = (
    # Offsets and weights of differences of fourth order: central, forward, backward.
    ((-2, -1, 1, 2), (1 / 12, -8 / 12, 8 / 12, -1 / 12)),
    ((0, 1, 2, 3, 4), (-25 / 12, 48 / 12, -36 / 12, 16 / 12, -3 / 12)),
    ((0, -1, -2, -3, -4), (25 / 12, -48 / 12, 36 / 12, -16 / 12, 3 / 12)),
)
STEP = 1e-3
"""Step of these differences, per range of a variable: they are then good to 1e-11, as much as rounding."""


class StructureChanges(InputError):
    """Scenes next to each other have grasp problems of different structure, as where a rest curvature vanishes."""


@dataclass(frozen=True)
class Stencil:
    """Scenes along a direction of designs, by which numbers are differentiated; ``offsets`` are in steps from here."""

    offsets: tuple[int, ...]
    weights: tuple[float, ...]
    scenes: tuple[GraspScene, ...]

    @classmethod
    def of(cls, along: Callable[[float], GraspScene]) -> Stencil:
        """The first stencil whose scenes, by their distance from here, make sense: to both sides, else to one.

        InputError where there is none.
        """
        failures: list[InputError] = []
        for offsets, weights in _SHAPES:
            try:
                return cls(offsets, weights, tuple(along(offset * STEP) for offset in offsets))
            except InputError as error:
                failures.append(error)
        raise failures[0]

    def difference(self, values: Sequence[Any]) -> Any:
        """Derivative of numbers or arrays, given for each scene."""
        return sum(weight * value for weight, value in zip(self.weights, values, strict=True)) / STEP

    def change(self, change: Callable[[GraspScene], GraspScene]) -> Stencil:
        return replace(self, scenes=tuple(change(scene) for scene in self.scenes))


@dataclass(frozen=True)
class HeldGrasp:
    """A converged attempt at a scene; of one with a relaxed mass, the greatest mass is sought."""

    scene: GraspScene
    solver: GraspSolverRun | JointSolverRun
    attempt: GraspAttempt
    arrays: dict[str, Array]
    relaxed: bool = False

    @cached_property
    def quantities(self) -> dict[str, float]:
        """Quantities of the grasp that expressions may name."""
        return self._quantities(self.scene, self.attempt.x, self.arrays)

    def _quantities(self, scene: GraspScene, x: Array, arrays: dict[str, Array]) -> dict[str, float]:
        """The quantities next to this grasp: greatest and least ones belong to the contact or tendon that has them
        here.
        """
        if self.relaxed:
            return {"payload": scene.object.mass * (1.0 - float(x[self.solver.problem.x.at["relaxed mass"]][0]))}
        tensions, forces, margins = _parts(scene, arrays)
        tightest, pressed, least = self._extremes
        return {
            "tension": float(tensions.sum()),
            "tension_max": float(tensions[tightest]),
            "normal_force_max": float(forces[pressed]),
            "friction_margin": float(margins[least]),
        }

    @property
    def full(self) -> bool:
        """Whether all of the scene's mass is held, so that more might be."""
        return self.quantities["payload"] > 0.98 * self.scene.object.mass

    def result(self, message: str) -> GraspResult:
        """The grasp as a result, with the mass that it holds."""
        scene = with_mass(self.scene, self.quantities["payload"]) if self.relaxed else self.scene
        return GraspResult(scene, GraspStatus.OPTIMAL, message, self.arrays, certify(scene, self.arrays))

    @property
    def nominal(self) -> Array:
        """The unknowns of the grasp without errors."""
        return self.attempt.x[: self.solver.problem.x.size]

    @property
    def acting(self) -> tuple[tuple[float, ...], ...]:
        """Errors and friction states that decide the grasp, as rows of `continuum_grasp.grasp.robust.errors`."""
        from continuum_grasp.grasp.robust.joint import JointSolverRun

        if not isinstance(self.solver, JointSolverRun):
            return ()
        return tuple(sorted(tuple(error.tolist()) for error in self.solver.acting(self.attempt)))

    @cached_property
    def _extremes(self) -> tuple[int, int, int]:
        """Indices of the greatest tension and normal force, and of the least friction margin."""
        tensions, forces, margins = _parts(self.scene, self.arrays)
        return int(tensions.argmax()), int(forces.argmax()), int(margins.argmin())

    def slopes(self, near: Stencil) -> tuple[Array, dict[str, float]]:
        """Derivatives of the unknowns (n,) and of the quantities along a direction of designs.

        Raises
        ------
        StructureChanges
            Scenes there have a grasp problem of another structure.
        """
        if self.relaxed:
            near = near.change(partial(with_mass, mass=self.scene.object.mass))
        contacts, spec = self.attempt.start.contacts, self.solver.problem.spec
        if not all(spec.fits(scene, contacts) for scene in near.scenes):
            raise StructureChanges("the grasp problem changes its structure here")
        beside = [(scene, self._beside(scene)) for scene in near.scenes]
        numbers = [self.solver.numbers_near(scene, self.attempt, *states) for scene, states in beside]
        bounds = [self.solver.bounds(scene, *states) for scene, states in beside]
        low, high = (near.difference([_finite(pair[k]) for pair in bounds]) for k in (0, 1))
        x = self._tangent(near, numbers, low, high)
        samples: list[dict[str, float]] = []
        for offset, scene, there in zip(near.offsets, near.scenes, numbers, strict=True):
            at = self.attempt.x + offset * STEP * x
            arrays = self.solver.arrays(scene, replace(self.attempt, x=at, numbers=there))
            samples.append(self._quantities(scene, at, arrays))
        quantities = {name: float(near.difference([sample[name] for sample in samples])) for name in self.quantities}
        if not self.relaxed and self.scene.objective == "least_tension":
            quantities["tension"] = self._envelope(near, near.difference(numbers), low, high)
        return x, quantities

    def _beside(self, scene: GraspScene) -> tuple[GraspStart, dict[str, Feature]]:
        start = self.attempt.start
        return moved_start(self.scene, scene, start), self.attempt.features_in(self.scene, scene, start.contacts)

    def _tangent(self, near: Stencil, numbers: list[Array], low: Array, high: Array) -> Array:
        """Change of the unknowns, from the conditions of optimality."""
        attempt = self.attempt
        functions = self.solver.nlp.functions
        x = attempt.x
        forces = attempt.multipliers.constraints
        bound_forces = attempt.multipliers.bounds
        gradients, values = [], []
        for there in numbers:
            column, slope = functions["jac_g"](x, there)
            gradients.append(np.array(functions["grad_f"](x, there)[1] + slope.T @ forces).ravel())
            values.append(np.array(column).ravel())
        jacobian = np.array(functions["jac_g"](x, attempt.numbers)[1])
        upper = np.array(ca.DM(functions["hess_lag"](x, attempt.numbers, 1.0, forces)))
        hessian = np.triu(upper) + np.triu(upper, 1).T
        least, greatest = self.solver.bounds(self.scene, *self._beside(self.scene))
        # A relaxed limit is beyond the bounds that the scene gives without it.
        greatest = np.where(x > greatest + 1e-6, np.inf, greatest)
        under = np.where(bound_forces < 0.0, -bound_forces, 0.0) / np.maximum(x - least, _LEAST)
        over = np.where(bound_forces > 0.0, bound_forces, 0.0) / np.maximum(greatest - x, _LEAST)
        rows_low, rows_high = self.solver.row_bounds
        g = attempt.g
        spare = np.where(forces < 0.0, g - rows_low, rows_high - g)
        spare = np.where(rows_low == rows_high, 0.0, np.maximum(spare, _LEAST))
        with np.errstate(invalid="ignore"):
            slack = np.where(rows_low == rows_high, 0.0, spare / np.maximum(np.abs(forces), _LEAST))
        slack = np.minimum(slack, 1.0 / _LEAST)
        n = x.size
        fixed = greatest <= least  # unknowns without a choice follow their bounds
        matrix = np.block([[hessian + np.diag(under + over + _REGULAR), jacobian.T], [jacobian, -np.diag(slack)]])
        right = -np.concatenate([near.difference(gradients) - under * low - over * high, near.difference(values)])
        matrix[:n][fixed] = 0.0
        matrix[np.flatnonzero(fixed), np.flatnonzero(fixed)] = 1.0
        right[:n][fixed] = low[fixed]
        with warnings.catch_warnings():
            # Multipliers of limits that do not matter make the matrix look singular; the unknowns are unique.
            warnings.simplefilter("ignore", LinAlgWarning)
            try:
                solution = solve(matrix, right)
            except LinAlgError:
                solution = lstsq(matrix, right)[0]
        return np.asarray(solution[:n])

    def _envelope(self, near: Stencil, change: Array, low: Array, high: Array) -> float:
        """Change of the sum of tensions [N], where that is least."""
        attempt = self.attempt
        forces = self.attempt.multipliers.bounds
        slope = np.array(
            self.solver.nlp.slope(attempt.x, attempt.numbers, 1.0, attempt.multipliers.constraints)
        ).ravel()
        value = float(slope @ change - np.minimum(forces, 0.0) @ low - np.maximum(forces, 0.0) @ high)
        weight = float(near.difference([tension_weight(scene) for scene in near.scenes]))
        # The objective is the sum times a weight of the scene.
        return (value - self.quantities["tension"] * weight) / tension_weight(self.scene)


def _parts(scene: GraspScene, arrays: dict[str, Array]) -> tuple[Array, Array, Array]:
    """Tensions and normal forces [N], and friction margins of the contacts."""
    tensions = np.concatenate([arrays[f"{name}.tensions"] for name in scene.named_fingers])
    forces = arrays["contact_forces"]
    friction = np.array([scene.friction(str(name)) for name in arrays["contact_names"]])
    limits = np.maximum(friction * forces[:, 0], _LEAST)
    return tensions, forces[:, 0], 1.0 - np.hypot(forces[:, 1], forces[:, 2]) / limits


def moved_start(before: GraspScene, after: GraspScene, start: GraspStart) -> GraspStart:
    """A start of a scene in another one, whose fingers may have other lengths and whose object other dimensions."""
    fingers = {}
    for old, new in zip(before.setups, after.setups, strict=True):
        finger_start = start.fingers[old.name]
        share = new.finger.rod.length / old.finger.rod.length
        joints, knots = (tuple(share * at for at in places) for places in (finger_start.joints, finger_start.knots))
        fingers[old.name] = replace(finger_start, joints=joints, knots=knots)
    contacts = dict(start.contacts)
    if after.object.free is None:
        # Where a fixed object touches a support is no unknown but given.
        supports = {support.name for name in contacts if (support := after.support_of(name)) is not None}
        touched = support_contacts(after, after.object.pose, supports)
        contacts |= {name: touched[name] for name in contacts if name in touched}
    return replace(start, fingers=fingers, contacts=contacts)


def _finite(bounds: Array) -> Array:
    return np.where(np.isfinite(bounds), bounds, 0.0)


def with_mass(scene: GraspScene, mass: float) -> GraspScene:
    """The scene with an object of another mass [kg]."""
    return scene.model_copy(update={"object": scene.object.model_copy(update={"mass": mass})})
