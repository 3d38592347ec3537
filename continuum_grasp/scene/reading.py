"""From a file to a scene."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeAlias, TypeVar, overload

from continuum_grasp.base import ConfigurationKind, InputError, command_line, named_value
from continuum_grasp.scene.assembly import AssembledData, Overrides, read_overrides, take_version
from continuum_grasp.scene.config_kinds import kind_of, kinds
from continuum_grasp.scene.simulate import Scene

if TYPE_CHECKING:
    from pydantic import BaseModel

Loaded: TypeAlias = Any
"""A scene of any kind: which one, the content of its file decides."""
Kind = TypeVar("Kind")


@dataclass
class ConfigurationData(AssembledData):
    """Plain data of a configuration; its keys say the kind."""

    _scene: Any = field(default=None, init=False, repr=False, compare=False)

    @classmethod
    def load(cls, path: str | Path, overrides: Overrides = ()) -> Self:
        """The data of a file with changes from outside, as ``continuum_grasp.scene.load`` takes them."""
        return cls.read(path, read_overrides(overrides))

    @classmethod
    def given(cls, value: Any, kind: type[Any], overrides: Overrides = ()) -> Self:
        """The data of a scene that is given as such, as a mapping, or by the path of its file."""
        if not isinstance(value, kind | Mapping):
            return cls.of_file(value, kind, overrides, ", or a mapping")
        data = cls.of(value, kind.__name__, value.file if isinstance(value, kind) else None)
        for path, new in read_overrides(overrides):
            data.override(path, new)
        return data

    @classmethod
    def of_file(cls, path: Any, kind: Any, overrides: Overrides, others: str = "") -> Self:
        """The data of a file whose scene is of a class, or of one of some; ``others`` is what else is accepted."""
        names = [accepted.__name__ for accepted in (kind if isinstance(kind, tuple) else (kind,))]
        if not isinstance(path, (str, os.PathLike)):
            raise InputError(f"expected a {' or '.join(names)} or the path of its file{others}, got {path!r:.80}")
        data = cls.load(Path(path), overrides)
        if not isinstance(data.scene, kind):
            raise _other_kind(path, names, data.scene)
        return data

    @property
    def kind(self) -> ConfigurationKind:
        """Kind of the configuration, by its keys."""
        return kind_of(self.value)

    @property
    def scene(self) -> Any:
        """The scene, of the class of its kind; what else it names is checked, too."""
        # Warnings would name the line of functools.cached_property.
        if self._scene is None:
            kind = self.kind
            if kind.name == "finger":
                take_version(self)
            self._scene = named_value(kind.reader)(self) if kind.reader else self.validated(kind.scene_class)
        return self._scene


def load(path: str | Path, overrides: Overrides = ()) -> Loaded:
    """Read a configuration and check all of it.

    Parameters
    ----------
    path : path-like
        A YAML file: a scene for simulation, one with parameters to ``estimate``, a grasp (it has an ``object``), a
        closed loop (it has a ``controller``), a mission (that and a ``grasp``), a plan (it has a ``goal``), a sweep
        (it names a ``scene``), a design (that and ``variables``) or a finger (it has a ``rod``).
        ``finger: other.yaml`` and ``finger: {extends: other.yaml, ...}`` insert another file, whose path is relative
        to this one; keys next to ``extends`` replace the other file's keys, mappings key by key. The same holds for
        ``grasp: other.yaml`` of a mission or plan.
    overrides : iterable of str, or mapping
        ``"key.path=value"`` texts, values read as YAML, or a mapping from key path to value; applied in
        order, as if they stood in the file: paths of other files are relative to it.

    Returns
    -------
    Scene, IdentifyScene, GraspScene, ControlScene, MissionScene, Sweep, Design or Finger
        By the content of the file; frozen, all values in SI units.

    Raises
    ------
    InputError
        With file, line, column and key of every fault.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> scene = cg.load("configs/simulate/hanging.yaml", ["time.duration=0.5"])
    >>> type(scene).__name__, scene.time.duration, scene.finger.rod.length  # s, m
    ('Scene', 0.5, 0.6)
    """
    return ConfigurationData.load(path, overrides).scene


@overload
def scene_of(given: Any) -> Scene: ...
@overload
def scene_of(given: Kind | str | os.PathLike[str], kind: type[Kind], overrides: Overrides = ()) -> Kind: ...
@overload
def scene_of(given: Any, kind: tuple[type, ...], overrides: Overrides = ()) -> Any: ...
def scene_of(given: Any, kind: Any = Scene, overrides: Overrides = ()) -> Any:
    """Return a given scene, or read it from its file; ``overrides`` apply to a file, as in `load`.

    ``kind`` is one class, or several possible classes. A result counts as the simulation that repeats it.
    """
    if kind is Scene and not isinstance(given, Scene) and (simulated := getattr(given, "simulated", None)) is not None:
        return simulated
    return given if isinstance(given, kind) else ConfigurationData.of_file(given, kind, overrides).scene


def _other_kind(file: str | os.PathLike[str], names: list[str], loaded: BaseModel) -> InputError:
    """The error that a file is of another kind than those wanted, and which command takes it."""
    asked = [kind for kind in kinds().values() if kind.class_name in names]
    got = kind_of_scene(loaded)
    expected = " or ".join(kind.expected for kind in asked)
    advice = f" ({command_line(got.command)})" if got.command else ""
    return InputError(f"expected {expected}, got {got.words}{advice}", file=os.fspath(file))


def kind_of_scene(loaded: BaseModel) -> ConfigurationKind:
    return next(kind for kind in kinds().values() if kind.class_name == type(loaded).__name__)
