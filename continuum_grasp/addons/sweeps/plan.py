"""Scenes of a sweep: the same for the same configuration, in the same order, wherever it runs."""

from __future__ import annotations

import copy
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.sweeps.scene import SWEEP_QUANTITIES, Draw, Sweep
from continuum_grasp.addons.sweeps.variation import Variation, VariedKey, variation_of
from continuum_grasp.base import clipped
from continuum_grasp.results import plain
from continuum_grasp.scene import ConfigurationData, KeyPath, Overrides

FORMAT_VERSION = 1
"""Version of the stored plan: a sweep resumes with the version that began it."""
_BLOCK = 4096
"""Random rows that are drawn at once, each block from a seed of its own: any row is had without those before it."""


@dataclass(frozen=True)
class SweepPoint:
    """A scene of a sweep: its number, the changes of the scene, and their names in the table."""

    index: int
    values: tuple[Any, ...]
    labels: tuple[Any, ...]

    def scene_data(self, base: Mapping[str, Any], paths: Sequence[KeyPath]) -> dict[str, Any]:
        """The scene of the point as plain data, made of the plan's scene; shorter paths are set first."""
        data = copy.deepcopy(dict(base))
        # So that ``finger.base`` is set in the ``finger`` that is varied too.
        for path, value in sorted(zip(paths, self.values, strict=True), key=lambda pair: len(pair[0])):
            parent: Any = data
            for part in path[:-1]:
                child = parent.get(part) if isinstance(parent, dict) else parent[part]
                if child is None:  # a section that is left out, or null, is one of defaults
                    child = parent[part] = {}
                parent = child
            parent[path[-1]] = copy.deepcopy(value)
        return data


class SweepPlan:
    """The scenes of a sweep, one by one; ``variation`` is the same sweep, resolved.

    ``keys`` are the varied keys: of the grid, drawn, and following; ``paths`` is where they lie in the scene.
    ``columns`` are the numbers that every run gives, ``units`` the units of keys and columns, where known.
    """

    def __init__(self, variation: Variation) -> None:
        sweep = variation.sweep
        self.sweep = sweep
        self.variation = variation
        varied: list[VariedKey[Any]] = [*variation.axes, *variation.draws, *variation.ties]
        self.keys: tuple[str, ...] = tuple(entry.key for entry in varied)
        self.paths: tuple[KeyPath, ...] = tuple(entry.path for entry in varied)
        self.columns = sweep.columns
        self.units = {name: unit for name, (unit, _) in SWEEP_QUANTITIES.items()}
        self.units |= {entry.key: entry.unit for entry in varied}
        self._counts = [len(axis.values) for axis in variation.axes]
        self._sources = [self.keys.index(tie.way.key) for tie in variation.ties]
        self._seed = 0 if sweep.sample is None else sweep.sample.seed
        self._shift = np.random.default_rng(self._seed).random(len(variation.draws))

    @staticmethod
    def of(config: Sweep | str | os.PathLike[str] | Mapping[str, Any], overrides: Overrides = ()) -> SweepPlan:
        """The scenes of a configuration. Raises an InputError where it is no sweep, or something in it is wrong."""
        return SweepPlan(variation_of(ConfigurationData.given(config, Sweep, overrides)))

    def data_of(self, point: SweepPoint) -> dict[str, Any]:
        """The scene of a point as plain data."""
        return point.scene_data(self.variation.base, self.paths)

    def __len__(self) -> int:
        return self.sweep.count

    def __iter__(self) -> Iterator[SweepPoint]:
        return map(self.point, range(len(self)))

    def point(self, index: int) -> SweepPoint:
        """The scene of a number: draws change fastest, then the last key of the grid."""
        # Every place of the grid meets the same draws: differences between places are not those of samples.
        draws = 1 if self.sweep.sample is None else self.sweep.sample.count
        place, draw = divmod(index, draws)
        values: list[Any] = []
        labels: list[Any] = []
        for axis, k in zip(self.variation.axes, np.unravel_index(place, self._counts), strict=True):
            values.append(axis.values[k])
            labels.append(_label(axis.way.listed[k]))
        if self.variation.draws:
            for drawn, share in zip(self.variation.draws, self._shares(draw), strict=True):
                value, label = _value(drawn.way, drawn.values, float(share))
                values.append(value)
                labels.append(label)
        for tie, source in zip(self.variation.ties, self._sources, strict=True):
            # 15 digits: 0.1 times 3 is 0.3 in the table.
            values.append(float(f"{tie.way.value(values[source]):.15g}"))
            labels.append(values[-1])
        return SweepPoint(index, tuple(values), tuple(labels))

    def as_json(self) -> dict[str, Any]:
        """Plain data that determine the scenes and the contents of their rows."""
        sample = self.sweep.sample
        varied = self.variation
        drawn = {
            draw.key: {draw.way.kind: draw.values if draw.way.choice else getattr(draw.way, draw.way.kind)}
            for draw in varied.draws
        }
        record: dict[str, Any] = plain(
            {
                "format_version": FORMAT_VERSION,
                "scenes": len(self),
                "scene": varied.base,
                "vary": {axis.key: axis.values for axis in varied.axes},
                "sample": None if sample is None else {**sample.model_dump(exclude={"keys"}), "keys": drawn},
                "follow": {tie.key: tie.way.model_dump() for tie in varied.ties},
                "record": self.sweep.record,
            }
        )
        return record

    @property
    def pictures(self) -> dict[str, Any]:
        """The pictures that the configuration asks for, as plain data."""
        return {name: [picture.model_dump() for picture in getattr(self.sweep, name)] for name in ("maps", "pareto")}

    def _shares(self, draw: int) -> NDArray[np.float64]:
        """Numbers between 0 and 1, one per drawn key."""
        count = len(self.variation.draws)
        if self.sweep.sample is not None and self.sweep.sample.method == "halton":
            from scipy.stats.qmc import Halton

            # The first point of the sequence is the corner 0 and left out; a seed shifts all points alike, modulo 1.
            point = Halton(count, scramble=False).fast_forward(draw + 1).random()[0]
            return np.asarray((point + self._shift) % 1.0)
        block, row = divmod(draw, _BLOCK)
        return np.asarray(_drawn(self._seed, block, count)[row])


