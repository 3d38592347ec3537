"""From a file to a scene."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias, TypeVar, overload

from continuum_grasp.base import InputError, named_value
from continuum_grasp.scene.assembly import ConfigurationData, Overrides, apply_override, read_overrides, take_version
from continuum_grasp.scene.config_kinds import each_of, other_kind
from continuum_grasp.scene.simulate import Scene

Loaded: TypeAlias = Any
"""A scene of any kind: which one, the content of its file decides."""
Kind = TypeVar("Kind")


def load(path: str | Path, overrides: Overrides = ()) -> Loaded:
    """Read a configuration and check all of it.

    Parameters
    ----------
    path : path-like
        A YAML file: a scene for simulation, one with parameters to ``estimate``, a grasp (it has an ``object``), a
        closed loop (it has a ``controller``), a mission (that and a ``grasp``), a plan (it has a ``goal``), a sweep
        (it names a ``scene``), a design (that and ``variables``) or a finger (it has a ``rod``).
        Where it says ``finger: other.yaml`` or ``finger: {extends: other.yaml, ...}``, that file is read,
        relative to the file that names it; keys given beside ``extends`` replace those of the other file,
        mappings key by key. So is ``grasp: other.yaml`` of a mission or plan.
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
        With file, line, column and key of everything that is wrong.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> scene = cg.load("configs/simulate/hanging.yaml", ["time.duration=0.5"])
    >>> type(scene).__name__, scene.time.duration, scene.finger.rod.length  # s, m
    ('Scene', 0.5, 0.6)
    """
    return load_placed(path, overrides)[0]


def load_placed(path: str | Path, overrides: Overrides = ()) -> tuple[Loaded, ConfigurationData]:
    """Load a scene, as `load` does, with the document that says where everything was written."""
    document = ConfigurationData.read(path, read_overrides(overrides))
    kind = document.kind
    if kind.name == "finger":
        take_version(document)
    loaded: Any = document.validated(kind.scene_class)
    if kind.finish:
        loaded = named_value(kind.finish)(loaded, document, document.file)
    return loaded, document


@overload
def scene_of(given: Scene | str | os.PathLike[str]) -> Scene: ...
@overload
def scene_of(given: Kind | str | os.PathLike[str], kind: type[Kind], overrides: Overrides = ()) -> Kind: ...
@overload
def scene_of(given: Any, kind: tuple[type, ...], overrides: Overrides = ()) -> Any: ...
def scene_of(given: Any, kind: Any = Scene, overrides: Overrides = ()) -> Any:
    """Return a scene that is given as such, or read it from its file; ``overrides`` are for a file, as in `load`.

    ``kind`` is a class, or classes of which one will do.
    """
    return given if isinstance(given, kind) else _read(given, kind, overrides)[0]


def placed_scene_of(given: Any, kind: type[Any], overrides: Overrides = ()) -> tuple[Any, ConfigurationData]:
    """Return a scene that is given as such, as a mapping or by its file, and the data that say where all is written."""
    if not isinstance(given, kind | Mapping):
        return _read(given, kind, overrides, ", or a mapping")
    data = ConfigurationData.stated(given, kind.__name__, given.file if isinstance(given, kind) else None)
    for path, new in read_overrides(overrides):
        apply_override(data, path, new)
    return data.validated(kind), data


def _read(given: Any, kind: Any, overrides: Overrides, others: str = "") -> tuple[Any, ConfigurationData]:
    if not isinstance(given, (str, os.PathLike)):
        names = " or ".join(accepted.__name__ for accepted in each_of(kind))
        raise InputError(f"expected a {names} or the path of its file{others}, got {given!r:.80}")
    loaded, document = load_placed(Path(given), overrides)
    if not isinstance(loaded, kind):
        raise other_kind(given, kind, loaded)
    return loaded, document
