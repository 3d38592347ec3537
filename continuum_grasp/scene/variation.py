"""Varied keys of a configuration, resolved: the scene as plain data, and for every key its place and its values."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from continuum_grasp.errors import InputError
from continuum_grasp.labels import nearest
from continuum_grasp.scene.assembly import assembled, changed, named_file, path_of, placed, validated
from continuum_grasp.scene.document import Change, Document, KeyPath, undotted
from continuum_grasp.scene.kinds import KINDS, kind_of, model_of
from continuum_grasp.scene.problems import input_error
from continuum_grasp.scene.shape import Shape
from continuum_grasp.scene.sweep import Draw, Follow, Sweep, Varied


@dataclass(frozen=True)
class SceneKey:
    """A key of the scene."""

    key: str
    path: KeyPath
    unit: str
    """Empty where the scene's documentation names none."""


@dataclass(frozen=True)
class Axis(SceneKey):
    """A key with the values that are tried."""

    values: tuple[Any, ...]
    """Plain data; fingers from other files are put in."""
    labels: tuple[Any, ...]
    """The values as they were written."""


@dataclass(frozen=True)
class Random(Axis):
    """A key that is drawn: uniformly, log-uniformly or normally with two numbers, or from a choice of values."""

    kind: str
    numbers: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Tie(SceneKey):
    """A key that follows another, ``source``: times its value, plus a number."""

    source: str
    times: float
    plus: float


@dataclass(frozen=True)
class Variation:
    """A sweep, resolved."""

    kind: str
    """Kind of the scene: grasp, or mpc."""
    base: dict[str, Any]
    """The scene as plain data, with fingers from other files and what the sweep sets put in."""
    axes: tuple[Axis, ...]
    draws: tuple[Random, ...]
    ties: tuple[Tie, ...]


def variation_of(sweep: Sweep, document: Document, file: str | os.PathLike[str]) -> Variation:
    """Resolve a sweep and check that its keys and values have their place in the scene.

    A scene that does not make sense as a whole, such as a finger that begins inside the object, is no error: it is a
    failed run. A key that does not exist, and a value of the wrong type or out of its own range, is.
    """
    scene = SceneKeys(sweep, document, Path(file), ("grasp", "mpc"))
    axes = []
    for key, grid in sweep.vary.items():
        where: KeyPath = ("vary", key) if grid.values is None else ("vary", key, "values")
        path, values = scene.values(where, key, grid.listed, listed=grid.values is not None)
        axes.append(Axis(key, path, scene.unit(path), values, tuple(map(_label, grid.listed))))
    draws = [_random(scene, key, draw) for key, draw in (sweep.sample.keys if sweep.sample else {}).items()]
    numeric = {axis.key for axis in axes if all(_is_number(value) for value in axis.values)}
    numeric |= {draw.key for draw in draws if draw.kind != "choice" or all(map(_is_number, draw.values))}
    for key, follow in sweep.follow.items():
        if follow.key not in numeric:
            message = f"{follow.key!r} has values that are no numbers"
            raise document.nearest(("follow", key, "key")).error(message, ("follow", key))
    ties = tuple(scene.tie(key, follow) for key, follow in sweep.follow.items())
    allowed = [*sweep.vary, *(draw.key for draw in draws), *sweep.follow, *sweep.columns]
    for name, part in product(("maps", "pareto"), ("x", "y", "color")):
        for k, picture in enumerate(getattr(sweep, name)):
            column = getattr(picture, part)
            if column is not None and column not in allowed:
                where = (name, k, part)
                message = f"no such column: {column!r}{nearest(column, allowed)}"
                raise document.nearest(where).error(message, where)
    return Variation(scene.kind, scene.base.value, tuple(axes), tuple(draws), ties)


def _random(scene: SceneKeys, key: str, draw: Draw) -> Random:
    numbers = draw.uniform or draw.log_uniform or draw.normal or (0.0, 0.0)
    # The second number of a normal draw is a deviation, which need not be a value of the key.
    tried = draw.choice or (numbers if draw.normal is None else numbers[:1])
    path, values = scene.values(("sample", "keys", key, draw.kind), key, tried, listed=True)
    if draw.choice is None:
        return Random(key, path, scene.unit(path), (), (), draw.kind, numbers)
    return Random(key, path, scene.unit(path), values, tuple(map(_label, draw.choice)), draw.kind)


def fault_kinds(error: ValidationError) -> set[str]:
    """Kinds of faults, in pydantic's words: ``value_error`` of checks of several keys."""
    return {fault["type"] for fault in error.errors(include_url=False, include_context=False)}


class SceneKeys:
    """The scene that a configuration names, one of ``kinds``, and the keys that it varies of it."""

    def __init__(self, config: Varied, document: Document, file: Path, kinds: Sequence[str] = ("grasp",)) -> None:
        self.document = document
        self._folder = file.parent
        place = document.nearest(("scene",))
        self.file = Path(os.path.normpath(named_file(place, config.scene, file, "file", ("scene",))))
        fixed = [self.change(("set", key), key, value) for key, value in config.set.items()]
        self.base = assembled(self.file, fixed, map(undotted, config.varied_keys))
        self.kind = kind_of(self.base.value)
        if self.kind not in kinds:
            expected = " or ".join(KINDS[kind].expected for kind in kinds)
            raise place.error(f"expected {expected}, got a file of kind {self.kind}", ("scene",))
        self.model = model_of(self.kind)
        validated(self.base, self.model)
        self.shape = Shape(self.model)
        # So that equal scenes are equal data, by which a sweep resumes.
        self.base.value = self.shape.in_si((), self.base.value, self.base.value)

    def values(
        self, where: KeyPath, key: str, given: Sequence[Any], *, listed: bool, only_key: bool = False
    ) -> tuple[KeyPath, tuple[Any, ...]]:
        """Path of a key in the scene, and its values, each tried on its own in the scene."""
        converted: list[Any] = []
        path: KeyPath = ()
        for k, value in enumerate(given):
            path, new = self.change((*where, k) if listed else where, key, value)
            tried = changed(self.base, [(path, new)], self.file)
            converted.append(self.shape.in_si(path, tried.get(path), tried.value))
            try:
                self.model.model_validate(tried.value)
            except ValidationError as error:
                kinds = fault_kinds(error)
                # Checks of the whole scene fail single runs; for a key that follows, all but its existence does.
                if kinds - {"value_error"} if not only_key else "extra_forbidden" in kinds:
                    raise input_error(error, self.model, tried) from error
        return path, tuple(converted)

    def change(self, where: KeyPath, key: str, value: Any) -> Change:
        """A key of the scene with a value, at its place in the sweep."""
        place = self.document.nearest(where)
        place = replace(place, folder=self._folder if place.line is None else None)  # not that of the scene
        try:
            path = path_of(key, place.file)
        except InputError as error:
            raise place.error(error.message, where) from None
        return path, placed(value, place)

    def tie(self, key: str, follow: Follow) -> Tie:
        """A key that follows another."""
        tried = [follow.times + follow.plus]
        path, _ = self.values(("follow", key), key, tried, listed=False, only_key=True)
        return Tie(key, path, self.unit(path), follow.key, follow.times, follow.plus)

    def unit(self, path: KeyPath) -> str:
        """Unit of a key; empty where there is none."""
        unit = self.shape.unit(path, self.base.value)
        return "" if unit is None or unit == "1" else unit


def _label(value: Any) -> Any:
    """A value as one entry of a table."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, default=str)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