@lru_cache(maxsize=1)
def _drawn(seed: int, block: int, count: int) -> NDArray[np.float64]:
    """A block of random rows."""
    return np.random.default_rng([seed, block]).random((_BLOCK, count))


def differences(old: Mapping[str, Any], new: Mapping[str, Any], most: int = 6) -> list[str]:
    """Differences between two plans, in words, key by key."""
    a, b = _leaves(old), _leaves(new)
    changes = []
    for key in {**a, **b}:
        there = f"{_short(a[key])} there" if key in a else "not given there"
        here = f"{_short(b[key])} here" if key in b else "not given here"
        if key not in a or key not in b or a[key] != b[key]:
            changes.append(f"{key}: {there}, {here}")
    return changes[:most] + ([f"and {len(changes) - most} more"] if len(changes) > most else [])


def _value(draw: Draw, values: Sequence[Any], share: float) -> tuple[Any, Any]:
    """A value that is drawn, by a number from 0 to 1, and its label."""
    if draw.choice is not None:
        k = min(int(share * len(values)), len(values) - 1)
        return values[k], _label(draw.choice[k])
    if draw.uniform is not None:
        low, high = draw.uniform
        value = low + (high - low) * share
    elif draw.log_uniform is not None:
        low, high = draw.log_uniform
        value = math.exp(math.log(low) + (math.log(high) - math.log(low)) * share)
    else:
        # The share 0 is possible, and has no finite value.
        value = NormalDist(*(draw.normal or (0.0, 1.0))).inv_cdf(min(max(share, 1e-15), 1.0 - 1e-15))
    return value, value


def _label(value: Any) -> Any:
    """A value as one entry of a table."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, default=str)


def _leaves(data: Any, key: str = "") -> dict[str, Any]:
    if isinstance(data, Mapping) and data:
        leaves: dict[str, Any] = {}
        for name, child in data.items():
            leaves |= _leaves(child, f"{key}.{name}" if key else name)
        return leaves
    return {key: data}


def _short(value: Any) -> str:
    if isinstance(value, list) and len(value) > 6:
        return f"{len(value)} values from {value[0]} to {value[-1]}"
    return clipped(str(value), 80)


def keys_of(plan: Mapping[str, Any]) -> list[str]:
    """The varied keys of a stored plan."""
    sample = plan["sample"]
    return [*plan["vary"], *(sample["keys"] if sample else ()), *plan["follow"]]
