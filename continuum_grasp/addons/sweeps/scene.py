"""Sweeps: one scene with some of its keys varied."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeVar

from pydantic import BeforeValidator, Field, PrivateAttr

from continuum_grasp.base import InputError
from continuum_grasp.scene import (
    Configuration,
    Consumer,
    Document,
    Interval,
    ListOf,
    Positive,
    Real,
    Shape,
    Unit,
    Value,
    kinds,
)

if TYPE_CHECKING:
    from continuum_grasp.scene import Overrides


VARIED_KINDS = ("grasp", "hand", "mpc")
"""Kinds of scenes that are varied, grasps first."""
GRASPS = VARIED_KINDS[:2]
"""Kinds of scenes whose grasps a sweep finds."""
Key = Annotated[str, Field(min_length=1)]
_IN_UNIT = {
    *("values", "uniform", "log_uniform", "normal", "choice", "plus"),
    *("min", "max", "start", "amount"),
}
"""Keys whose values have the unit of the scene's key that they stand for."""


def _in_si(given: Any) -> Any:
    # This needs no scene: a key has the same unit for all shapes of objects and in all kinds of scenes.
    shapes = [Shape(kinds()[name].scene_class) for name in VARIED_KINDS]
    return {key: _way_in_si(key, way, shapes) for key, way in given.items()} if isinstance(given, dict) else given


Way = TypeVar("Way", bound=Value)
"""Way in which a key varies."""
WaysByKey = Annotated[dict[Key, Way], BeforeValidator(_in_si)]
"""Ways to vary keys: texts such as 65 mm become numbers in the SI unit that each key has in the scene."""


def _way_in_si(key: Any, way: Any, shapes: Sequence[Shape]) -> Any:
    try:
        path = Document.path_of(key, "")
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

    def value(self, source: float) -> float:
        """The value beside one of the varied key."""
        return self.times * source + self.plus


class Varied(Configuration):
    """A scene with some varied keys."""

    scene: str
    """Path of the scene that is varied, relative to this file."""
    set: dict[Key, Any] = Field(default_factory=dict)
    """Key paths in the scene with values that differ from its file in all runs."""
    follow: WaysByKey[Follow] = Field(default_factory=dict)
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
        return self._folder / type(self).__name__


MOST_SCENES = 10_000_000
"""A plan is held in memory, about 100 bytes a scene: 1 GB."""

SWEEP_QUANTITIES = {
    "tension_sum": ("N", "sum of all tensions"),
    "tension_max": ("N", "greatest tension"),
    "normal_force_max": ("N", "greatest normal force"),
    "friction_margin": ("", "least friction margin"),
    "contacts": ("", "number of contacts"),
    "iterations": ("", "iterations of the solver"),
    "seconds": ("s", "time"),
    "reason_limit": ("", "limit that stands against a grasp"),
    "reason_needed": ("", "what that limit would have to be"),
}
"""Columns of the table about every grasp besides status, reason and message: unit and meaning."""

Values = Annotated[ListOf[Any], Field(min_length=1, max_length=100_000)]
_RECORDED = re.compile(r"(quality|certificate|statistics)(\.[A-Za-z0-9_]+)+")


class Grid(Value):
    """Values of one key; each is tried with all values of the other keys."""

    REFUSALS = Consumer.refusals(
        "{min,max,count,spacing} with values: values stand alone, without min, max, count and spacing"
    )

    values: Values | None = None
    """The values themselves: numbers, words, lists, mappings, or paths of finger files relative to this file."""
    min: Annotated[Annotated[Real, Unit(None)] | None, Field(examples=[0.065, "65 mm"])] = None
    """Least of evenly spaced values, in the unit of the key."""
    max: Annotated[Annotated[Real, Unit(None)] | None, Field(examples=[0.1, "100 mm"])] = None
    """Greatest of evenly spaced values, in the unit of the key."""
    count: Annotated[int, Field(ge=2, le=100_000)] | None = None
    """Number of evenly spaced values, both ends included."""
    spacing: Literal["linear", "log"] = "linear"
    """log: equal ratios instead of equal differences."""

    def _check(self) -> None:
        ends = (self.min, self.max, self.count)
        if self.values is None and all(end is None for end in ends):
            raise ValueError("give either values, or min, max and count")
        if self.values is not None:
            return
        if any(end is None for end in ends):
            raise ValueError("min, max and count belong together")
        self._check_below("min", "max")
        if self.spacing == "log" and not (self.min or 0.0) * (self.max or 0.0) > 0.0:
            raise ValueError("spacing: log needs min and max of one sign, neither of them 0")

    @property
    def listed(self) -> tuple[Any, ...]:
        """The values; those that are computed are rounded to 12 digits, and whole numbers where all are."""
        if self.values is not None:
            return self.values
        import numpy as np

        spaced = np.geomspace if self.spacing == "log" else np.linspace
        spaced_values = spaced(self.min or 0.0, self.max or 0.0, self.count or 2)
        # 0.1 + 2 * 0.1 would print as 0.30000000000000004 in tables and key paths.
        rounded = [float(f"{value:.12g}") for value in spaced_values]
        return tuple(map(int, rounded)) if all(value.is_integer() for value in rounded) else tuple(rounded)


