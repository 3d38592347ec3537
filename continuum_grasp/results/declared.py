"""Declarations of a result: arrays, the dimensions they share, texts and pictures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np


@dataclass(frozen=True)
class Stored:
    """An array of ``result.npz``.

    Attributes
    ----------
    name : str
        With ``{word}`` in it: one array for each name of that word, see `Result.words`.
    shape : str
        Names of its dimensions, as ``"(time, state)"``; each means the same number in all arrays of a result.
    unit : str
        SI unit; ``""`` where entries differ, and then their names carry it, ``"text"`` for words.
    meaning : str
    source : str
        The attribute of the result, by default ``name``; dots lead into attributes. An array whose
        source is None is not stored.

    The docstring of a result lists its stored arrays.
    """

    name: str
    shape: str
    unit: str
    meaning: str
    source: str = ""

    def __str__(self) -> str:
        unit = f" [{self.unit}]" if self.unit not in ("", "text") else ""
        return f"{self.meaning[:1].upper()}{self.meaning[1:]}{unit}."

    @property
    def dimensions(self) -> tuple[str, ...]:
        """Names of the dimensions, in order."""
        return tuple(name.strip() for name in self.shape.strip("()").split(",") if name.strip())

    def of(self, result: Any) -> Any:
        """The array of a result; None where it has none."""
        array = attribute(result, self.source or self.name)
        return np.array(array, dtype=str) if self.unit == "text" and array is not None else array

    def each(self, words: Mapping[str, Iterable[str]]) -> list[Stored]:
        """Arrays for each name of each word in this array's name; the array itself where there is no such word."""
        for word, names in words.items():
            if f"{{{word}}}" in self.name:
                copies = [
                    replace(self, **{key: getattr(self, key).replace(f"{{{word}}}", name) for key in ("name", "shape")})
                    for name in names
                ]
                return [stored for each in copies for stored in each.each(words)]
        return [self]


@dataclass(frozen=True)
class Dimension:
    """A dimension of arrays.

    Attributes
    ----------
    name : str
    meaning : str
    labels : str, tuple of str or int
        An attribute of the result with one number or ``"name [unit]"`` per place, dots lead into attributes; or these
        names themselves. An array may have the first few of them. A number: as the first place has. Empty: places are
        counted.
    unit : str
        Unit of labels that are numbers.
    """

    name: str
    meaning: str
    labels: str | tuple[str, ...] | int = ()
    unit: str = ""

    TIME: ClassVar[Dimension]
    XY: ClassVar[Dimension]
    POSE: ClassVar[Dimension]


Dimension.TIME = Dimension("time", "instants", "t", "s")
Dimension.XY = Dimension("xy", "world axes", ("x", "y"))
Dimension.POSE = Dimension("pose", "pose of the object", ("x [m]", "y [m]", "angle [rad]", "height [m]"))


@dataclass(frozen=True)
class File:
    """File that is made of a result: a text, or as a `Picture` a drawing.

    Attributes
    ----------
    name : str
        In the run folder.
    maker : str
        ``"module:function"``, which is given the result and returns the text. It is a name
        because results lie below the packages that describe and draw them, and matplotlib is loaded late.
    needs : str
        Attribute of the result without which, or where it is empty, there is no such file; by default none.
    """

    name: str
    maker: str
    needs: str = ""


@dataclass(frozen=True)
class Picture(File):
    """A picture of a result, asked for by its name; the file is ``name.png``.

    Its maker takes the result and, by name, ``ax`` and further options; it returns axes, a list of them if it has
    panels.

    Attributes
    ----------
    panels : bool
        Whether it is a figure of several axes, which cannot be drawn into axes that are given.
    options : mapping
        Arguments of the maker, beside those that a user gives.
    """

    panels: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)


def attribute(of: Any, path: str) -> Any:
    """An attribute, dots lead into attributes and mappings; None where one on the path is None or not in a mapping."""
    for part in path.split("."):
        if isinstance(of, Mapping):
            of = of.get(part)
        elif of is None:
            of = None
        else:
            of = getattr(of, part)
    return of
