"""Cost and limits of a design with their derivatives, over all cases and over errors of manufacture."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import nnls

from continuum_grasp.addons.design.grasps import CaseGrasps, Effort, LostGrasp, fingers_mass
from continuum_grasp.addons.design.scene import names_in
from continuum_grasp.addons.design.space import DesignSpace
from continuum_grasp.base import Array, InputError
from continuum_grasp.grasp import GraspResult, Stencil, StructureChanges
from continuum_grasp.scene import GraspScene

_FUNCTIONS = {"sqrt": ca.sqrt, "exp": ca.exp, "log": ca.log}


class Expression:
    """A formula of named quantities."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.names = tuple(sorted(names_in(text)))
        symbols = {name: ca.SX.sym(name) for name in self.names}
        tree = ast.parse(text.strip(), mode="eval")
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant):  # powers of integers may have any number of digits
                node.value = float(str(node.value))
        # The scene has refused all but numbers, names, sums, products, powers and these functions.
        formula = ca.SX(eval(compile(tree, text, "eval"), {"__builtins__": {}}, {**_FUNCTIONS, **symbols}))
        column = ca.vertcat(*symbols.values())
        self._read = ca.Function("expression", [column], [formula, ca.gradient(formula, column)])

    def value(self, quantities: Mapping[str, float]) -> float:
        return float(self._read([quantities[name] for name in self.names])[0])

    def gradient(self, quantities: Mapping[str, float], slopes: Mapping[str, Array]) -> Array:
        """Derivatives (n,) by the derivatives of the quantities, ``slopes``, (n,) each."""
        parts = np.array(self._read([quantities[name] for name in self.names])[1]).ravel()
        total: Array = np.sum([part * slopes[name] for part, name in zip(parts, self.names, strict=True)], axis=0)
        return total


Signs = tuple[float, ...]
"""Errors of the tolerated numbers, as parts of the greatest error, -1 to 1."""

_ACTIVE = 1e-4
"""Distance from a limit, and of a case's cost from the worst, as a part of it, from which on it acts [1]."""
HOLDS = 1e-6
"""Violation up to which a limit holds, as a part of it, and distance of a coordinate from its bound at which it counts
as there [1]."""


@dataclass(frozen=True)
class CaseValues:
    """Quantities of one case at one design with its errors.

    Attributes
    ----------
    quantities : dict of str to float
        SI.
    slopes : dict of str to ndarray, shape (n + m,)
        Their change per coordinate of each variable, then per share of each tolerated error.
    acting : tuple of tuple of float
        Errors and friction states that decide a grasp which must hold for many, as rows (x, y [m], angle [rad], size,
        friction, mass, friction states [1]); the cost has a kink where others do.
    """

    case: str
    signs: Signs
    quantities: dict[str, float]
    slopes: dict[str, Array]
    acting: tuple[tuple[float, ...], ...] = ()


@dataclass(frozen=True)
class DesignNumber:
    """A number in the optimization: value and derivatives (n + m,), of limits as parts of ``size``."""

    name: str
    case: str
    signs: Signs
    value: float
    slope: Array
    size: float = 1.0


@dataclass(frozen=True)
class Evaluation:
    """A design: its cost and limits.

    Attributes
    ----------
    coordinates : (n,) ndarray
        From 0 to 1 per variable.
    costs : tuple of Row
        One per combination of errors.
    limits : tuple of Row
        Not negative where a limit holds; as parts of the limit.
    cases : tuple of CaseValues
    """

    coordinates: Array
    costs: tuple[DesignNumber, ...]
    limits: tuple[DesignNumber, ...]
    cases: tuple[CaseValues, ...]

    @property
    def worst(self) -> DesignNumber:
        """The greatest cost."""
        return max(self.costs, key=lambda row: row.value)

    @property
    def cost(self) -> float:
        """Cost to be minimized."""
        return self.worst.value

    @cached_property
    def slope(self) -> Array:
        """Change of the least cost (n + m,), other variables staying at their optimum, within their bounds.

        Where several cases are worst at once, or limits act, it is the gradient of the design's Lagrangian, with the
        multipliers that leave least of it along variables within their bounds; away from an optimum it is the gradient
        in the worst case.
        """
        u = self.coordinates
        near = _ACTIVE * max(abs(self.cost), 1e-9)
        costs = [row for row in self.costs if row.value >= self.cost - near]
        limits = [row for row in self.limits if row.value < _ACTIVE]
        columns = np.array([row.slope for row in costs] + [-row.slope for row in limits]).T
        n = u.size
        # At a bound, the cost may grow into the region.
        walls = np.diag(np.where(u < HOLDS, -1.0, np.where(u > 1.0 - HOLDS, 1.0, 0.0)))
        weight = 1e3 * max(float(np.abs(columns[:n]).max(initial=0.0)), 1e-9)
        total = weight * np.array([1.0] * len(costs) + [0.0] * (len(limits) + n))
        shares = nnls(np.vstack([np.hstack([columns[:n], walls]), total]), np.append(np.zeros(n), weight))[0]
        slope: Array = columns @ shares[: columns.shape[1]]
        return slope

    @property
    def left(self) -> float:
        """Greatest slope of the least cost along a variable between its bounds."""
        u = self.coordinates
        between = (u > HOLDS) & (u < 1.0 - HOLDS)
        return float(np.abs(self.slope[: u.size][between]).max(initial=0.0))

    @property
    def violation(self) -> float:
        """Greatest violation of a limit, as a part of it."""
        return max((-row.value for row in self.limits), default=0.0)


