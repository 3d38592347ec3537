"""Objects that hold what does not pickle, CasADi graphs or loaded C, and are made anew from their arguments."""

from __future__ import annotations

import copy
from typing import Any, Self


class Remade:
    """Pickles and copies by the arguments of its constructor.

    An object that arrives in another process, or is copied deeply, is constructed there as it was here; compiled code
    is found in the cache by its content.
    """

    _arguments: tuple[tuple[Any, ...], dict[str, Any]]

    def __new__(cls, *arguments: Any, **named: Any) -> Self:
        made = super().__new__(cls)
        made._arguments = tuple(map(_own, arguments)), {name: _own(value) for name, value in named.items()}
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        return _remake, (type(self), *self._arguments), self.__getstate__()

    def __getstate__(self) -> Any:
        """Changes since the object was made; for ``__setstate__`` of the copy, None for none."""
        return None


def _own(value: Any) -> Any:
    """A copy of what the caller may change later."""
    return copy.copy(value) if isinstance(value, list | dict) or hasattr(value, "__array__") else value


def _remake(cls: type[Remade], arguments: tuple[Any, ...], named: dict[str, Any]) -> Remade:
    return cls(*arguments, **named)
