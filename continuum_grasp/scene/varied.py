"""Keys shared by configurations that vary keys of one scene."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import BeforeValidator, Field, PrivateAttr

from continuum_grasp.errors import InputError
from continuum_grasp.scene.assembly import path_of
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.shape import Shape
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Configuration, Real, Value

if TYPE_CHECKING:
    from continuum_grasp.scene.assembly import Overrides

Key = Annotated[str, Field(min_length=1)]
_IN_UNIT = {
    *("values", "uniform", "log_uniform", "normal", "choice", "plus"),
    *("min", "max", "start", "amount"),
}
"""Keys whose values have the unit of the scene's key that they stand for."""


def _in_si(given: Any) -> Any:
    # Without the scene itself: a key has one unit in all shapes of objects, and in grasps and closed loops.
    shapes = Shape(GraspScene), Shape(ControlScene)
    return {key: _way_in_si(key, way, shapes) for key, way in given.items()} if isinstance(given, dict) else given


InSI = BeforeValidator(_in_si)
"""For ways to vary keys: texts such as 65 mm become numbers in the SI unit that each key has in the scene."""


def _way_in_si(key: Any, way: Any, shapes: Sequence[Shape]) -> Any:
    try:
        path = path_of(key, "")
    except (InputError, TypeError):  # reported where the key is looked up in the scene
        return way
    entries = dict(way) if isinstance(way, dict) else {}
    texts = [text for text in entries.values() for text in (text if isinstance(text, list | tuple) else [text])]
    if not any(isinstance(text, str | list | tuple | dict) for text in texts):
        return way
    shape = next((candidate for candidate in shapes if candidate.unit(path, None)), shapes[0])
    for name in _IN_UNIT & entries.keys():
        entry = entries[name]
        several = isinstance(entry, list | tuple)
        entries[name] = [shape.in_si(path, number) for number in entry] if several else shape.in_si(path, entry)
    return entries or way


class Follow(Value):
    """A key that is no choice of its own, but follows one that is varied."""

    key: Key
    """The varied key, which must have numbers."""
    times: Annotated[Real, Field(examples=[0.5]), Unit("unit of this key per unit of that key")] = 1.0
    """Factor [unit of this key per unit of that key]."""
    plus: Annotated[Real, Field(examples=[0.01, "10 mm"]), Unit(None)] = 0.0
    """Summand, in the unit of the key that follows."""


class Varied(Configuration):
    """A scene of which some keys are varied."""

    scene: str
    """Path of the scene that is varied, relative to this file."""
    set: dict[Key, Any] = Field(default_factory=dict)
    """Key paths in the scene with values that differ from its file in all runs."""
    follow: Annotated[dict[Key, Follow], InSI] = Field(default_factory=dict)
    """Key paths in the scene that follow a varied key: times its value, plus a number."""

    _folder: Path = PrivateAttr(default=Path())

    @property
    def varied_keys(self) -> tuple[str, ...]:
        """Key paths in the scene of what varies."""
        return tuple(self.follow)

    def check_follow(self, varied: Collection[str]) -> None:
        """Refuse keys that follow none of the varied ones, or are among them."""
        for key, follow in self.follow.items():
            if key in varied:
                raise ValueError(f"follow: {key!r} is varied already")
            if follow.key not in varied:
                raise ValueError(f"follow: {key!r} follows {follow.key!r}, which is not varied")

    def in_folder(self, folder: Path) -> Self:
        """A copy whose paths are relative to another folder than the working directory."""
        moved = self.model_copy()
        moved._folder = folder
        return moved

    def changed(self, changes: Overrides) -> Self:
        return super().changed(changes).in_folder(self._folder)

    @property
    def file(self) -> Path:
        """A file beside which the paths lie."""
        return self._folder / type(self).__name__
