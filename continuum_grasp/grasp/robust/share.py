"""Share of plants with usual errors that a grasp would hold with the tensions that it has.

The equations of the grasp problem, contacts touching and object and fingers in balance, are taken to first order in its
unknowns and in the errors. Friction coefficients are exact. What the equations leave open, forces that contacts share
and ways that fingers slide, is chosen so that the contact nearest to slipping is as far from it as can be, as in
`continuum_grasp.grasp.robust.response`, which solves each plant in full. Only slipping counts, and contacts that part
where the others do not hold: how a plant fares with other limits, of normal forces and clearance, is not asked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.arrays import Array
from continuum_grasp.errors import InputError
from continuum_grasp.grasp.problem.points import starting_point
from continuum_grasp.grasp.problem.values import (
    Units,
    contact_features,
    held_values,
    moved_features,
    problem_bounds,
    problem_values,
)
from continuum_grasp.grasp.quality.conic import FAR
from continuum_grasp.grasp.robust.errors import InError
from continuum_grasp.grasp.robust.response import HOLDS
from continuum_grasp.grasp.robust.result import ERRORS
from continuum_grasp.grasp.shape import ROUNDING
from continuum_grasp.grasp.starts.force import Loads
from continuum_grasp.grasp.starts.supports import evenly
from continuum_grasp.grasp.starts.values import start_from
from continuum_grasp.grasp.values import NEAR
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.grasp_options import Robust
from continuum_grasp.scene.objects.shapes import Freedom
from continuum_grasp.scene.supports import Wall

USUAL = {"place": 0.005, "friction": 0.2, "mass": 0.1, "stiffness": 0.1, "tension": 0.05}
"""Usual errors, each evenly to both sides [1]: the object's place along and across the first finger's base, per length
of the longest finger; friction coefficients, the object's mass, bending stiffness, and the tensions of each finger as
shares. Those of `Trials` of missions, but for friction, which is known to a fifth as a rule."""
MISSED = 1e-6
"""Equation that counts as satisfied to first order, in units of the problem: rounding leaves 1e-12."""
PLANTS = 128
"""Plants of the quasi-random sequence, each with eight signs of its errors: shares are good to 1 or 2 %."""
_EQUATIONS = (
    *("contact gap", "contact tangency", "contact on the surface", "contact normal"),
    *("finger equilibrium", "drive", "object ", "landing"),
)
"""First words of the constraints that stay equations in every plant."""
_LIMITS = ("contact direction", "contact within")
"""And of the limits beyond which a contact is another one: a finger's side in place of its tip, off a support."""


@dataclass(frozen=True)
class PlantShare:
    """Share of plants with usual errors that a grasp would hold.

    Attributes
    ----------
    share : float
        Of plants drawn evenly within the errors [1]; NaN where it was not computed.
    errors : dict of str to float
        Greatest errors to both sides by name: lengths [m], angle [rad], others as shares [1].
    why_not : str
        Why the share was not computed; empty where it was.
    unbalanced : tuple of str
        Errors that leave the contacts no balance, whatever their size, so that no plant holds.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> grasp = cg.optimize_grasp("configs/grasp/mug_arcs.yaml")  # least tension, so that a contact is about to slip
    >>> 0.4 < grasp.plants.share < 0.6, grasp.plants.errors["friction"]
    (True, 0.2)
    """

    share: float
    errors: Mapping[str, float]
    why_not: str = ""
    unbalanced: tuple[str, ...] = ()

    def __str__(self) -> str:
        if self.why_not:
            return f"what share of plants with usual errors would hold was not computed: {self.why_not}"
        units = {"place": ("mm", 1e3), "angle": ("deg", float(np.degrees(1.0)))}
        each = ((name, value, *units.get(name, ("%", 100.0))) for name, value in self.errors.items())
        words = (f"{name} \N{PLUS-MINUS SIGN}{scale * value:.2g} {unit}" for name, value, unit, scale in each)
        why = f": with an error of {' or '.join(self.unbalanced)} its contacts cannot all stay and balance it"
        return (
            f"{self.share:.0%} of plants with usual errors would hold ({', '.join(words)})"
            f"{why if self.unbalanced else ''}"
        )

    def data(self) -> dict[str, Any]:
        """The share as plain data."""
        return {"share": None if self.why_not else self.share, "errors": dict(self.errors), "why_not": self.why_not}