@dataclass
class DesignProblem:
    """A design whose grasps are at hand: from one design to the next they are followed, not searched."""

    space: DesignSpace
    effort: Effort = field(default_factory=Effort)

    def __post_init__(self) -> None:
        design = self.space.design
        self.expressions = {text: Expression(text) for text in design.expressions}
        used = design.used
        aims = (("objective",) if used & {"tension", "tension_max", "normal_force_max", "friction_margin"} else ()) + (
            ("payload",) if "payload" in used else ()
        )
        # A cost that no grasp enters, such as a mass, still needs a finger that holds the object.
        self.wanted: tuple[str, ...] = aims or ("objective",)
        self.scenarios: list[Signs] = [(0.0,) * len(self.space.tolerated)]
        self._grasps: dict[tuple[Signs, str], CaseGrasps] = {}
        self._at: Array | None = None
        self._tangents: dict[tuple[Signs, str], list[dict[str, Array]]] = {}
        self._sizes: dict[str, float] = {}

    def values(self, coordinates: Sequence[float]) -> list[float]:
        return [
            coordinate.way.value(float(u)) for coordinate, u in zip(self.space.coordinates, coordinates, strict=True)
        ]

    def scene(self, case: str, coordinates: Sequence[float], signs: Sequence[float]) -> GraspScene:
        """The scene of a case; `InputError` where it makes no sense."""
        values = self.values(coordinates)
        chosen = dict(zip(self.space.design.variables, values, strict=True))
        errors = [
            sign * number.way.error(chosen.get(number.key, number.nominal))
            for sign, number in zip(signs, self.space.tolerated, strict=True)
        ]
        return self.space.scene(case, values, errors)

    def grasps(self, signs: Signs, case: str) -> CaseGrasps:
        """The grasps of a case with errors; those without errors where there are none yet."""
        key = signs, case
        if key not in self._grasps:
            nominal = self._grasps.get((self.scenarios[0], case))
            held: Any = {} if nominal is None else nominal.held
            self._grasps[key] = CaseGrasps(case, self.wanted, self.effort, held)
        return self._grasps[key]

    @property
    def results(self) -> dict[str, GraspResult]:
        """The grasps of the last full searches without errors, by case."""
        nominal = (case_grasps for (signs, _), case_grasps in self._grasps.items() if not any(signs))
        return {case_grasps.name: case_grasps.found for case_grasps in nominal if case_grasps.found is not None}

    def snapshot(self) -> dict[tuple[Signs, str], CaseGrasps]:
        """The grasps at hand, for `restore`."""
        return {key: copy(case_grasps) for key, case_grasps in self._grasps.items()}

    def restore(self, grasps: dict[tuple[Signs, str], CaseGrasps]) -> None:
        """Take up the grasps of a snapshot; none, to search anew."""
        self._grasps = {key: copy(case_grasps) for key, case_grasps in grasps.items()}
        self._tangents = {}
        self._at = None

    def evaluate(self, coordinates: Array, *, search: bool = False) -> Evaluation:
        """Cost, limits and derivatives; with a full search for grasps, or from those at hand.

        Raises
        ------
        LostGrasp
            There is a case without a grasp, or whose scene makes no sense.
        """
        try:
            return self._evaluated(np.array(coordinates, dtype=float), search)
        except StructureChanges:
            # A rest curvature of zero, or equal diameters at both ends, are special: a little beside they are not.
            inwards = np.where(np.asarray(coordinates) < 0.5, 1.0, -1.0)
            # 1e-5: distance by which a design moves, in coordinates, from where the structure of the grasp problem
            # changes
            return self._evaluated(coordinates + 1e-5 * inwards * np.arange(1, len(coordinates) + 1), True)

    def _evaluated(self, at: Array, search: bool) -> Evaluation:
        try:
            cases = tuple(self._case(case, at, signs, search) for signs in self.scenarios for case in self.space.cases)
            values = self.values(at.tolist())
            evaluation = Evaluation(at, self._costs(cases, values), self._limits(cases, values), cases)
        except StructureChanges:
            raise
        except InputError as error:
            self.effort.lost += 1
            raise LostGrasp(str(error)) from None
        except LostGrasp:
            self.effort.lost += 1
            raise
        self._at = at
        return evaluation

    def _case(self, case: str, at: Array, signs: Signs, search: bool) -> CaseValues:
        scene = self.scene(case, at.tolist(), signs)
        grasps = self.grasps(signs, case)
        if search or not grasps.held:
            grasps.search(scene)
        else:
            grasps.follow(scene, self._guesses(grasps, (signs, case), at))
        quantities = {**grasps.quantities, "finger_mass": fingers_mass(scene)}
        columns: dict[str, list[float]] = {name: [] for name in quantities}
        tangents = []
        for along in self._directions(case, at, signs):
            near = Stencil.of(along)
            slopes, unknowns = grasps.slopes(near)
            slopes["finger_mass"] = float(near.difference([fingers_mass(scene) for scene in near.scenes]))
            for name, column in columns.items():
                column.append(slopes[name])
            tangents.append(unknowns)
        self._tangents[signs, case] = tangents
        derivatives = {name: np.array(column) for name, column in columns.items()}
        acting = tuple(row for held in grasps.held.values() for row in held.acting)
        return CaseValues(case, signs, quantities, derivatives, acting)

    def _directions(self, case: str, at: Array, signs: Signs) -> list[Callable[[float], GraspScene]]:
        """Scenes along each coordinate, and along each tolerated error."""

        def moved(step: Array, t: float) -> GraspScene:
            coordinates, errors = np.split(np.append(at, signs) + t * step, [at.size])
            return self.scene(case, coordinates.tolist(), errors.tolist())

        return [partial(moved, step) for step in np.eye(at.size + len(signs))]

    def _guesses(self, grasps: CaseGrasps, key: tuple[Signs, str], at: Array) -> dict[str, Array]:
        """Unknowns at another design, to first order."""
        tangents = self._tangents.get(key)
        before = self._at
        if tangents is None or before is None:
            return {}
        step = at - before
        guesses = dict[str, Array]()
        for aim, held in grasps.held.items():
            if all(aim in tangent for tangent in tangents):
                moves = [s * tangent[aim] for s, tangent in zip(step, tangents, strict=False)]
                guesses[aim] = held.attempt.x + np.sum(moves, axis=0)
        return guesses

    def _row(self, text: str, values: CaseValues, chosen: list[float]) -> DesignNumber:
        """An expression of a case; of a variable's name, the value that is chosen, without its error."""
        quantities, slopes = dict(values.quantities), dict(values.slopes)
        along = np.eye(len(self.space.coordinates), len(self.space.coordinates) + len(self.space.tolerated))
        for coordinate, value, direction in zip(self.space.coordinates, chosen, along, strict=True):
            if coordinate.way.name is not None:
                quantities[coordinate.way.name] = value
                slopes[coordinate.way.name] = coordinate.way.slope(value) * direction
        expression = self.expressions[text]
        value = expression.value(quantities)
        slope = expression.gradient(quantities, slopes)
        if not (np.isfinite(value) and np.isfinite(slope).all()):
            raise LostGrasp(f"{values.case}: {text} or its derivative is not finite at this design ({value:g})")
        return DesignNumber(text, values.case, values.signs, value, slope)

    def _costs(self, cases: tuple[CaseValues, ...], chosen: list[float]) -> tuple[DesignNumber, ...]:
        """Per combination of errors, the cost of the worst case or the mean."""
        design = self.space.design
        costs = []
        for signs in self.scenarios:
            rows = [self._row(design.minimize, case, chosen) for case in cases if case.signs == signs]
            if design.over == "worst":
                costs += rows
            else:
                value = float(np.mean([row.value for row in rows]))
                slope = np.mean([row.slope for row in rows], axis=0)
                costs.append(DesignNumber(design.minimize, "mean", signs, value, slope))
        return tuple(costs)

    def _limits(self, cases: tuple[CaseValues, ...], chosen: list[float]) -> tuple[DesignNumber, ...]:
        """Distances from the limits, as parts of them; of a limit of zero, as parts of the other one, or of what the
        expression has and may change by at the first design.
        """
        limits = []
        n = len(self.space.coordinates)
        for text, limit in self.space.design.limits.items():
            for case in cases:
                row = self._row(text, case, chosen)
                for bound, side, word in ((limit.min, 1.0, "at least"), (limit.max, -1.0, "at most")):
                    if bound is None:
                        continue
                    size = max(abs(bound), 1e-9)
                    if bound == 0.0:
                        change = max(abs(row.value), float(np.abs(row.slope[:n]).max()))
                        size = max(limit.max or 0.0, -(limit.min or 0.0)) or self._sizes.setdefault(text, change or 1.0)
                    name = f"{text} {word} {bound:g}"
                    scale = side / size
                    value = scale * (row.value - bound)
                    slope = scale * row.slope
                    limits.append(replace(row, name=name, value=value, slope=slope, size=size))
        return tuple(limits)
