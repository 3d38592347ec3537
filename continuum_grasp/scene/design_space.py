"""What a design varies, resolved: variables with their places, and the scene of every case and design."""

from __future__ import annotations

import copy
import math
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from continuum_grasp.errors import InputError
from continuum_grasp.scene.assembly import changed, validated
from continuum_grasp.scene.consumer import Consumer, beside
from continuum_grasp.scene.design import Design, DesignVariable, Tolerance
from continuum_grasp.scene.document import Document, KeyPath, child
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.problems import input_error
from continuum_grasp.scene.variation import SceneKey, SceneKeys, Tie

_ONE = (
    "payload is that of one posture, not of a grasp that must hold for many; expected another cost and other limits, "
    "or friction_states: pulled without robust"
)
_PAYLOADS = (
    Consumer("design of a payload", {"robust": _ONE}),
    beside("design of a payload with friction", lambda scene: scene.state_columns, "friction_states=any", _ONE),
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
        """Value at a coordinate."""
        if self.log:
            return float(self.low * (self.high / self.low) ** coordinate)
        return self.low + (self.high - self.low) * coordinate

    def coordinate(self, value: float) -> float:
        """Coordinate of a value."""
        if self.log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def slope(self, value: float) -> float:
        """Change of the value per coordinate."""
        return value * math.log(self.high / self.low) if self.log else self.high - self.low


@dataclass(frozen=True)
class ToleratedKey(SceneKey):
    """A number that is manufactured with an error."""

    variable: int | None
    """Which variable it is; None: a number of the scene that is not chosen."""
    nominal: float
    """Its value, of one that is not chosen."""
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
        """The scene of a case for values of the variables, and errors of what is tolerated.

        Raises
        ------
        InputError
            The values do not make sense together.
        """
        actual = list(values)
        puts: list[tuple[KeyPath, float]] = []
        for one, error in zip(self.tolerated, errors, strict=False):
            if one.variable is None:
                puts.append((one.path, one.nominal + error))
            else:
                actual[one.variable] += error
        puts += [(one.path, value) for one, value in zip(self.coordinates, actual, strict=True)]
        chosen = dict(zip(self.design.variables, actual, strict=True))
        puts += [(one.path, one.times * chosen[one.source] + one.plus) for one in self.following]
        document = self.cases[case]
        data = copy.deepcopy(document.value)
        for path, value in puts:
            _put(data, path, value)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of the scene's file, which has been read
            try:
                found = GraspScene.model_validate(data)
            except ValidationError as error:
                raise input_error(error, GraspScene, Document(data, document.places)) from error
        _check_payload(self.design, found)
        return found

    @property
    def start(self) -> list[float]:
        """Values where the search starts."""
        return [one.start for one in self.coordinates]


def _check_payload(design: Design, scene: GraspScene) -> None:
    """Refuse to seek the greatest mass of grasps that must hold for many errors or friction states."""
    for one in _PAYLOADS if "payload" in design.used else ():
        one.check(scene)


def design_space_of(design: Design, document: Document, file: str | os.PathLike[str]) -> DesignSpace:
    """Resolve a design and check that its keys and values have their place in the scene."""
    return _Resolver(design, document, Path(file)).space()


class _Resolver(SceneKeys):
    def __init__(self, design: Design, document: Document, file: Path) -> None:
        super().__init__(design, document, file)
        self.design = design

    def space(self) -> DesignSpace:
        design, keys = self.design, list(self.design.variables)
        scene = validated(self.base, GraspScene)
        _check_payload(design, scene)
        coordinates = [self._coordinate(key, variable, scene) for key, variable in design.variables.items()]
        following = [self.tie(key, follow) for key, follow in design.follow.items()]
        tolerated = []
        for key, tolerance in design.tolerances.items():
            path = self.change(("tolerances", key), key, 0.0)[0]
            value = math.nan if key in keys else self._number(("tolerances", key), scene, path)
            variable = keys.index(key) if key in keys else None
            tolerated.append(ToleratedKey(key, path, self.unit(path), variable, value, tolerance))
        cases = {name: self._case(name, changes) for name, changes in design.cases.items()} or {SINGLE: self.base}
        return DesignSpace(design, tuple(coordinates), tuple(following), tuple(tolerated), cases, self.file)

    def _coordinate(self, key: str, variable: DesignVariable, scene: GraspScene) -> Coordinate:
        where = ("variables", key)
        path, _ = self.values(where, key, [variable.min, variable.max], listed=False)
        start = variable.start
        if start is None:
            start = self._number(where, scene, path)
            if not variable.min <= start <= variable.max:
                message = f"the scene has {start:g}, not within {variable.min:g} and {variable.max:g}: give start"
                raise self.document.nearest(where).error(message, where)
        log = variable.spacing == "log"
        return Coordinate(key, path, self.unit(path), variable.min, variable.max, start, log, variable.name)

    def _number(self, where: KeyPath, scene: GraspScene, path: KeyPath) -> float:
        """The number of the scene at a path, also one that its file leaves to the default."""
        found: Any = scene
        for part in path:
            found = child(found, part)
        if isinstance(found, bool) or not isinstance(found, int | float):
            message = "the scene has no number there" + ("" if found is None else f", but {found!r:.60}")
            raise self.document.nearest(where).error(message, where)
        return float(found)

    def _case(self, name: str, changes: Mapping[str, Any]) -> Document:
        given = [self.change(("cases", name, key), key, value) for key, value in changes.items()]
        found = changed(self.base, given, self.file)
        try:
            validated(found, GraspScene)
        except InputError as error:
            # Where the scene makes no sense as it is, the variables may repair it.
            if not self._makes_sense(found):
                raise error from None
        found.value = self.shape.in_si((), found.value, found.value)
        return found

    def _makes_sense(self, document: Document) -> bool:
        """Whether every key of a scene is right on its own."""
        try:
            GraspScene.model_validate(document.value)
        except ValidationError as error:
            return {one["type"] for one in error.errors(include_url=False, include_context=False)} == {"value_error"}
        return True


def _put(data: Any, path: KeyPath, value: float) -> None:
    for part in path[:-1]:
        # A mapping that the file leaves to its defaults; a list has been checked to be there.
        if isinstance(data, dict) and data.get(part) is None:
            data[part] = {}
        data = data[part]
    data[path[-1]] = value