def plant_share(scene: GraspScene, arrays: Mapping[str, Any]) -> PlantShare:
    """The share of plants that a grasp would hold; ``arrays`` are its numbers as a result holds them.

    Errors of the object are those of ``robust`` where the scene has it, others usual ones.
    """
    length = max(setup.finger.rod.length for setup in scene.setups)
    usual = Robust(position=USUAL["place"] * length, friction=USUAL["friction"], mass=USUAL["mass"])
    bounds = scene.robust or usual
    errors = {"friction": bounds.friction, "mass": bounds.mass, "place": bounds.position, "angle": bounds.angle}
    errors |= {"size": bounds.radius, "stiffness": USUAL["stiffness"], "tension": USUAL["tension"]}
    errors = {name: value for name, value in errors.items() if value}
    sides = np.diag([*bounds.bounds, USUAL["stiffness"], *[USUAL["tension"]] * len(scene.setups)])
    if scene.robust is None:  # along and across a finger, whichever way the scene lies
        turn = scene.setups[0].finger.base.angle
        c, s = np.cos(turn), np.sin(turn)
        sides[:2, :2] = bounds.position * np.array([[c, s], [-s, c]])
    try:
        plants = _Plants(scene, arrays, sides)
    except InputError as error:
        return PlantShare(float("nan"), errors, str(error))
    held = plants.reserves(drawn_evenly(len(sides))) >= HOLDS
    names = ["place", "place", "angle", "size", "friction", "mass", "stiffness", *["tension"] * len(scene.setups)]
    unbalanced = [] if held.any() else [name for name, is_so in zip(names, plants.unbalanced, strict=True) if is_so]
    return PlantShare(float(held.mean()), errors, unbalanced=tuple(dict.fromkeys(unbalanced)))


def drawn_evenly(count: int) -> Array:
    """Points (8 PLANTS, count) of the cube from -1 to 1, evenly, with both signs of the first two columns, and with
    their product that of the third, so that a mirrored scene has mirrored errors; and both signs of all others.
    """
    signs = np.ones((8, count))
    signs[:, :3] = [[1, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1]] * 2
    signs[4:, 3:] = -1.0
    points: Array = signs[:, None] * (2.0 * np.array(evenly(count, PLANTS)) - 1.0)
    return points.reshape(-1, count)


@dataclass(frozen=True)
class _Linear:
    """Plants to first order with some contacts open: by errors and 1 (E + 1,), and by K ways that equations leave."""

    touching: list[str]  # contacts that are not open
    missed: Array  # (M, E + 1) what errors leave of the equations, whatever follows
    spare: tuple[Array, Array]  # (L, E + 1), (L, K) of limits and gaps
    forces: tuple[Array, Array]  # (C, F, E + 1), (C, F, K)


