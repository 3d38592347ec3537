"""Arguments of public functions, checked: the value itself, or an `InputError` that names the argument."""

from __future__ import annotations

import inspect
import math
import re
import sys
from collections import abc
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import wraps
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.base.errors import InputError

Function = TypeVar("Function", bound=Callable[..., Any])
GONE = {
    "loss": "outliers are named; leave their rows out by `fitted` of the data, or by holdout_rows or window of a set",
    "precision": "models compute in double precision; take export_c(..., real='float'), or a Controller's precision",
}
"""Arguments that functions had once, and what to write instead."""


class CheckedArgument(NamedTuple):
    """An argument of a public function, by its name; checks return its value or raise an `InputError`."""

    name: str | None
    value: Any

    def refused(self, expected: str) -> InputError:
        """The error that says what was expected, and what was given."""
        return InputError(f"{expected}, got {self.shown()}", key=self.name)

    def shown(self, width: int = 60) -> str:
        """Return the beginning of the value for a message; its type if it cannot be printed."""
        try:
            return f"{self.value!r:.{width}}"
        except Exception:  # integers of over 4300 digits, and whatever a foreign __repr__ raises
            return f"a {type(self.value).__name__}"

    def choice(self, allowed: Iterable[Any]) -> Any:
        """A choice of some words or numbers."""
        known, value = tuple(allowed), self.value
        # Not by ``in``: what compares to an array, as some foreign types do, has no truth.
        if isinstance(value, str | Integral) and any(value is option or value == option for option in known):
            return value
        raise self.refused(f"expected one of {', '.join(map(str, known))}")

    def some_of(self, known: Collection[str], kind: str) -> list[str]:
        """Names of a kind, each known and given once, one at least."""
        names = list(self.value)
        for name in names:
            if name not in known:
                raise CheckedArgument(self.name, name).refused(f"expected some of {', '.join(known)}")
        if not names or len(set(names)) < len(names):
            raise InputError(f"expected one {kind} or more, each once, got {names}", key=self.name)
        return names

    def whole(self, least: int = 1, most: int = 2**31 - 1) -> int:
        """A whole number of a range, ends included; 1 or more, and one that C can hold, where no other is given."""
        value = self.value
        if not isinstance(value, Integral) or isinstance(value, bool) or not least <= int(value) <= most:
            wanted = f", {least} or more" if most == 2**31 - 1 else f" from {least} to {most}"
            raise self.refused(f"expected a whole number{wanted}")
        return int(value)

    def number(self, least: float | None = None, most: float = math.inf) -> float:
        """A number of a range, ends included; a finite one above zero where no least one is given."""
        real = _double(self.value)
        if least is None and not 0.0 < real < math.inf:
            raise self.refused("expected a finite number above 0")
        low = 0.0 if least is None else least
        if not low <= real <= most:
            raise self.refused(f"expected a number from {low:g} to {most:g}")
        return real

    def instance(self, *kinds: type) -> Any:
        """An object of one of some classes."""
        if not isinstance(self.value, kinds):
            raise self.refused(f"expected {' or '.join(map(_words, kinds))}")
        return self.value

    def unmasked(self) -> NDArray[Any]:
        """Return an array with NaN for masked entries; ``numpy.asarray`` would take the numbers below the mask."""
        # numpy.ma takes 8 ms to load, and whoever has a masked array has loaded it.
        if "numpy.ma" in sys.modules and isinstance(self.value, np.ma.MaskedArray):
            return np.where(np.ma.getmaskarray(self.value), np.nan, self.value.data)
        return np.asarray(self.value)

    def doubles(self) -> NDArray[np.float64]:
        """Return a copy in double precision, with NaN for masked entries, and infinity for numbers beyond the range of
        doubles, so that checks of ranges detect them.

        ``TypeError`` or ``ValueError`` if it is ragged, or no array of real numbers (for example, text or complex).
        """
        array = self.unmasked()
        if array.dtype.kind not in "biufO":
            raise TypeError(f"expected real numbers, got {array.dtype}")
        try:
            with np.errstate(over="ignore"):
                return array.astype(float)
        except OverflowError:  # a Python integer or fraction beyond 1.8e308
            return np.array([_nearest(number) for number in array.ravel().tolist()]).reshape(array.shape)

    def vector(self, size: int, *, check: bool = True) -> NDArray[np.float64]:
        """A vector of a size; ``check``: a finite one."""
        try:
            array = self.doubles().ravel()
        except (TypeError, ValueError) as error:
            raise self.refused(f"expected {size} numbers") from error
        if array.size != size:
            raise InputError(f"expected {size} entries, got {array.size}", key=self.name)
        return CheckedArgument(self.name, array).array(finite=True) if check else array

    def array(self, *, finite: bool = False) -> NDArray[np.float64]:
        """A contiguous array of doubles, NaN where masked; an error for anything but an array of real numbers.

        ``finite``: for the first entry that is NaN or infinite, too.
        """
        array = self._reals()
        if finite and not np.isfinite(array).all():
            at = np.argwhere(~np.isfinite(array))[0]
            where = f"[{', '.join(map(str, at.tolist()))}]" if at.size else ""
            raise InputError(f"{self.name}{where}: expected a finite number, got {array[tuple(at)]}")
        return array

    def _reals(self) -> NDArray[np.float64]:
        try:
            array = self.unmasked()
            if np.iscomplexobj(array):
                raise InputError("expected real numbers, got complex ones", key=self.name)
            # numpy would read texts and dates as numbers.
            if array.dtype.kind in "OUSMm" and not all(isinstance(v, Real) for v in array.ravel().tolist()):
                raise TypeError
            return np.ascontiguousarray(array, dtype=float)
        except InputError:
            raise
        except Exception as error:  # whatever the conversion of something foreign raises
            raise self.refused("expected an array of numbers") from error


