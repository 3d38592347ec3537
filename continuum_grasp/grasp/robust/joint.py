"""One grasp for several errors and friction states at once: the nominal problem and, beside it, one for each of them.

Every error has unknowns of its own, posture, places and forces, and all limits of a grasp; its friction cones come
from its scene, without reserve. All errors share the tensions or commands, the bases and, where it is sought, the
object's pose. With x the unknowns of the nominal grasp and x_k, e_k the unknowns of error k and the error itself:

    minimize  objective(x)   subject to   limits(x),  limits(x_k),  link(x, x_k, e_k) = 0 for all k

``link`` is linear in x_k, so that the Hessian of the Lagrangian has one block for x and one for each x_k. Where an
error does not act, the forces on what both share are zero, so that the change of the optimum with a number of the scene
does not depend on it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache, partial

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array
from continuum_grasp.grasp.problem.blocks import rotation
from continuum_grasp.grasp.problem.points import starting_point
from continuum_grasp.grasp.problem.problem import GraspProblem
from continuum_grasp.grasp.problem.solver_run import (
    OPTION_SETS,
    GraspAttempt,
    GraspSolverRun,
    allowed_depth,
    settings_of,
    solve_clear,
)
from continuum_grasp.grasp.problem.values import Units, contact_features, moved_features, problem_values
from continuum_grasp.grasp.robust.errors import InError
from continuum_grasp.grasp.starts.values import ContactStart, GraspStart, with_contacts
from continuum_grasp.grasp.values import SAME
from continuum_grasp.model import Feature
from continuum_grasp.nlp import NLP, Budget, Start
from continuum_grasp.scene import GraspScene

_Side = tuple[GraspScene, GraspStart, dict[str, Feature]]

_EFFORT = 1e-6
"""Weight of a term that makes postures in error unique, beside the aim [1]: at 1, tensions that locked drives change
with friction would take 3e-4 of the derivatives (mug with servo motors)."""


def _link_functions(
    nominal: GraspProblem, other: GraspProblem, left: tuple[int, ...]
) -> tuple[ca.Function, ca.Function]:
    """Functions of what an error's problem shares with the nominal one: values, and second derivatives by forces."""
    error = ca.SX.sym("error", 3)
    args = [ca.SX.sym("x", nominal.x.size), ca.SX.sym("p", nominal.numbers.size), ca.SX.sym("x_k", other.x.size), error]
    rows = link(nominal, other, left, *args)
    force = ca.SX.sym("force", rows.numel())
    bend = ca.triu(ca.hessian(ca.dot(force, rows), args[0])[0])
    return ca.Function("link", args, [rows]), ca.Function("bends", [*args[:2], error, force], [bend])


def link(
    nominal: GraspProblem, other: GraspProblem, left: tuple[int, ...], x: ca.SX, p: ca.SX, its: ca.SX, error: ca.SX
) -> ca.SX:
    """Unknowns that an error's problem shares with the nominal one, at ``its`` unknowns and those and the numbers of
    that; ``error`` (3,) is by how much its object's pose is off where it lies, in units of the problem, and ``left``
    are the coordinates that the supports leave.
    """
    rows = []

    def same(name: str) -> ca.SX:
        return its[other.x.at[name]] - x[nominal.x.at[name]]

    for finger in nominal.spec.fingers:
        rows.append(same(f"{finger.name}.{finger.held}"))
        if finger.free:
            rows.append(same(f"{finger.name}.base"))
    if nominal.spec.free and not other.spec.yielding:
        rows += [same("object pose")[k] - error[k] for k in left]
    on = {contact.name for contact in other.spec.contacts}
    pose = x[nominal.x.at["object pose"]] if nominal.spec.free else p[nominal.numbers.at["object pose"]]
    for placed, finger in zip(nominal.fingers, other.spec.fingers, strict=True):
        *_, local = placed.part.touched(x[placed.unknowns.tolist()], p[placed.numbers.tolist()])
        for k, name in enumerate(placed.names[1:]):
            if name in on and other.spec.yielding and finger.lands:
                shifted = local[:, k] - rotation(-pose[2]) @ error[:2]
                rows.append(its[other.x.at[f"landing, {name}"]] - rotation(-error[2]) @ shifted)
    return ca.vertcat(*rows)