class _Plants:
    """Contact forces of all plants, to first order: those of the grasp, and ways in which they may change.

    In a plant a contact touches, or it is open by a gap that follows and others hold the object.

    ``sides`` (E, E) has an error of the object, of the stiffness and of each finger's tensions per row, to one side.
    `InputError` says why there is nothing to compute.
    """

    def __init__(self, scene: GraspScene, arrays: Mapping[str, Any], sides: Array) -> None:
        if any(len(arrays[f"{setup.name}.lengths"]) != setup.elements for setup in scene.setups):
            raise InputError("the fingers have other elements than those of the scene")
        self.start = start_from(scene, dict(arrays))
        if not self.start.contacts:
            raise InputError("nothing touches the object")
        least = NEAR * (scene.weight or Units.of(scene).force)
        idle = [name for name, (n, *_) in self.start.forces.items() if n < least]
        if scene.object.free is None and any(scene.support_of(name) is not None for name in idle):
            # What leaves a support moves the object.
            around = ((value - 1.0, value + 1.0) for value in self.start.object_pose)
            free = Freedom(**dict(zip(ERRORS, around, strict=False)))
            scene = scene.model_copy(update={"object": scene.object.model_copy(update={"free": free})})
        self.scene, self.arrays, self.sides = scene, arrays, sides
        self.in_error = InError(scene, arrays)
        self.features = contact_features(scene, self.start.contacts)
        self.solver = self.in_error.solver(self.start.contacts)
        self._known: dict[bytes, tuple[Array, Array]] = {}
        x, numbers = self._point(np.zeros(len(sides)))
        # Central differences over the whole errors: slopes between their ends, not at the grasp.
        ends = [(self._point(side), self._point(-side)) for side in sides]
        self._moved = 0.5 * np.array([more[0] - less[0] for more, less in ends]).T
        self._broken = 0.5 * np.array([self._rows(*more) - self._rows(*less) for more, less in ends]).T
        self._slopes = np.array(self.solver.nlp.functions["jac_g"](x, numbers)[1])
        # Open may be all contacts that bear nothing in the grasp, and each one of a finger.
        subsets = chain.from_iterable(combinations(idle, count) for count in range(len(idle) + 1))
        singles = ((name,) for name in self.start.contacts if scene.support_of(name) is None)
        sets = dict.fromkeys([*subsets, *singles])
        self._open_sets = [some for some in sets if len(some) < len(self.start.contacts)]
        self._touching = self._with_open((), x, numbers)
        self.unbalanced = np.abs(self._touching.missed[:, :-1]).max(axis=0, initial=0.0) > MISSED
        """Errors (E,) with which the contacts of the grasp cannot all touch and balance the object."""

    def _with_open(self, some: Sequence[str], x: Array, numbers: Array) -> _Linear:
        """The plants in which some contacts are open."""
        at, stored = self.solver.problem.x.at, [str(name) for name in self.arrays["contact_names"]]
        equations, limits, gaps = list[int](), list[int](), np.zeros((len(self._slopes), len(some)))
        for block in self.solver.problem.rows.blocks:
            rows, (kind, _, name) = block.rows.ravel().tolist(), block.name.partition(", ")
            if name in some and kind == "contact gap":
                support, normal = self.scene.support_of(name), self.arrays["contact_normals"][stored.index(name)]
                outwards = normal if support is None else [-1.0, 1.0] if isinstance(support, Wall) else -normal
                gaps[rows, some.index(name)] = outwards
            if name not in some or not kind.startswith((*_LIMITS, "landing")):
                equations += rows if kind.startswith(_EQUATIONS) else []
                limits += rows if kind.startswith(_LIMITS) else []
        forces = x.copy()
        for name in some:
            forces[at[f"force, {name}"]] = 0.0
        columns = self._open(x, some)
        broken = np.column_stack([self._broken, self._slopes @ (forces - x)])
        slopes = np.concatenate([self._slopes[:, columns], -gaps], axis=1)
        unknown, known = slopes[equations], broken[equations]
        # What changes least of all that satisfies the equations, and the ways that they leave.
        left, values, right = np.linalg.svd(unknown)
        rank = int((values > ROUNDING * values[0]).sum())
        answer, ways = -right[:rank].T @ (left[:, :rank].T @ known / values[:rank, None]), right[rank:].T
        spare = broken[limits] + slopes[limits] @ answer
        spare[:, -1] += self._rows(x, numbers)[limits]
        moved, moves = np.column_stack([self._moved, forces]), np.zeros((x.size, ways.shape[1]))
        moved[columns] += answer[: columns.size]
        moves[columns] = ways[: columns.size]
        touching = [contact.name for contact in self.solver.problem.spec.contacts if contact.name not in some]
        by_error, by_way = (np.array([v[at[f"force, {name}"]] for name in touching]) for v in (moved, moves))
        opened = np.vstack([spare, answer[columns.size :]]), np.vstack([slopes[limits] @ ways, ways[columns.size :]])
        return _Linear(touching, unknown @ answer + known, opened, (by_error, by_way))

    def reserves(self, points: Array) -> Array:
        """By how much all cones could be narrower in plants (D,) of errors (D, E) from -1 to 1, per force reference;
        negative where a contact slips, would be beyond its tip, or is open where the others do not hold.
        """
        found, (x, numbers) = np.full(len(points), -np.inf), self._point(np.zeros(len(self.sides)))
        points = np.column_stack([points, np.ones(len(points))])
        for some in self._open_sets:
            left = np.flatnonzero(found < HOLDS)
            if left.size:
                linear = self._with_open(some, x, numbers) if some else self._touching
                left = left[np.abs(points[left] @ linear.missed.T).max(axis=1, initial=0.0) <= MISSED]
                found[left] = np.maximum(found[left], self._reserves(linear, points[left]))
        return found

    def _reserves(self, linear: _Linear, points: Array) -> Array:
        friction = np.array([self.scene.friction(name) for name in linear.touching])
        slippery = np.outer(1.0 + points[:, :-1] @ self.sides[:, ERRORS.index("friction")], friction)
        (spare, spare_by_way), (by_error, by_way) = linear.spare, linear.forces
        forces = np.einsum("cfe,de->dcf", by_error, points)
        # Tangent planes stand for a spatial cone, beside that at the force of the grasp: 0.9 % wider.
        turns = 2.0 * np.pi * np.arange(Loads.directions) / Loads.directions
        around = np.stack([np.cos(turns), np.sin(turns)], axis=1) if forces.shape[2] == 3 else np.array([[1.0], [-1.0]])
        rows, limits = [np.tile(-spare_by_way, (len(points), 1, 1))], [points @ spare.T]
        for k, (_, *sideways) in enumerate(by_error[:, :, -1]):
            # Friction times normal force, less the force along each direction; and what presses.
            direction = np.array(sideways) / max(float(np.linalg.norm(sideways)), 1e-300)
            cone = np.zeros((len(points), len(around) + 2, forces.shape[2]))
            cone[:, :-1, 0], cone[:, -1, 0] = slippery[:, k, None], 1.0
            cone[:, :-1, 1:] = -np.vstack([around, direction])
            rows.append((-cone.reshape(-1, cone.shape[2]) @ by_way[k]).reshape(*cone.shape[:2], by_way.shape[2]))
            limits.append(np.einsum("drf,df->dr", cone, forces[:, k]))
        matrix = np.concatenate(rows, axis=1)
        matrix = np.concatenate([matrix, np.ones((*matrix.shape[:2], 1))], axis=2)
        unit = Units.of(self.scene).force
        return greatest_last(matrix, np.concatenate(limits, axis=1)) / max(self.scene.weight / unit, 1.0)

    def _point(self, error: Array) -> tuple[Array, Array]:
        """Unknowns of the grasp with an error (E,), and the numbers of the problem there."""
        of_object, stiffness, tensions = error[: len(ERRORS)].copy(), error[len(ERRORS)], error[len(ERRORS) + 1 :]
        # Stiffer fingers bend as those with less of all other forces; friction is part of the cones alone.
        softer, heavier = 1.0 / (1.0 + stiffness), 1.0 + of_object[ERRORS.index("mass")]
        of_object[ERRORS.index("friction") :] = 0.0
        x, numbers = (values.copy() for values in self._placed(of_object))
        at = self.solver.problem.numbers.at
        for name in ("weight", *(f"{setup.name}.weight" for setup in self.scene.setups)):
            if name in at:
                numbers[at[name]] *= softer * (heavier if name == "weight" else 1.0)
        for setup, off in zip(self.scene.setups, tensions, strict=True):
            pull, command = (f"{setup.name}.{key}" for key in ("pulls", "command"))
            x[self.solver.problem.x.at[pull]] *= softer * (1.0 + off)
            if command in self.solver.problem.x.at:
                key = f"{setup.name}.tensions"
                arrays = {**self.arrays, key: softer * (1.0 + off) * np.asarray(self.arrays[key])}
                x[self.solver.problem.x.at[command]] = held_values(setup, arrays)
        return x, numbers

    def _placed(self, error: Array) -> tuple[Array, Array]:
        """Unknowns and numbers with an error of pose and size alone."""
        key = error.tobytes()
        if key not in self._known:
            problem, scene, start, features = self.solver.problem, self.scene, self.start, self.features
            if error.any():
                scene, start = self.in_error.plant(start, error)
                features = moved_features(self.scene, scene, start.contacts, features)
            numbers = problem.numbers.pack(problem_values(problem, scene, start, features), 0.0)
            x = starting_point(problem, scene, start, features)
            for name, place in self.in_error.landings(problem.spec, self.start, error).items():
                x[problem.x.at[name]] = place
            for setup, finger in zip(scene.setups, problem.fingers, strict=True):
                if not setup.graded:  # starts have steps of the curvature rounded off
                    size = finger.family.coordinate_size(1.0, setup.finger.rod.length)
                    x[problem.x.at[f"{setup.name}.q"]] = self.arrays[f"{setup.name}.q"] / size
            for name, forces in start.forces.items():  # starts press a little everywhere
                at = problem.x.at[f"force, {name}"]
                x[at] = np.array(forces)[: x[at].size] / Units.of(self.scene).force
            self._known[key] = x, numbers
        return self._known[key]

    def _rows(self, x: Array, numbers: Array) -> Array:
        return np.asarray(np.array(self.solver.nlp.functions["jac_g"](x, numbers)[0]).ravel())

    def _open(self, x: Array, some: Sequence[str]) -> NDArray[np.int64]:
        """Indices of the unknowns that follow from the errors: forces, but of open contacts, places, shapes; of drives
        the tensions, and what supports decide of the object's pose, or all of it where it yields.
        """
        problem = self.solver.problem
        low, high = problem_bounds(problem, self.scene, self.features)
        without = [f"force, {name}" for name in some]
        names = [name for name in problem.x.at if name.startswith(("force, ", "place, ")) and name not in without]
        for setup in self.scene.setups:
            keys = ("q", *(f"joint_{k}" for k in range(len(setup.middles))))
            keys += () if setup.drive is None else ("pulls", "wound")
            names += [name for key in keys if (name := f"{setup.name}.{key}") in problem.x.at]
        every = np.concatenate([np.arange(x.size)[problem.x.at[name]] for name in names])
        indices = [every[low[every] < high[every]]]
        if problem.spec.free:
            follows = [k for k in range(3) if self.in_error.yields or k not in self.in_error.left]
            indices.append(np.arange(x.size)[problem.x.at["object pose"]][follows])
        return np.concatenate(indices)


