"""A design: numbers of a grasp scene that are to be chosen, so that grasps of one or many objects are best."""

from __future__ import annotations

import ast
import math
import re
from typing import Annotated, Any, Literal

from pydantic import Field

from continuum_grasp.addons.sweeps import Varied, WaysByKey
from continuum_grasp.base import nearest
from continuum_grasp.scene import Positive, Real, Unit, Value

DESIGN_QUANTITIES = {
    "tension": ("N", "sum of all tendon tensions"),
    "tension_max": ("N", "greatest tendon tension"),
    "normal_force_max": ("N", "greatest normal force of a contact"),
    "friction_margin": ("", "least friction margin of the contacts"),
    "payload": ("kg", "greatest mass that can be held"),
    "finger_mass": ("kg", "mass of all fingers"),
}
"""Quantities of a grasp that expressions may name, with unit and meaning; `tension` to `friction_margin` are of the
grasp that is best by the scene's objective, `payload` of the one with the greatest mass."""
FUNCTIONS = ("sqrt", "exp", "log")
"""Functions that expressions may call."""
_SUMS = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow, ast.UAdd, ast.USub)
_Text = Annotated[str, Field(min_length=1)]
_NAME = r"^[A-Za-z][A-Za-z0-9_]{0,30}$"
_MOST_SYMBOLS = 200
"""Characters of an expression [1]: more are no formula that is read."""


class DesignVariable(Value):
    """A number of the scene to choose within bounds."""

    min: Annotated[Real, Unit(None), Field(examples=[0.003, "3 mm"])]
    """Least value, in the unit of the key."""
    max: Annotated[Real, Unit(None), Field(examples=[0.006, "6 mm"])]
    """Greatest value, in the unit of the key."""
    start: Annotated[Annotated[Real, Unit(None)] | None, Field(examples=[0.004, "4 mm"])] = None
    """Start of the search, in the unit of the key; None: the scene's value."""
    spacing: Literal["linear", "log"] = "linear"
    """log: equal ratios count alike, for a number that may change by more than a factor of three."""
    name: Annotated[str, Field(pattern=_NAME)] | None = None
    """Name of the variable in expressions; None: expressions do not use it."""

    def _check(self) -> None:
        self._check_below("min", "max")
        if self.spacing == "log" and self.min <= 0.0:
            raise ValueError(f"min = {self.min:g}: spacing: log needs positive bounds")
        if self.start is not None and not self.min <= self.start <= self.max:
            raise ValueError(f"start = {self.start:g} is not within {self.min:g} and {self.max:g}")
        if self.name in DESIGN_QUANTITIES or self.name in FUNCTIONS:
            raise ValueError(f"name: {self.name!r} is already defined in expressions")

    def value(self, coordinate: float) -> float:
        """The value at a coordinate, which goes from 0 at the least value to 1 at the greatest."""
        if self.spacing == "log":
            return float(self.min * (self.max / self.min) ** coordinate)
        return self.min + (self.max - self.min) * coordinate

    def coordinate(self, value: float) -> float:
        """The coordinate of a value."""
        if self.spacing == "log":
            return math.log(value / self.min) / math.log(self.max / self.min)
        return (value - self.min) / (self.max - self.min)

    def slope(self, value: float) -> float:
        """Change of the value per coordinate."""
        return value * math.log(self.max / self.min) if self.spacing == "log" else self.max - self.min


class Tolerance(Value):
    """Greatest error of a number of the scene, either way from its chosen or stated value."""

    amount: Annotated[Positive, Unit(None), Field(examples=[0.0001, "0.1 mm"])] | None = None
    """Greatest deviation from the value, in the unit of the key."""
    share: Annotated[float, Field(gt=0.0, le=0.5, examples=[0.02, "2 %"]), Unit("1")] | None = None
    """Greatest deviation as a part of the value [1]."""

    def _check(self) -> None:
        self._check_one_given("amount", "share")

    def error(self, value: float) -> float:
        """Greatest error either way of a value."""
        return self.amount or 0.0 if self.share is None else abs(value) * self.share


class QuantityLimit(Value):
    """Bounds of an expression, in SI units."""

    min: Annotated[Annotated[Real, Unit("SI unit of the expression")] | None, Field(examples=[0.5])] = None
    """Least value [SI unit of the expression]; None: none."""
    max: Annotated[Annotated[Real, Unit("SI unit of the expression")] | None, Field(examples=[2.0])] = None
    """Greatest value [SI unit of the expression]; None: none."""

    def _check(self) -> None:
        if self.min is None and self.max is None:
            raise ValueError("give min, max, or both")
        self._check_below("min", "max")