@lru_cache(maxsize=8)
def robust_problem(
    nominal: GraspSolverRun, others: tuple[GraspSolverRun, ...], left: tuple[int, ...]
) -> tuple[NLP, list[int]]:
    """The problem of a grasp and of errors, whose postures may have other contacts, and the number of rows that
    link each of them to the grasp; built once in a process.

    The unknowns belong to the nominal problem and to each error, one below the other; its parameters are their numbers
    likewise, and the errors (3,) of the pose.
    """
    parts = [nominal, *others]
    count = len(others)
    sizes = [part.problem.x.size for part in parts]
    numbers = [part.problem.numbers.size for part in parts]
    x = ca.MX.sym("x", sum(sizes))
    p = ca.MX.sym("p", sum(numbers) + 3 * count)
    xs = ca.vertsplit(x, _starts(sizes))
    ps = ca.vertsplit(p, _starts([*numbers, *[3] * count]))
    ps, errors = ps[: count + 1], ps[count + 1 :]
    made = {solver: _link_functions(nominal.problem, solver.problem, left) for solver in dict.fromkeys(others)}
    links = [made[other] for other in others]

    values = [part.nlp.values(a, b) for part, a, b in zip(parts, xs, ps, strict=True)]
    linked = [value(xs[0], ps[0], a, e) for (value, _), a, e in zip(links, xs[1:], errors, strict=True)]
    f = sum(value[0] for value in values)
    g = ca.vertcat(*(value[1] for value in values), *linked)
    rows_linked = [int(each.numel()) for each in linked]

    # Of the parts, whose blocks CasADi would not see as soon.
    slopes = [part.nlp.functions["grad_f"](a, b)[1] for part, a, b in zip(parts, xs, ps, strict=True)]
    gradient = ca.Function("nlp_grad_f", [x, p], [f, ca.vertcat(*slopes)], ["x", "p"], ["f", "grad_f_x"])
    jacobians = [part.nlp.functions["jac_g"](a, b)[1] for part, a, b in zip(parts, xs, ps, strict=True)]
    rows = ca.vertcat(ca.diagcat(*jacobians), ca.jacobian(ca.vertcat(*linked), x))
    jacobian = ca.Function("nlp_jac_g", [x, p], [g, rows], ["x", "p"], ["g", "jac_g_x"])
    weight = ca.MX.sym("weight")
    forces = ca.MX.sym("forces", g.numel())
    shares = ca.vertsplit(forces, _starts([*(part.problem.rows.count for part in parts), *rows_linked]))
    each = list(zip(parts, xs, ps, shares, strict=False))
    blocks = [part.nlp.functions["hess_lag"](a, b, weight, multipliers) for part, a, b, multipliers in each]
    own_forces = zip(links, errors, shares[count + 1 :], strict=True)
    blocks[0] += sum(bend(xs[0], ps[0], e, multipliers) for (_, bend), e, multipliers in own_forces)
    names = ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
    hessian = ca.Function("nlp_hess_l", [x, p, weight, forces], [ca.triu(ca.diagcat(*blocks))], *names)
    along = [part.nlp.slope(a, b, weight, multipliers) for part, a, b, multipliers in each]
    pull = ca.gradient(ca.dot(ca.vertcat(*shares[count + 1 :]), ca.vertcat(*linked)), p)
    by_numbers = ca.vertcat(*along, ca.MX.zeros(3 * count)) + pull
    slope = ca.Function("nlp_slope", [x, p, weight, forces], [by_numbers], names[0], ["grad_gamma_p"])
    derivatives = {"grad_f": gradient, "jac_g": jacobian, "hess_lag": hessian, "slope": slope}
    return NLP("robust_grasp", x, f, g, p, derivatives=derivatives), rows_linked


def _starts(sizes: Sequence[int]) -> list[int]:
    return [0, *np.cumsum(sizes).tolist()]


