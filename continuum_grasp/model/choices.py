"""Options of a model: keywords, or what its scene states, each checked for its kind."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from numbers import Integral, Real
from operator import attrgetter
from typing import Any, TypedDict

import numpy as np

from continuum_grasp.arguments import instance
from continuum_grasp.errors import InputError
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.learned_residual import LearnedResidual
from continuum_grasp.scene.loads import ForceLoad, Load, MomentLoad
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
    loads: Sequence[Load] | None
    tip_force: bool | None
    input_rates: bool | None
    residual: LearnedResidual | None


_IN_SCENE = {
    **{name: name for name in ("contacts", "gravity", "parameters", "loads")},
    **{name: f"fidelity.{name}" for name in ("family", "elements", "bending_range", "accuracy", "residual")},
}
"""Path in a scene of what is also an option."""


class Choices:
    """Options of a model, completed from its scene; each method raises InputError for what is of another kind."""

    def __init__(self, given: Scene | Finger, options: ModelOptions) -> None:
        unknown = sorted(options.keys() - ModelOptions.__annotations__.keys())
        if unknown:
            known = ", ".join(ModelOptions.__annotations__)
            raise TypeError(f"unknown option {unknown[0]!r} of a model: expected some of {known}")
        if not isinstance(given, Scene | Finger):
            hint = " (read a file with load)" if isinstance(given, str) or hasattr(given, "__fspath__") else ""
            got = f"{type(given).__name__} {given!r:.60}"
            raise InputError(f"expected a Scene or a Finger, got {got}{hint}", key="finger")
        self.scene = given if isinstance(given, Scene) else None
        self.finger: Finger = given.finger if isinstance(given, Scene) else given
        self._options: dict[str, Any] = dict(options)

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

    def number(self, name: str) -> float | None:
        """A finite number."""
        value = self[name]
        return None if value is None else _number(name, value)

    def numbers(self, name: str, count: int | None = None) -> tuple[float, ...] | None:
        """A list of finite numbers, of a given length."""
        wanted = f"a list of {count or ''} numbers".replace("  ", " ")
        found: tuple[float, ...] | None = self._list(name, wanted, _number)
        if found is not None and count is not None and len(found) != count:
            raise InputError(f"expected {wanted}, got {len(found)}: {self[name]!r:.60}", key=name)
        return found

    def elements(self) -> int | tuple[float, ...] | None:
        """A number of elements, or their lengths."""
        value = self["elements"]
        if value is None or (isinstance(value, Integral) and not isinstance(value, bool)):
            return value if value is None else int(value)
        if isinstance(value, Real | str):
            raise InputError(f"expected a whole number of elements or their lengths, got {value!r:.60}", key="elements")
        return self.numbers("elements")

    def word(self, name: str, allowed: Iterable[str]) -> str | None:
        """One of some words."""
        value = self[name]
        if value is not None and (not isinstance(value, str) or value not in allowed):
            raise InputError(f"unknown {name} {value!r:.60}: expected one of {', '.join(allowed)}", key=name)
        return value

    def words(self, name: str) -> tuple[str, ...]:
        """A list of words."""
        return self._list(name, "a list of names", _name) or ()

    def switch(self, name: str) -> bool | None:
        """True or false."""
        value = self[name]
        if value is not None and not isinstance(value, bool | np.bool_):
            raise InputError(f"expected True or False, got {value!r:.60}", key=name)
        return None if value is None else bool(value)

    def residual(self) -> LearnedResidual | None:
        """What was learned from logs."""
        return None if self["residual"] is None else instance("residual", self["residual"], LearnedResidual)

    def loads(self) -> tuple[Load, ...]:
        """Point loads."""
        return self._list("loads", "a list of loads", lambda *entry: instance(*entry, ForceLoad, MomentLoad)) or ()

    def _list(self, name: str, wanted: str, each: Callable[[str, Any], Any]) -> tuple[Any, ...] | None:
        value = self[name]
        if value is None:
            return None
        single = isinstance(value, str | Real | ForceLoad | MomentLoad)
        if single or isinstance(value, dict) or not isinstance(value, Iterable) or getattr(value, "ndim", 1) != 1:
            hint = f" (write [{value!r:.40}])" if single else ""
            raise InputError(f"expected {wanted}, got {value!r:.60}{hint}", key=name)
        return tuple(each(f"{name}[{k}]", entry) for k, entry in enumerate(value))


def _name(key: str, value: Any) -> str:
    if not isinstance(value, str):
        raise InputError(f"expected a name, got {value!r:.60}", key=key)
    return value


def _number(key: str, value: Any) -> float:
    # bool is a Real, but True is no length; an integer may be too large for a double.
    try:
        number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"expected a finite number, got {value!r:.60}", key=key)
    return number