def _nearest(value: Any) -> float:
    """A number in double precision, infinite beyond."""
    try:
        return float(value)
    except OverflowError:
        return math.copysign(math.inf, 1 if value > 0 else -1)


def _double(value: Any) -> float:
    """Return a number in double precision; NaN for a value that is no number."""
    try:
        return float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    except OverflowError:  # a whole number beyond the doubles
        return math.inf if value > 0 else -math.inf


def check_arguments(function: Function) -> Function:
    """Check the arguments of every call against the annotations of a function; the first that does not fit is named.

    Options of an ``Unpack[...]`` are arguments like others. Classes, numbers, words, sequences, mappings, functions and
    their unions are checked. Arrays are left to whoever computes with them, and names that are there for type checkers
    alone are not looked up.
    """
    signature = inspect.signature(function)
    more = next(
        (name for name, parameter in signature.parameters.items() if parameter.kind is parameter.VAR_KEYWORD), ""
    )
    kinds: dict[str, Any] = {}

    @wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        if not kinds:
            kinds.update(_annotations(function))
        try:
            bound = signature.bind(*arguments, **named).arguments
        except TypeError:
            for name in GONE.keys() & named.keys() - signature.parameters.keys():
                raise InputError(GONE[name], key=name) from None
            return function(*arguments, **named)  # raises it in the words of Python
        for name, value in {**bound, **bound.get(more, {})}.items():
            kind = kinds.get(name, Any)
            if not _fits(value, kind):
                raise CheckedArgument(name, value).refused(f"expected {_words(kind)}")
        return function(*arguments, **named)

    call.checks_arguments = True  # type: ignore[attr-defined]
    return cast(Function, call)


def _annotations(function: Callable[..., Any]) -> dict[str, Any]:
    """Types of the parameters of a function; Any where a name is not there when it runs."""
    types = dict[str, Any]()
    for name, parameter in inspect.signature(function).parameters.items():
        plain = parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY)
        if parameter.kind is parameter.VAR_KEYWORD and str(parameter.annotation).startswith("Unpack["):
            types |= get_type_hints(*get_args(eval(parameter.annotation, function.__globals__)))
        if plain and parameter.annotation is not parameter.empty:
            try:
                types[name] = eval(parameter.annotation, function.__globals__)
            except NameError:
                types[name] = Any
    return types


def _fits(value: Any, kind: Any) -> bool:
    """Return whether a value is of a kind, as far as this is clear without a computation."""
    if kind is Any or isinstance(kind, TypeVar):
        return True
    if kind is None or kind is type(None):
        return value is None
    if kind is bool:
        return isinstance(value, bool | np.bool_)
    if kind in (int, float):
        real = isinstance(value, Integral if kind is int else Real) and not isinstance(value, bool)
        return real and not (isinstance(value, float) and math.isnan(value))
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _fits(value, inner[0])
    if origin in (Union, UnionType):
        # A union with ArrayLike is flat, with all that numpy converts; where ArrayLike is an alias by name (numpy from
        # 2.5 on), it is an option.
        converted = set(get_args(ArrayLike)) or {ArrayLike}
        return converted <= set(inner) or any(_fits(value, option) for option in inner)
    if origin is Literal:
        return isinstance(value, str | int) and value in inner
    if origin is np.ndarray:
        return True
    if origin is abc.Callable:
        return callable(value)
    if origin in (abc.Sequence, abc.Iterable):
        if isinstance(value, str | bytes | Mapping) or not isinstance(value, abc.Iterable):
            return False
        # What can be read once only is read by the function.
        return isinstance(value, abc.Iterator) or all(_fits(entry, inner[0]) for entry in value)
    kind = origin or kind
    # A protocol that is not made for it cannot be looked for in a value.
    if getattr(kind, "_is_protocol", False) and not getattr(kind, "_is_runtime_protocol", False):
        return True
    return isinstance(value, kind) if isinstance(kind, type) else True


def _words(kind: Any) -> str:
    """A kind in words: ``a Scene or a path``."""
    if get_origin(kind) is Annotated:
        return _words(get_args(kind)[0])
    names: dict[Any, str] = {bool: "True or False", int: "a whole number", float: "a number", str: "a text"}
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        path = any(get_origin(option) is PathLike or option is Path for option in inner)
        words = ["a path" if path and option is str else _words(option) for option in inner]
        return " or ".join(dict.fromkeys(words))
    if origin is Literal:
        return f"one of {', '.join(map(str, inner))}"
    if kind is None or kind is type(None):
        return "None"
    if origin in (abc.Sequence, abc.Iterable):
        plural = {str: "names", int: "whole numbers", float: "numbers"}
        return "a list of " + (plural.get(inner[0]) or re.sub(r"\ban? ", "", _words(inner[0])))
    if origin is abc.Callable:
        return "a function"
    kind = origin or kind
    if kind in (PathLike, Path):
        return "a path"
    if kind is abc.Mapping:
        return "a mapping"
    name = getattr(kind, "__name__", str(kind))
    return names.get(kind) or f"{'an' if name[0] in 'AEIO' else 'a'} {name}"
