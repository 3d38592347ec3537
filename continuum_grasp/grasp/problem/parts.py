"""Problems that are sums of parts: the object, each finger with its contacts, fingers that keep clear of each other.

A part has unknowns, run-time numbers and rows of its own, with names in which {0}, {1} ... stand for the names of its
fingers and contacts: parts that are alike are built and differentiated once in a process. In the whole problem, what
has the same name is the same; rows of the same name are summed, as the balance of the object is.
"""

from __future__ import annotations

from collections.abc import Container, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Generic, TypeVar

import casadi as ca
import numpy as np

from continuum_grasp.base import Indices
from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.problem.blocks import Columns, ConstraintRows, Expressed, Places
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.nlp import NLP, Summand, summed


class ProblemPart:
    """Unknowns, numbers and rows of a part, and its part of the objective.

    Limits of the names ``relaxed`` have an unknown by how much they are relaxed.
    """

    name: ClassVar[str] = ""
    """Beginning of the names of numbers that each part has."""
    balances: tuple[int, ...] = tuple(range(6))
    """Rows of the object's balance: force along x, y, z, moment about x, y, z."""
    reserve: ca.SX | None = None
    """By how much all cones could be narrower, per force reference; negative where contacts would slip or part."""

    def __init__(self, relaxed: Container[str]) -> None:
        self.x, self.numbers, self.rows = Columns(), Columns(), Expressed()
        self.slack = {
            r.name: self.x(f"relaxed {r.name}", r.size) if r.name in relaxed else ca.SX(r.size, 1) for r in RELAXATIONS
        }
        self.objective = ca.SX(0)

    @cached_property
    def nlp(self) -> NLP:
        """The part as a problem."""
        return NLP("part", self.x.symbol, self.objective, self.rows.g, self.numbers.symbol)

    def read(self, *values: ca.SX) -> ca.Function:
        """Function of unknowns and numbers."""
        return ca.Function("read", [self.x.symbol, self.numbers.symbol], list(values))

    def bound(self, name: str, force: ca.SX, friction: ca.SX) -> None:
        """The force at a contact, with its normal part first, stays within the cone of a friction and its limit."""
        cone, reference = friction_cone(self.numbers, friction, force), self.numbers("force reference")
        require = self.rows.require
        if self.reserve is not None:
            cone -= self.reserve * reference
            # Also without friction a contact presses.
            require(f"pressed, {name}", force[0] - self.reserve * reference, "N", "contacts", upper=ca.inf)
        require(f"friction cone, {name}", cone, "N", f"contacts.friction ({name})", upper=ca.inf)
        limit = self.numbers(f"{name}.normal_force_max") + self.slack["normal force"]
        require(f"normal force, {name}", limit - force[0], "N", "contacts.normal_force_max", upper=ca.inf)

    def balance(self, force: ca.SX, moment: ca.SX, loads: Iterable[tuple[ca.SX, ca.SX, ca.SX]]) -> None:
        """A force on the object at its center of mass, a moment, and loads (arm, force, moment) that it bears on
        others.
        """
        for arm, load, couple in loads:
            force = force - load
            moment = moment - ca.cross(arm, load) - couple
        self.rows.require("object force balance", force[[k for k in self.balances if k < 3]], "N", "object.mass")
        # Per size of the object, so that moments compare with forces.
        moment = moment[[k - 3 for k in self.balances if k >= 3]] / self.numbers("size")
        self.rows.require("object moment balance", moment, "moment per size", "object")

    def steady(self, level: ca.SX) -> None:
        """The least eigenvalue of the second-order test, to first order about a point, is not below a level; last of
        all unknowns.
        """
        x = self.x.symbol
        value = ca.dot(self.numbers(f"{self.name}stability slope", x.numel()), x) - level
        self.rows.require("stability", value, "1", "stability", upper=ca.inf)


def friction_cone(numbers: Columns, friction: ca.SX, force: ca.SX) -> ca.SX:
    """Rows that are not negative for a force (2 to 4,) within a friction cone, less its reserve, where nothing pulls
    (n >= 0).
    """
    friction = numbers("cone share") * friction
    n, f = force[0], force[1]
    if force.numel() > 2:
        # The hyperboloid (mu N)^2 >= f^2 + l^2 + e^2 within the cone. The cone has a kink where nothing presses, at
        # which IPOPT would zigzag; so does a root in its place, which is nearly one.
        apex = numbers("cone rounding")
        cone: ca.SX = friction * n - apex - ca.sumsqr(force[1:]) / (friction * n + apex)
        return cone
    # In the plane the cone is two half planes: linear, nothing to round.
    return ca.vertcat(friction * n - f, friction * n + f)


Part = TypeVar("Part", bound=ProblemPart)


@dataclass(frozen=True, eq=False)
class PlacedPart(Generic[Part]):
    """A part and the places of its own in the whole."""

    part: Part
    names: tuple[str, ...]  # that stand for {0}, {1} ...
    unknowns: Indices
    numbers: Indices
    rows: Indices

    def values(self, function: ca.Function, x: Array, p: Array) -> list[Array]:
        """Values of a function that reads the part."""
        return [np.array(value) for value in function.call([x[self.unknowns], p[self.numbers]])]


class PartedProblem:
    """Unknowns, numbers and rows of a problem by their names, and the problem itself."""

    def __init__(self) -> None:
        self.parts = list[PlacedPart[Any]]()
        self.x, self.numbers, self.rows = Places(), Places(), ConstraintRows()

    def add(self, part: Part, *names: str) -> PlacedPart[Part]:
        """Append a part, whose fingers and contacts have these names."""
        rows = list[Indices]()
        known = {block.name: block for block in self.rows.blocks}
        for block in part.rows.blocks:
            named = block.name.format(*names)
            if named in known:
                rows.append(known[named].rows.ravel())
                continue
            key, unit, count = block.key.format(*names), block.unit.format(*names), block.rows.size
            rows.append(self.rows.rows(named, key, unit, count, 1.0, block.lower, block.upper).ravel())
        unknowns, numbers = self.x.placed(part.x, names), self.numbers.placed(part.numbers, names)
        placed = PlacedPart(part, names, unknowns, numbers, np.concatenate([np.zeros(0, dtype=int), *rows]))
        self.parts.append(placed)
        return placed

    @cached_property
    def nlp(self) -> NLP:
        """The problem with its derivatives."""
        parts = [Summand(placed.part.nlp, placed.unknowns, placed.numbers, placed.rows) for placed in self.parts]
        return summed("grasp", (self.x.size, self.numbers.size, self.rows.count), parts)

    def steadying(self, slope: Array, level: float) -> dict[str, Any]:
        """Numbers by which ``slope . x`` is not below a level, where stability is bounded."""
        numbers: dict[str, Any] = {"stability level": level}
        taken = np.zeros(slope.size, dtype=bool)
        for placed in self.parts:
            if f"{placed.part.name}stability slope" in placed.part.numbers.at:
                own = np.where(taken[placed.unknowns], 0.0, slope[placed.unknowns])
                taken[placed.unknowns] = True
                numbers[f"{placed.part.name}stability slope".format(*placed.names)] = own
        return numbers
