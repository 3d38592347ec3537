"""Variables of a design, resolved: variables with their places, and the scene of every case and design."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from continuum_grasp.errors import InputError
from continuum_grasp.scene.assembly import changed, placed, validated
from continuum_grasp.scene.consumer import refusals
from continuum_grasp.scene.design import Design, DesignVariable, Tolerance
from continuum_grasp.scene.document import Document, KeyPath, child
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.variation import SceneKey, SceneKeys, Tie, fault_kinds

_PAYLOADS = refusals(
    """
    robust: payload is that of one posture, not of a grasp that must hold for many; expected another cost and other
        limits, or friction_states: pulled without robust
    friction_states=any with state_columns: payload is that of one posture, not of a grasp that must hold for many;
        expected another cost and other limits, or friction_states: pulled without robust
    """
)
SINGLE = "scene"
"""Name of the case of a design that lists none."""


@dataclass(frozen=True)
class Coordinate(SceneKey):
    """A variable of the design; coordinates from 0 to 1 stand for its values from the least to the greatest."""

    low: float
    high: float
    start: float
    log: bool
    name: str | None

    def value(self, coordinate: float) -> float:
        if self.log:
            return float(self.low * (self.high / self.low) ** coordinate)
        return self.low + (self.high - self.low) * coordinate

    def coordinate(self, value: float) -> float:
        if self.log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def slope(self, value: float) -> float:
        return value * math.log(self.high / self.low) if self.log else self.high - self.low


@dataclass(frozen=True)
class ToleratedKey(SceneKey):
    """A number that is manufactured with an error."""

    variable: int | None
    """Index of the variable; None: a number of the scene that is not chosen."""
    nominal: float
    """Nominal value of a number that is not chosen."""
    tolerance: Tolerance

    def amount(self, value: float) -> float:
        """Greatest error either way of a value."""
        share = self.tolerance.share
        return self.tolerance.amount or 0.0 if share is None else abs(value) * share


@dataclass(frozen=True)
class DesignSpace:
    """A design, resolved."""

    design: Design
    coordinates: tuple[Coordinate, ...]
    following: tuple[Tie, ...]
    tolerated: tuple[ToleratedKey, ...]
    cases: Mapping[str, Document]
    file: Path

    def scene(self, case: str, values: Sequence[float], errors: Sequence[float] = ()) -> GraspScene:
        """The scene of a case for values of the variables, and errors of what is tolerated; InputError if these do not
        make sense together.
        """
        actual = list(values)
        puts: list[tuple[KeyPath, float]] = []
        for number, error in zip(self.tolerated, errors, strict=False):
            if number.variable is None:
                puts.append((number.path, number.nominal + error))
            else:
                actual[number.variable] += error
        puts += [(coordinate.path, value) for coordinate, value in zip(self.coordinates, actual, strict=True)]
        chosen = dict(zip(self.design.variables, actual, strict=True))
        puts += [
            (following.path, following.times * chosen[following.source] + following.plus)
            for following in self.following
        ]
        document = self.cases[case]
        changes = [(path, placed(value, document.place(path))) for path, value in puts]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of the scene's file, which has been read
            scene = validated(changed(document, changes, self.file), GraspScene)
        _check_payload(self.design, scene)
        return scene

    @property
    def start(self) -> list[float]:
        """Values where the search starts."""
        return [coordinate.start for coordinate in self.coordinates]


def _check_payload(design: Design, scene: GraspScene) -> None:
    """Refuse to seek the greatest mass of grasps that must hold for many errors or friction states."""
    for feature in _PAYLOADS if "payload" in design.used else ():
        feature.check(scene)


def design_space_of(design: Design, document: Document, file: str | os.PathLike[str]) -> DesignSpace:
    """Resolve a design and check that its keys and values have their place in the scene."""
    keys = SceneKeys(design, document, Path(file))
    scene, variables = validated(keys.base, GraspScene), list(design.variables)
    _check_payload(design, scene)
    tolerated = []
    for key, tolerance in design.tolerances.items():
        path = keys.change(("tolerances", key), key, 0.0)[0]
        number = variables.index(key) if key in variables else None
        value = math.nan if key in variables else _number(keys, ("tolerances", key), scene, path)
        tolerated.append(ToleratedKey(key, path, keys.unit(path), number, value, tolerance))
    return DesignSpace(
        design,
        tuple(_coordinate(keys, key, variable, scene) for key, variable in design.variables.items()),
        tuple(keys.tie(key, follow) for key, follow in design.follow.items()),
        tuple(tolerated),
        {name: _case(keys, name, changes) for name, changes in design.cases.items()} or {SINGLE: keys.base},
        keys.file,
    )


def _coordinate(keys: SceneKeys, key: str, variable: DesignVariable, scene: GraspScene) -> Coordinate:
    where = ("variables", key)
    path, _ = keys.values(where, key, [variable.min, variable.max], listed=False)
    start = variable.start
    if start is None:
        start = _number(keys, where, scene, path)
        if not variable.min <= start <= variable.max:
            message = f"the scene has {start:g}, not within {variable.min:g} and {variable.max:g}: give start"
            raise keys.document.nearest(where).error(message, where)
    log = variable.spacing == "log"
    return Coordinate(key, path, keys.unit(path), variable.min, variable.max, start, log, variable.name)


def _number(keys: SceneKeys, where: KeyPath, scene: GraspScene, path: KeyPath) -> float:
    """The number of the scene at a path, also one that its file leaves to the default."""
    number: Any = reduce(child, path, scene)
    if isinstance(number, bool) or not isinstance(number, int | float):
        message = "the scene has no number there" + ("" if number is None else f", but {number!r:.60}")
        raise keys.document.nearest(where).error(message, where)
    return float(number)


def _case(keys: SceneKeys, name: str, changes: Mapping[str, Any]) -> Document:
    edits = [keys.change(("cases", name, key), key, value) for key, value in changes.items()]
    document = changed(keys.base, edits, keys.file)
    try:
        validated(document, GraspScene)
    except InputError as error:
        # Where every key is right on its own but the scene makes no sense, the variables may repair it.
        if not isinstance(error.__cause__, ValidationError) or fault_kinds(error.__cause__) != {"value_error"}:
            raise error from None
    document.value = keys.shape.in_si((), document.value, document.value)
    return document
