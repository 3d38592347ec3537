"""From a file to a scene."""

from __future__ import annotations

import os
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypeVar, overload

from continuum_grasp.errors import InputError
from continuum_grasp.scene.assembly import (
    Overrides,
    apply_override,
    assembled,
    kind_of,
    placed,
    read_overrides,
    take_version,
    validated,
)
from continuum_grasp.scene.document import Document, Place
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.simulate import Scene

if TYPE_CHECKING:
    from pydantic import BaseModel

    from continuum_grasp.scene.control import ControlScene
    from continuum_grasp.scene.design import Design
    from continuum_grasp.scene.grasp import GraspScene
    from continuum_grasp.scene.mission import MissionScene
    from continuum_grasp.scene.plan import PlanScene
    from continuum_grasp.scene.sweep import Sweep

    Loaded: TypeAlias = Scene | GraspScene | ControlScene | MissionScene | PlanScene | Finger | Sweep | Design


class _Kind(NamedTuple):
    module: str
    model: str
    words: str
    keys: str
    """Some by which the kind is recognized."""
    command: str | None
    """Verb that runs the kind; None: a finger alone is not run."""

    @property
    def expected(self) -> str:
        """Expected kind of file, as errors name it."""
        return f"{self.words} ({self.keys}, ...)"


KINDS = {
    "simulate": _Kind("simulate", "Scene", "a scene", "finger, gravity", "simulate"),
    "identify": _Kind("identify", "IdentifyScene", "an identification", "finger, estimate", "identify"),
    "grasp": _Kind("grasp", "GraspScene", "a grasp", "finger, object", "grasp"),
    "mpc": _Kind("control", "ControlScene", "a closed loop", "finger, controller", "mpc"),
    "mission": _Kind("mission", "MissionScene", "a mission", "grasp, controller", "mpc"),
    "plan": _Kind("plan", "PlanScene", "a plan", "finger, goal", "plan"),
    "sweep": _Kind("sweep", "Sweep", "a sweep", "scene, vary", "sweep"),
    "design": _Kind("design", "Design", "a design", "scene, variables, minimize", "design"),
    "finger": _Kind("finger", "Finger", "a finger alone", "rod", None),
}
"""Kinds of configurations, by name."""
DEFINITIONS = "definitions.json"
"""File beside the schemas of all kinds, with the definitions that they share."""


def model_of(kind: str) -> type[BaseModel]:
    if kind not in KINDS:
        raise InputError(f"no such kind of configuration: expected one of {', '.join(KINDS)}, got {kind!r}")
    # A kind's module is loaded with its first file: a simulation needs none of those of control.
    module = import_module(f"continuum_grasp.scene.{KINDS[kind].module}")
    model: type[BaseModel] = getattr(module, KINDS[kind].model)
    return model


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


def load_placed(path: str | Path, overrides: Overrides = ()) -> tuple[Loaded, Document]:
    """Load a scene, as `load` does, with the document that says where everything was written."""
    document = assembled(path, read_overrides(overrides))
    kind = kind_of(document.value)
    if kind == "finger":
        take_version(document)
    loaded: Any = validated(document, model_of(kind))
    if kind == "sweep":
        from continuum_grasp.scene.variation import variation_of

        variation_of(loaded, document, path)
        loaded = loaded.in_folder(Path(path).parent)
    elif kind == "design":
        from continuum_grasp.scene.design_space import design_space_of

        design_space_of(loaded, document, path)
        loaded = loaded.in_folder(Path(path).parent)
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


def placed_scene_of(given: Any, kind: type[Any], overrides: Overrides = ()) -> tuple[Any, Document, Path]:
    """Build a scene from a mapping, with document and file, which say where everything was written."""
    if not isinstance(given, kind | Mapping):
        return *_read(given, kind, overrides, ", or a mapping"), Path(given)
    document = placed(given, Place(kind.__name__))
    for path, new in read_overrides(overrides):
        apply_override(document, path, new)
    return validated(document, kind), document, given.file if isinstance(given, kind) else Path(kind.__name__)


def _read(given: Any, kind: Any, overrides: Overrides, others: str = "") -> tuple[Any, Document]:
    if not isinstance(given, (str, os.PathLike)):
        names = " or ".join(accepted.__name__ for accepted in _each(kind))
        raise InputError(f"expected a {names} or the path of its file{others}, got {given!r:.80}")
    loaded, document = load_placed(Path(given), overrides)
    if not isinstance(loaded, kind):
        raise other_kind(given, kind, loaded)
    return loaded, document


def _each(kind: type | tuple[type, ...]) -> tuple[type, ...]:
    return kind if isinstance(kind, tuple) else (kind,)


def other_kind(file: str | os.PathLike[str], wanted: type | tuple[type, ...], loaded: Loaded) -> InputError:
    """The error that a file is of another kind than those wanted, and which command takes it."""
    names = [accepted.__name__ for accepted in _each(wanted)]
    asked = [kind for kind in KINDS.values() if kind.model in names]
    got = KINDS[kind_of_scene(loaded)]
    advice = f" (continuum-grasp {got.command})" if got.command else ""
    expected = " or ".join(kind.expected for kind in asked)
    return InputError(f"expected {expected}, got {got.words}{advice}", file=os.fspath(file))


def kind_of_scene(loaded: Loaded) -> str:
    return next(name for name, kind in KINDS.items() if kind.model == type(loaded).__name__)
