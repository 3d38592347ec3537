"""Varied keys of a configuration, resolved: the scene as plain data, and for every key its place and its values."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import ValidationError

from continuum_grasp.addons.sweeps.scene import VARIED_KINDS, Draw, Follow, Grid, Sweep, Varied, Way
from continuum_grasp.base import InputError, nearest
from continuum_grasp.scene import ConfigurationData, Document, KeyPath, Shape
from continuum_grasp.scene import kinds as known_kinds

Config = TypeVar("Config", bound=Varied)


@dataclass(frozen=True)
class VariedKey(Generic[Way]):
    """A key of the scene, and how a sweep or a design varies it."""

    key: str
    path: KeyPath
    unit: str
    """Empty where the scene's documentation names none."""
    way: Way
    """As the configuration has it."""
    values: tuple[Any, ...] = ()
    """The values that are listed as plain data; fingers from other files are put in."""
    nominal: float = math.nan
    """In designs, the value where the search starts, or the value of a number that is not chosen."""


@dataclass(frozen=True)
class Variation:
    """A sweep, resolved."""

    sweep: Sweep
    kind: str
    """Kind of the scene, one of `VARIED_KINDS`."""
    base: dict[str, Any]
    """The scene as plain data, with fingers from other files and what the sweep sets put in."""
    axes: tuple[VariedKey[Grid], ...]
    draws: tuple[VariedKey[Draw], ...]
    ties: tuple[VariedKey[Follow], ...]


def variation_of(data: ConfigurationData) -> Variation:
    """Resolve a sweep and check that its keys and values have their place in the scene.

    A scene that does not make sense as a whole, such as a finger that begins inside the object, is no error: it is a
    failed run. A key that does not exist, and a value of the wrong type or out of its own range, is.
    """
    scene = SceneKeys(Sweep, data, VARIED_KINDS)
    sweep = scene.config
    axes = []
    for key, grid in sweep.vary.items():
        where: KeyPath = ("vary", key) if grid.values is None else ("vary", key, "values")
        axes.append(scene.varied(where, key, grid, grid.listed, listed=grid.values is not None))
    draws = [
        scene.varied(("sample", "keys", key, draw.kind), key, draw, draw.listed)
        for key, draw in (sweep.sample.keys if sweep.sample else {}).items()
    ]
    listed: list[VariedKey[Any]] = [*axes, *draws]
    numeric = {varied.key for varied in listed if all(map(_is_number, varied.values))}
    for key, follow in sweep.follow.items():
        if follow.key not in numeric:
            message = f"{follow.key!r} has values that are not numbers"
            raise data.nearest(("follow", key, "key")).error(message, ("follow", key))
    allowed = [*sweep.vary, *(draw.key for draw in draws), *sweep.follow, *sweep.columns]
    for name, part in product(("maps", "pareto"), ("x", "y", "color")):
        for k, picture in enumerate(getattr(sweep, name)):
            column = getattr(picture, part)
            if column is not None and column not in allowed:
                where = (name, k, part)
                message = f"no such column: {column!r}{nearest(column, allowed)}"
                raise data.nearest(where).error(message, where)
    return Variation(sweep, scene.kind, scene.base.value, tuple(axes), tuple(draws), scene.ties)


class SceneKeys(Generic[Config]):
    """The scene that a configuration of a class names, one of ``kinds``, and the keys that it varies of it."""

    def __init__(self, model: type[Config], data: ConfigurationData, kinds: Sequence[str] = ("grasp",)) -> None:
        self.config = data.validated(model).in_folder(data.file.parent)
        self.data = data
        place = data.nearest(("scene",))
        file = Path(os.path.normpath(place.named_file(self.config.scene, data.file, "file", ("scene",))))
        fixed = [self.change(("set", key), key, value) for key, value in self.config.set.items()]
        self.base = ConfigurationData.read(file, fixed, self.config.varied_keys)
        self.kind = self.base.kind.name
        if self.kind not in kinds:
            expected = " or ".join(known_kinds()[kind].expected for kind in kinds)
            raise place.error(f"expected {expected}, got a file of kind {self.kind}", ("scene",))
        self.model = self.base.kind.scene_class
        self.base.validated(self.model)
        self.shape = Shape(self.model)
        # So that equal scenes are equal data, by which a sweep resumes.
        self.base.value = self.shape.in_si((), self.base.value, self.base.value)

    def varied(
        self, where: KeyPath, key: str, way: Way, given: Sequence[Any], *, listed: bool = True, only_key: bool = False
    ) -> VariedKey[Way]:
        """A key of the scene with its values, each tried on its own in the scene."""
        converted: list[Any] = []
        path: KeyPath = ()
        for k, value in enumerate(given):
            path, new = self.change((*where, k) if listed else where, key, value)
            tried = self.base.changed([(path, new)])
            converted.append(self.shape.in_si(path, tried.get(path), tried.value))
            try:
                tried.validated(self.model)
            except InputError as error:
                kinds = self.fault_kinds(error)
                # Checks of the whole scene fail single runs; for a key that follows, all but its existence does.
                if kinds - {"value_error"} if not only_key else "extra_forbidden" in kinds:
                    raise
        return VariedKey(key, path, self.unit(path), way, tuple(converted))

    @staticmethod
    def fault_kinds(error: InputError) -> set[str]:
        """Kinds of the faults that validation found, in pydantic's words: ``value_error`` of checks of several keys.

        Empty where the error is not one of validation.
        """
        found = error.__cause__
        if not isinstance(found, ValidationError):
            return set()
        return {fault["type"] for fault in found.errors(include_url=False, include_context=False)}

    def change(self, where: KeyPath, key: str, value: Any) -> tuple[KeyPath, Document]:
        """A key of the scene with a value, at its place in the sweep."""
        place = self.data.nearest(where)
        beside = self.data.file.parent if place.line is None else None  # not beside the scene
        place = replace(place, folder=beside)
        try:
            path = Document.path_of(key, place.file)
        except InputError as error:
            raise place.error(error.message, where) from None
        return path, Document.at(place, value)

    def followed(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values of the keys that follow others, beside ``values`` of the varied keys."""
        return {tie.key: tie.way.value(values[tie.way.key]) for tie in self.ties}

    @cached_property
    def ties(self) -> tuple[VariedKey[Follow], ...]:
        """The keys that follow others."""
        return tuple(
            self.varied(("follow", key), key, follow, [follow.value(1.0)], listed=False, only_key=True)
            for key, follow in self.config.follow.items()
        )

    def unit(self, path: KeyPath) -> str:
        """Unit of a key; empty where there is none."""
        unit = self.shape.unit(path, self.base.value)
        return "" if unit is None or unit == "1" else unit


def base_scene(data: ConfigurationData) -> Any:
    """The scene that a sweep or design varies, as it stands in its file; any other configuration itself."""
    if not isinstance(data.scene, Varied):
        return data.scene
    keys = SceneKeys(type(data.scene), data, VARIED_KINDS)
    return keys.base.validated(keys.model)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def read_sweep(data: ConfigurationData) -> Sweep:
    """The sweep of a file, whose keys and values have their place in the scene that it names."""
    return variation_of(data).sweep
