"""From a file to a scene."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, TypeAlias, TypeVar, overload

from continuum_grasp.scene.assembly import ConfigurationData, Overrides
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
    return ConfigurationData.load(path, overrides).scene


@overload
def scene_of(given: Any) -> Scene: ...
@overload
def scene_of(given: Kind | str | os.PathLike[str], kind: type[Kind], overrides: Overrides = ()) -> Kind: ...
@overload
def scene_of(given: Any, kind: tuple[type, ...], overrides: Overrides = ()) -> Any: ...
def scene_of(given: Any, kind: Any = Scene, overrides: Overrides = ()) -> Any:
    """Return a scene that is given as such, or read it from its file; ``overrides`` are for a file, as in `load`.

    ``kind`` is a class, or classes of which one will do. Results are what a simulation repeats them by.
    """
    if kind is Scene and not isinstance(given, Scene) and (simulated := getattr(given, "simulated", None)) is not None:
        return simulated
    return given if isinstance(given, kind) else ConfigurationData.of_file(given, kind, overrides).scene