class JointSolverRun:
    """Solver runs on a grasp and its postures in error; of the form of `GraspSolverRun`, whose unknowns, numbers and
    constraints come first.

    Grasps are sought next to a start, which decides which contacts are on; ``errors`` (K, 6 + S) are rows of
    `continuum_grasp.grasp.robust.errors`, and ``touching`` (K) says which contacts are on in the posture of each, and
    where on the object they are; None: as at the start.
    """

    def __init__(
        self,
        scene: GraspScene,
        start: GraspStart,
        errors: Array,
        touching: Sequence[Mapping[str, ContactStart]] | None = None,
    ) -> None:
        in_error = _in_error(scene, start)
        self.errors = errors
        self.touching = [start.contacts] * len(errors) if touching is None else list(touching)
        self.nominal: GraspSolverRun = GraspSolverRun.of(scene, start.contacts)
        others = tuple(in_error.solver(on) for on in self.touching)
        self._solvers = [self.nominal, *others]
        self.nlp, self._links = robust_problem(self.nominal, others, in_error.left)

    @property
    def problem(self) -> GraspProblem:
        return self.nominal.problem

    def run(
        self,
        scene: GraspScene,
        start: GraspStart,
        budget: Budget,
        *,
        x0: Array | None = None,
        features: dict[str, Feature] | None = None,
    ) -> GraspAttempt:
        """Solve from unknowns ``x0`` with contacts on ``features``, by default the start's, moving the guarded
        places.
        """
        features = features or contact_features(scene, start.contacts)
        problems = [solver.problem for solver in self._solvers]
        sides = self._sides(scene, start, features)
        offsets = self._offsets(scene, start)
        values = [problem_values(problem, *side) for problem, side in zip(problems, sides, strict=True)]
        for error_values in values[1:]:
            error_values["effort weight"] = _EFFORT
        low, high = self.bounds(scene, start, features)

        def look(x: Array, numbers: Array) -> tuple[float, Array]:
            parts = zip(self._solvers, sides, self._xs(x), self._ps(numbers), strict=True)
            depths, seen = zip(*(solver.near.look(side[0], part, p) for solver, side, part, p in parts), strict=True)
            near = [known | more for known, more in zip(values, seen, strict=True)]
            packed = [problem.numbers.pack(each) for problem, each in zip(problems, near, strict=True)]
            return max(depths), np.concatenate([*packed, offsets])

        packed = [problem.numbers.pack(each, 0.0) for problem, each in zip(problems, values, strict=True)]
        x0 = np.concatenate(self.starting_points(scene, start, features)) if x0 is None else x0
        x = np.clip(x0, low, high)
        begin = Start(x, low, high, *self.row_bounds, look(x, np.concatenate([*packed, offsets]))[1])
        solve = partial(settings_of(scene).solver().solve, self.nlp)
        last, numbers = solve_clear(solve, self.nlp, begin, look, allowed_depth(scene), budget, OPTION_SETS[-1][1])
        return GraspAttempt(**vars(last), start=start, features=features, numbers=numbers, violations=[])

    def starting_points(self, scene: GraspScene, start: GraspStart, features: dict[str, Feature]) -> list[Array]:
        """First unknowns of the nominal grasp and of each error."""
        sides = self._sides(scene, start, features)
        return [starting_point(solver.problem, *side) for solver, side in zip(self._solvers, sides, strict=True)]

    def bounds(self, scene: GraspScene, start: GraspStart, features: dict[str, Feature]) -> tuple[Array, Array]:
        # Linked unknowns need no bounds of their own.
        linked = [f"{setup.name}.base" for setup in scene.setups if setup.finger.base_free is not None]
        linked += ["object pose"] * (scene.object.free is not None)
        lows, highs = [], []
        for k, (solver, side) in enumerate(zip(self._solvers, self._sides(scene, start, features), strict=True)):
            low, high = solver.bounds(*side)
            if k:
                at = solver.problem.x.at
                low[at["reserve"]] = high[at["reserve"]] = 0.0
                for name in linked:
                    low[at[name]], high[at[name]] = -np.inf, np.inf
            lows.append(low)
            highs.append(high)
        return np.concatenate(lows), np.concatenate(highs)

    @cached_property
    def row_bounds(self) -> tuple[Array, Array]:
        linked = np.zeros(sum(self._links))
        sets = [*(solver.row_bounds for solver in self._solvers), (linked, linked)]
        lower, upper = (np.concatenate(side) for side in zip(*sets, strict=True))
        return lower, upper

    @property
    def guarded(self) -> NDArray[np.int64]:
        """Indices of the constraints of guarded places (n,)."""
        counts = [solver.problem.rows.count for solver in self._solvers]
        starts = np.cumsum([0, *counts[:-1]])
        guarded = [start + solver.guarded for start, solver in zip(starts, self._solvers, strict=True)]
        return np.asarray(np.concatenate(guarded))

    def arrays(self, scene: GraspScene, attempt: GraspAttempt) -> dict[str, Array]:
        """The physical numbers of the nominal grasp."""
        return self.nominal.arrays(scene, self._part(attempt, 0))

    def numbers_near(
        self, scene: GraspScene, attempt: GraspAttempt, start: GraspStart, features: dict[str, Feature]
    ) -> Array:
        """Run-time numbers of a scene of the same structure at the unknowns of an attempt."""
        sides = self._sides(scene, start, features)
        numbers = [
            solver.numbers_near(each, self._part(attempt, k), begin, sits)
            for k, (solver, (each, begin, sits)) in enumerate(zip(self._solvers, sides, strict=True))
        ]
        return np.concatenate([*numbers, self._offsets(scene, start)])

    def acting(self, attempt: GraspAttempt) -> Array:
        """The errors (A, 6 + S) that decide the optimum: those with forces on what all postures share, as parts of
        the greatest.
        """
        links = attempt.multipliers.constraints[sum(solver.problem.rows.count for solver in self._solvers) :]
        each = np.split(links, np.cumsum(self._links)[:-1]) if links.size else []
        forces = np.array([np.abs(multipliers).max() for multipliers in each])
        acting: Array = self.errors[forces > SAME * forces.max(initial=0.0)]
        return acting

    def _part(self, attempt: GraspAttempt, k: int) -> GraspAttempt:
        return replace(attempt, x=self._xs(attempt.x)[k], numbers=self._ps(attempt.numbers)[k])

    def _xs(self, x: Array) -> list[Array]:
        return np.split(x, np.cumsum([solver.problem.x.size for solver in self._solvers])[:-1])

    def _ps(self, numbers: Array) -> list[Array]:
        ends = np.cumsum([solver.problem.numbers.size for solver in self._solvers])
        return np.split(numbers, ends)[:-1]

    def _offsets(self, scene: GraspScene, start: GraspStart) -> Array:
        """By how much the object's pose is off in each error, in units of the problem (3 K,)."""
        in_error = _in_error(scene, start)
        units = Units.of(scene)
        moved = (np.array(in_error.pose_in_error(error)) - in_error.pose for error in self.errors)
        return np.concatenate([np.zeros(0), *(np.array(units.pose(pose.tolist())) for pose in moved)])

    def _sides(self, scene: GraspScene, start: GraspStart, features: dict[str, Feature]) -> list[_Side]:
        """Scene, start and features of the nominal grasp and of each error."""
        in_error = _in_error(scene, start)
        sides = [(scene, start, features)]
        for error, on in zip(self.errors, self.touching, strict=True):
            whole, sits = start, features
            if on.keys() != start.contacts.keys():
                whole = with_contacts(scene, start, {name: start.contacts.get(name, at) for name, at in on.items()})
                usual = contact_features(scene, whole.contacts)
                sits = {name: features.get(name, feature) for name, feature in usual.items()}
            each, begin = in_error.plant(whole, error)
            sides.append((each, begin, moved_features(scene, each, whole.contacts, sits)))
        return sides


def _in_error(scene: GraspScene, start: GraspStart) -> InError:
    return InError(scene, {"contact_names": list(start.contacts), "object.pose": start.object_pose})
