"""Assemble one checked document from a file, the files that it names, and changes from outside (``--set``)."""

from __future__ import annotations

import copy
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar

from continuum_grasp.base import ConfigurationKind, InputError, named_value
from continuum_grasp.scene.config_kinds import kind_of, kinds
from continuum_grasp.scene.document import Change, Document, KeyPath, Place, child, dotted, plain, undotted
from continuum_grasp.scene.problems import validated
from continuum_grasp.scene.yaml_loader import parse_yaml, read_yaml

if TYPE_CHECKING:
    from pydantic import BaseModel

    Model = TypeVar("Model", bound=BaseModel)

VERSION = 1
"""Version of the format of configurations, the only one so far."""

Overrides = Iterable[str] | Mapping[str, Any]


@dataclass
class AssembledData(Document):
    """Plain data, with the contents of the files that they name put in."""

    file: Path = Path()
    """The main file: names of files that come from no line of a file are relative to its folder."""

    @classmethod
    def read(cls, path: str | Path, changes: Iterable[Change], varied: Iterable[str] = ()) -> Self:
        """The data of a file with changes applied; files whose keys are ``varied`` are not read."""
        document = read_yaml(path)
        if not isinstance(document.value, dict):
            place = document.places[()]
            got = "an empty file" if document.value is None else "no keys"
            raise place.error(f"expected a mapping of keys to values, got {got}")
        data = cls(document.value, document.places, tuple(map(undotted, varied)), file=Path(path))
        _apply(data, changes, data.file)
        _check_version(data)
        return data

    @classmethod
    def of(cls, value: Any, name: str, file: Path | None = None) -> Self:
        """The data of a scene or mapping that is given in Python, which errors call by a name."""
        return cls(plain(value), {(): Place(name)}, file=file or Path(name))

    def validated(self, model: type[Model]) -> Model:
        """The contents, checked: `InputError` has file, line, column and key of everything that is wrong."""
        return validated(self, model)

    def changed(self, changes: Iterable[Change]) -> Self:
        """A copy with changes applied."""
        value, places, notes = copy.deepcopy(self.value), dict(self.places), list(self.notes)
        result = type(self)(value, places, self.varied, notes, self.file)
        _apply(result, changes, self.file)
        return result


def _apply(document: Document, changes: Iterable[Change], main: Path) -> None:
    for where, new in changes:
        if len(where) > 1:
            # A change inside a finger that is in another file needs that file; one of its name must come before.
            if where[-1] != "extends":
                _put_in_files(document, main)
            elif reduce(child, where, document.value) is None:
                key = dotted(where[:-1])
                raise new.places[()].error(f"{key} extends no file: expected {key}={{extends: FILE, ...}}", where)
        document.override(where, new)
    _put_in_files(document, main)
    _put_in_drawings(document, kind_of(document.value), (), main)
    if isinstance(document.value.get("grasp"), dict):
        _put_in_drawings(document, kinds()["grasp"], ("grasp",), main)


def _put_in_drawings(document: Document, kind: ConfigurationKind, scene: KeyPath, main: Path) -> None:
    """Insert the contents of other programs' files that the scene of a kind, at a path, names."""
    if kind.scene_class.FILES:
        named_value(kind.scene_class.FILES)(document, scene, main)


def _put_in_files(document: Document, main: Path) -> None:
    """Put in place what stands in other files: the grasp of a mission or plan, and fingers, its own too."""
    target = document.value.get("grasp")
    if isinstance(target, str):
        file = document.place(("grasp",)).named_file(target, main, "grasp file", ("grasp",))
        inner = AssembledData.read(file, ())
        if (kind := kind_of(inner.value).name) != "grasp":
            message = f"expected a grasp (finger, object, ...), got a file of kind {kind}"
            raise document.place(("grasp",)).error(message, ("grasp",))
        document.put(("grasp",), inner)
        document.notes += [f"grasp.{note}" for note in inner.notes]
    for path in ((), ("grasp",)):
        if path == () or isinstance(document.value.get("grasp"), dict):
            _put_in_fingers(document, path, main)


def _put_in_fingers(document: Document, scene: KeyPath, main: Path) -> None:
    """Put in place the fingers of the scene at a path, that stand in other files."""
    data = document.get(scene)
    many = data.get("fingers")
    paths: list[KeyPath] = [(*scene, "finger")] if "finger" in data else []
    paths += [(*scene, "fingers", name) for name in many if isinstance(name, str)] if isinstance(many, dict) else []
    if "extends" in data and scene == ():
        paths.append(())
    for path in paths:
        value = document.get(path)
        if isinstance(value, str) or (isinstance(value, dict) and "extends" in value):
            document.put(path, _resolved(document, path, main, (os.path.realpath(main),)))


def _resolved(document: Document, path: KeyPath, main: Path, within: tuple[str, ...]) -> Document:
    """The finger at ``path``, read from the file that it names."""
    part = document.part(path)
    key: KeyPath = ("extends",) if isinstance(part.value, dict) else ()
    place, target = part.place(key), part.get(key)
    if not isinstance(target, str):
        raise place.error("expected the path of a finger file", path + key)
    file = place.named_file(target, main, "finger file", path + key)
    # Resolved, so that links do not hide a circle.
    if os.path.realpath(file) in within:
        raise place.error(f"{target} leads back to itself", path + key)
    base = read_yaml(file, name=os.path.normpath(file))
    if not isinstance(base.value, dict) or "finger" in base.value:
        raise base.places[()].error("expected a finger (rod, damping, tendons, ...)")
    take_version(base)
    if "extends" in base.value:
        base = _resolved(base, (), file, (*within, os.path.realpath(file)))
    if isinstance(part.value, dict):
        del part.value["extends"]
        part.forget(("extends",))
        return base.merged(part)
    return base


def _check_version(document: Document) -> None:
    if "schema_version" not in document.value:
        message = f"missing; the file needs its format version: schema_version: {VERSION}"
        raise document.places[()].error(message, ("schema_version",))
    version, place = document.value["schema_version"], document.place(("schema_version",))
    if isinstance(version, bool) or not isinstance(version, int) or version != VERSION:
        message = f"unsupported format: expected {VERSION}, got {version!r}"
        raise place.error(message, ("schema_version",))


def take_version(document: Document) -> None:
    """Check and remove the version of a finger file."""
    _check_version(document)
    del document.value["schema_version"]
    document.forget(("schema_version",))


def read_overrides(overrides: Overrides, name: str | None = None) -> list[Change]:
    """Read overrides, given as ``"key.path=value"`` texts or as a mapping from key path to value.

    Values in texts are read as YAML; entries of lists are ``masses[0]`` or ``masses.0``. In errors, ``name`` is what
    a mapping is called.
    """
    if isinstance(overrides, str) or not isinstance(overrides, Iterable):
        raise InputError(f"overrides: expected a list of key.path=value texts, or a mapping, got {overrides!r:.60}")
    words = list(overrides)
    for word in words:
        if not isinstance(word, str):
            raise InputError(f"overrides: expected a text, got {word!r:.60}")
    if isinstance(overrides, Mapping):
        places = {key: Place(name or f"override {key}") for key in words}
        return [(Document.path_of(key, name or key), Document.at(places[key], overrides[key])) for key in words]
    return [_read(text) for text in words]


def _read(text: str) -> tuple[KeyPath, Document]:
    name = f"--set {text}"
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise InputError("expected key.path=value", file=name)
    path = Document.path_of(key.strip(), name)
    try:
        document = parse_yaml(value, name)
    except InputError as error:
        raise InputError(error.message, file=name, key=dotted(path)) from None
    return path, Document.at(Place(name), document.value)