class DesignSolver(Value):
    """Options of the search for the best design."""

    starts: Annotated[int, Field(ge=1, le=1000)] = 5
    """Designs whose grasps are searched before the best of them is improved: the start, and others spread evenly
    within the bounds."""
    max_iterations: Annotated[int, Field(ge=1, le=1000)] = 40
    """Iterations of the optimizer of designs between two full searches for grasps."""
    max_rounds: Annotated[int, Field(ge=1, le=20)] = 4
    """Full searches for grasps at the best design: where one finds a better grasp, the optimizer goes on from it."""
    tolerance: Annotated[float, Field(ge=1e-12, le=1e-2, examples=[1e-6]), Unit("1")] = 1e-6
    """Change of the cost, as a part of it, at which the optimizer stops [1]."""


class Design(Varied):
    """A grasp scene, its numbers to be chosen, and a cost to be minimized."""

    variables: Annotated[WaysByKey[DesignVariable], Field(min_length=1, max_length=40)]
    """Key paths in the scene of the numbers that are to be chosen."""
    cases: Annotated[dict[str, dict[_Text, Any]], Field(default_factory=dict, max_length=200)]
    """Objects or tasks by name, each as key paths with values that differ from the scene; empty: the scene itself."""
    minimize: Annotated[str, Field(min_length=1, examples=["tension", "-payload", "tension + 200 * finger_mass"])]
    """Cost: an expression with + - * / ** ( ), sqrt, exp, log, in SI units, of tension, tension_max, normal_force_max,
    friction_margin, payload, finger_mass, and names of variables."""
    over: Literal["worst", "mean"] = "worst"
    """Cost that counts among the costs of all cases."""
    limits: dict[_Text, QuantityLimit] = Field(default_factory=dict)
    """Expressions with bounds, which hold in every case."""
    tolerances: Annotated[WaysByKey[Tolerance], Field(default_factory=dict, max_length=12)]
    """Key paths in the scene that are manufactured with errors: cost and limits hold for the worst combination of
    errors."""
    solver: DesignSolver = DesignSolver()
    """Options of the search."""

    def _check(self) -> None:
        names = [entry.name for entry in self.variables.values() if entry.name is not None]
        for key, variable in self.variables.items():
            if variable.name is not None and names.count(variable.name) > 1:
                raise ValueError(f"variables: {key!r} shares the name {variable.name!r} with another one")
        self.check_follow(self.variables)
        for name in self.cases:
            if not re.fullmatch(r"[\w .,+%=-]{1,60}", name):
                raise ValueError(
                    f"cases: {name!r} cannot name a folder: use only letters, digits, spaces and _ . , + - = %"
                )
        for key in self.tolerances:
            if key in self.follow:
                raise ValueError(f"tolerances: {key!r} follows {self.follow[key].key!r}; state the error of that key")
        known = (*DESIGN_QUANTITIES, *names)
        check_expression("minimize", self.minimize, known)
        for expression in self.limits:
            check_expression("limits", expression, known)

    @property
    def varied_keys(self) -> tuple[str, ...]:
        cases = (key for case in self.cases.values() for key in case)
        return (*super().varied_keys, *self.variables, *self.tolerances, *cases)

    @property
    def expressions(self) -> tuple[str, ...]:
        """The cost, then the limited expressions."""
        return (self.minimize, *self.limits)

    @property
    def used(self) -> frozenset[str]:
        """Names in cost and limits."""
        return frozenset().union(*(names_in(expression) for expression in self.expressions))


def names_in(expression: str) -> frozenset[str]:
    """Names of quantities and variables in an expression."""
    names = (node.id for node in ast.walk(ast.parse(expression, mode="eval")) if isinstance(node, ast.Name))
    return frozenset(names) - frozenset(FUNCTIONS)


def check_expression(key: str, expression: str, known: tuple[str, ...]) -> None:
    """Refuse an expression that is no formula of known names; the message begins with the key."""
    if len(expression) > _MOST_SYMBOLS:
        raise ValueError(f"{key}: the expression has {len(expression)} characters; the limit is {_MOST_SYMBOLS}")
    try:
        tree = ast.parse(expression.strip(), mode="eval")
    except SyntaxError as error:
        raise ValueError(f"{key}: {expression!r} is not a valid formula ({error.msg})") from None
    for node in ast.walk(tree.body):
        match node:
            case ast.Name(id=name) if name not in known and name not in FUNCTIONS:
                raise ValueError(f"{key}: unknown name {name!r} in {expression!r}{nearest(name, known)}")
            case ast.Call(func=ast.Name(id=name), args=[_], keywords=[]) if name in FUNCTIONS:
                pass
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                pass
            case ast.BinOp(op=op) | ast.UnaryOp(op=op) if isinstance(op, _SUMS):
                pass
            case ast.Name() | ast.Load() | ast.operator() | ast.unaryop():
                pass
            case _:
                what = ast.unparse(node) if isinstance(node, ast.expr) else type(node).__name__
                allowed = f"numbers, names, + - * / ** ( ) and {', '.join(FUNCTIONS)}"
                raise ValueError(f"{key}: {what!r} is not allowed in {expression!r}: expected {allowed}")
    if not names_in(expression) & set(known):
        raise ValueError(f"{key}: {expression!r} contains nothing that a design can change")