class Draw(Value):
    """Random distribution of one key."""

    uniform: Annotated[Interval, Unit(None)] | None = None
    """Least and greatest value, in the unit of the key."""
    log_uniform: Annotated[Interval, Unit(None)] | None = None
    """Least and greatest value, in the unit of the key, both positive; equal ratios are equally likely."""
    normal: Annotated[tuple[Real, Positive], Field(strict=False), Unit(None)] | None = None
    """Mean and standard deviation, in the unit of the key."""
    choice: Values | None = None
    """Values that are equally likely."""

    def _check(self) -> None:
        self._check_one_given(*type(self).model_fields)
        if self.log_uniform is not None and self.log_uniform[0] <= 0.0:
            raise ValueError(f"log_uniform needs positive numbers, got {list(self.log_uniform)}")

    @property
    def kind(self) -> str:
        """Name of the distribution, of the four."""
        return next(iter(self.stated()))

    @property
    def listed(self) -> tuple[Any, ...]:
        """Values that the scene must take: its choices, the ends of its range, or its mean."""
        numbers: tuple[Any, ...] = getattr(self, self.kind)
        # The second number of a normal draw is a deviation, which need not be a value of the key.
        return numbers if self.normal is None else numbers[:1]


class Sample(Value):
    """Scenes drawn at random; with a grid, every point of the grid is tried with all of them."""

    count: Annotated[int, Field(ge=1, le=MOST_SCENES)]
    """Number of draws."""
    keys: Annotated[WaysByKey[Draw], Field(min_length=1, max_length=40)]
    """Key paths in the scene, and how each is drawn."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Equal seeds give equal scenes; a greater count begins with the scenes of the smaller one."""
    method: Literal["random", "halton"] = "random"
    """random: independent draws; halton: a shifted Halton sequence, which fills the space more evenly."""


class Map(Value):
    """A picture: one quantity over two keys."""

    x: Key
    """Column of the table across."""
    y: Key
    """Column of the table upwards."""
    color: Key
    """Column of the table that is shown in color."""
    reduce: Literal["median", "mean", "least", "greatest"] = "median"
    """Value shown where several grasps share a place, as they do where more than these two keys are varied."""


class Front(Value):
    """A picture: two quantities against each other, and the grasps that no other beats in both."""

    x: Key
    """Column of the table across."""
    y: Key
    """Column of the table upwards."""
    x_best: Literal["least", "greatest"] = "least"
    """Better direction of x."""
    y_best: Literal["least", "greatest"] = "least"
    """Better direction of y."""
    color: Key | None = None
    """Column of the table that is shown in color."""


class Sweep(Varied):
    """A grasp, in the plane or of a hand, with some of its keys varied, or a closed loop for environments: a grid,
    random draws, or both.
    """

    vary: WaysByKey[Grid] = Field(default_factory=dict, max_length=40)
    """Key paths in the scene with their values; all combinations are tried, the last key changing fastest."""
    sample: Sample | None = None
    """Random draws of keys; None: none."""
    record: Annotated[ListOf[str], Field(max_length=40)] = ()
    """Additional columns of the table: numbers of the result, such as ``quality.epsilon_l1`` or
    ``statistics.iterations``; for hands also ``certificate.push`` [N]."""
    maps: ListOf[Map] = ()
    """Pictures of one quantity over two keys."""
    pareto: ListOf[Front] = ()
    """Pictures of two quantities against each other."""

    def _check(self) -> None:
        if not self.vary and self.sample is None:
            raise ValueError("give vary, sample, or both")
        drawn = {} if self.sample is None else self.sample.keys
        keys = [*self.vary, *drawn]
        for key in self.vary.keys() & drawn.keys():
            raise ValueError(f"{key!r} is given twice among vary and sample")
        self.check_follow(keys)
        for k, name in enumerate(self.record):
            if not _RECORDED.fullmatch(name):
                raise ValueError(f"record[{k}] must be quality., certificate. or statistics. and a name, got {name!r}")
        if self.count > MOST_SCENES:
            raise ValueError(f"the sweep has {self.count} scenes; the limit is {MOST_SCENES}")

    @property
    def varied_keys(self) -> tuple[str, ...]:
        drawn = () if self.sample is None else self.sample.keys
        return (*super().varied_keys, *self.vary, *drawn)

    @property
    def count(self) -> int:
        """Number of scenes."""
        total = 1 if self.sample is None else self.sample.count
        for grid in self.vary.values():
            total *= len(grid.values) if grid.values is not None else grid.count or 1
        return total

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of numbers that every run fills, besides the keys."""
        return (*SWEEP_QUANTITIES, *self.record)