def greatest_last(rows: Array, limits: Array) -> Array:
    """The greatest last unknown (D,) of D linear problems ``rows @ x <= limits``, (D, M, K) and (D, M), all at once by
    the dual simplex method; the unknowns before it stay within a box.
    """
    count, _, size = rows.shape
    box = np.concatenate([np.eye(size), -np.eye(size)])
    rows = np.concatenate([np.tile(box, (count, 1, 1)), rows], axis=1)
    limits = np.concatenate([np.full((count, 2 * size), FAR), limits], axis=1)
    # A little of the other unknowns makes optima corners, and multipliers positive.
    aim = np.append(1e-7 * np.sqrt(np.arange(1.0, size)), 1.0)
    active, each = np.tile(np.arange(size), (count, 1)), np.arange(count)
    x = np.zeros((count, size))
    for _ in range(rows.shape[1]):  # exchanges of active constraints, of which ten are usual
        inverse = np.linalg.inv(rows[each[:, None], active])
        x = np.einsum("dij,dj->di", inverse, limits[each[:, None], active])
        over = np.einsum("dmi,di->dm", rows, x) - limits
        worst = over.argmax(axis=1)
        still = np.flatnonzero(over[each, worst] > 1e-9)
        if not still.size:
            break
        force = np.einsum("i,dij->dj", aim, inverse[still])
        entering = np.einsum("di,dij->dj", rows[still, worst[still]], inverse[still])
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(entering > 1e-12, np.maximum(force, 0.0) / entering, np.inf)
        active[still, ratio.argmin(axis=1)] = worst[still]
    return x[:, -1]
