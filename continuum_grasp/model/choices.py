"""Options of a model: keywords, or what its scene states."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from operator import attrgetter
from typing import Any, TypedDict

import numpy as np

from continuum_grasp.arguments import choice, real_array, shown
from continuum_grasp.errors import InputError
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.loads import ForceLoad, MomentLoad
from continuum_grasp.scene.methods import FAMILIES
from continuum_grasp.scene.simulate import Scene


class ModelOptions(TypedDict, total=False):
    """Keywords of ``FingerModel`` and ``System``, described there; None is as good as absent."""

    contacts: Sequence[float] | None
    gravity: Sequence[float] | None
    family: str | None
    elements: int | Sequence[float] | None
    bending_range: float | None
    accuracy: float | None
    parameters: Sequence[str] | None
    loads: Sequence[ForceLoad | MomentLoad] | None
    tip_force: bool | None
    input_rates: bool | None
    slack_stiffness: float | None


_IN_SCENE = {
    **{name: name for name in ("contacts", "gravity", "parameters", "loads")},
    **{name: f"fidelity.{name}" for name in ("family", "elements", "bending_range", "accuracy")},
}
"""Path in a scene of what is also an option."""


class Choices:
    """Options of a model, completed from its scene."""

    def __init__(self, given: Scene | Finger, options: ModelOptions) -> None:
        if unknown := sorted(options.keys() - ModelOptions.__annotations__.keys()):
            known = ", ".join(ModelOptions.__annotations__)
            raise TypeError(f"unknown option {unknown[0]!r} of a model: expected some of {known}")
        self.scene = given if isinstance(given, Scene) else None
        self.finger: Finger = given.finger if isinstance(given, Scene) else given
        self._options = {name: tuple(v) if isinstance(v, Iterator) else v for name, v in options.items()}

    def __getitem__(self, name: str) -> Any:
        """The option, that of the scene where not given, or None."""
        value = self._options.get(name)
        if value is None and self.scene is not None and name in _IN_SCENE:
            value = attrgetter(_IN_SCENE[name])(self.scene)
        return value

    def given(self, *names: str) -> bool:
        """Whether one of the options was given."""
        return any(self._options.get(name) is not None for name in names)

    def located(self, error: InputError) -> InputError:
        """The error with the path in the scene in place of an option that was not given."""
        name = re.match(r"\w*", error.key or "")
        word = name.group() if name else ""
        if not error.key or self.scene is None or self._options.get(word) is not None:
            return error
        return InputError(error.message, key=_IN_SCENE.get(word, word) + error.key[len(word) :])

    def numbers(self, name: str) -> tuple[float, ...] | None:
        """Finite numbers."""
        if self[name] is None:
            return None
        numbers = real_array(name, self[name])
        if numbers.ndim != 1 or not np.all(np.isfinite(numbers)):
            raise InputError(f"expected a list of finite numbers, got {shown(self[name])}", key=name)
        return tuple(numbers.tolist())

    @property
    def family(self) -> str | None:
        """Name of a family."""
        return None if self["family"] is None else str(choice("family", self["family"], FAMILIES))
