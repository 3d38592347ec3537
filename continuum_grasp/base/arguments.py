"""Arguments of public functions, checked: the value itself, or an `InputError` that names the argument."""

from __future__ import annotations

import inspect
import math
import re
from collections import abc
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.base.errors import InputError

Function = TypeVar("Function", bound=Callable[..., Any])
GONE = {
    "loss": "outliers are named; leave their rows out by `fitted` of the data, or by holdout_rows or window of a set",
    "precision": "models compute in double precision; take export_c(..., real='float'), or a Controller's precision",
}
"""Arguments that functions had once, and what to write instead."""


def choice(key: str, value: Any, allowed: Iterable[Any]) -> Any:
    """A choice of some words or numbers."""
    known = tuple(allowed)
    # Not by ``in``: what compares to an array, as some foreign types do, has no truth.
    if isinstance(value, str | Integral) and any(value is option or value == option for option in known):
        return value
    raise InputError(f"expected one of {', '.join(map(str, known))}, got {shown(value)}", key=key)


def whole(key: str, value: Any, least: int = 1, most: int = 2**31 - 1) -> int:
    """A whole number of a range, ends included; 1 or more, and one that C can hold, where no other range is given."""
    if not isinstance(value, Integral) or isinstance(value, bool) or not least <= int(value) <= most:
        wanted = f", {least} or more" if most == 2**31 - 1 else f" from {least} to {most}"
        raise InputError(f"expected a whole number{wanted}, got {shown(value)}", key=key)
    return int(value)


def number(key: str, value: Any, least: float | None = None, most: float = math.inf) -> float:
    """A number of a range, ends included; a finite one above zero where no least one is given."""
    real = _double(value)
    if least is None and not 0.0 < real < math.inf:
        raise InputError(f"expected a finite number above 0, got {shown(value)}", key=key)
    low = 0.0 if least is None else least
    if not low <= real <= most:
        raise InputError(f"expected a number from {low:g} to {most:g}, got {shown(value)}", key=key)
    return real


def instance(key: str, value: Any, *kinds: type) -> Any:
    """An object of one of some classes."""
    if not isinstance(value, kinds):
        raise InputError(f"expected {' or '.join(map(_words, kinds))}, got {shown(value)}", key=key)
    return value


def _double(value: Any) -> float:
    """A number in double precision; NaN for what is none."""
    try:
        return float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    except OverflowError:  # a whole number beyond the doubles
        return math.inf if value > 0 else -math.inf


def unmasked(value: ArrayLike) -> NDArray[Any]:
    """Convert to an array, in which masked entries are NaN: ``numpy.asarray`` would take the numbers below the mask."""
    if isinstance(value, np.ma.MaskedArray):
        return np.where(np.ma.getmaskarray(value), np.nan, value.data)
    return np.asarray(value)


def real_array(name: str, value: ArrayLike, *, finite: bool = False) -> NDArray[np.float64]:
    """A contiguous array of doubles, NaN where masked; InputError for what is no array of real numbers.

    ``finite``: for the first entry that is NaN or infinite, too.
    """
    array = _reals(name, value)
    if finite and not np.isfinite(array).all():
        at = np.argwhere(~np.isfinite(array))[0]
        where = f"[{', '.join(map(str, at.tolist()))}]" if at.size else ""
        raise InputError(f"{name}{where}: expected a finite number, got {array[tuple(at)]}")
    return array


def _reals(name: str, value: ArrayLike) -> NDArray[np.float64]:
    try:
        array = unmasked(value)
        if np.iscomplexobj(array):
            raise InputError("expected real numbers, got complex ones", key=name)
        # numpy would read texts and dates as numbers.
        if array.dtype.kind in "OUSMm" and not all(isinstance(v, Real) for v in array.ravel().tolist()):
            raise TypeError
        return np.ascontiguousarray(array, dtype=float)
    except InputError:
        raise
    except Exception as error:  # whatever the conversion of something foreign raises
        raise InputError(f"expected an array of numbers, got {shown(value)}", key=name) from error


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
                raise InputError(f"expected {_words(kind)}, got {shown(value)}", key=name)
        return function(*arguments, **named)

    call.checks_arguments = True  # type: ignore[attr-defined]
    return cast(Function, call)


def shown(value: Any, width: int = 60) -> str:
    """Return the beginning of a value for a message; its type where that cannot be printed."""
    try:
        return f"{value!r:.{width}}"
    except Exception:  # integers of over 4300 digits, and whatever a foreign __repr__ raises
        return f"a {type(value).__name__}"


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
    """Whether a value is of a kind, as far as that can be seen without computing."""
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
