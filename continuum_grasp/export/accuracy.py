"""Errors of a package in single precision against double precision, per output."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from continuum_grasp.base import Array, InputError
from continuum_grasp.core import CReal
from continuum_grasp.export.fields import to_digits
from continuum_grasp.export.part import Argument, Call, Code
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.vectors import press, reach_of, split

_CHUNK = 2048
"""Rows that are evaluated at once: the reference implementation keeps every intermediate value of a kernel."""
_UNIFORM, _ENDS = 2, 4
"""Chunks of rows drawn uniformly, and of rows with half of their entries at an end of their range."""
_BEST = 8
"""Worst rows of each output that a climb starts from."""
_MARGIN = 2.0
"""Bound over the greatest error found. Of 8 models the greatest in 200,000 further rows was 0.2 to 0.6 of it."""


@dataclass(frozen=True)
class OutputError:
    """Rounding error of one field of an output."""

    name: str
    unit: str
    bound: float
    """Greatest difference from double precision, in the unit of the field; of what keeps something, in usual calls."""
    greatest: float
    """Greatest absolute value within the ranges."""
    any_call: float | None = None
    """Greatest difference of any call from the same memory; None of what keeps nothing."""
    over_run: float | None = None
    """Greatest difference where each build goes on from its own memory."""

    @property
    def relative(self) -> float:
        """The bound per the greatest value."""
        return self.bound / self.greatest if self.greatest > 0.0 else 0.0


class Report(NamedTuple):
    """Figures of a finished package, by function: cases of its tests, and rounding errors in single precision.

    ``measured``: sizes, and what an emulated board counted; None where none did.
    """

    cases: Mapping[str, int]
    errors: Mapping[str, tuple[OutputError, ...]]
    measured: Mapping[str, Any] | None


def error_bounds(subject: Subject, narrow: Call, wide: Call, seed: int) -> tuple[OutputError, ...]:
    """Bound the rounding errors of a function in single precision, per field of its output.

    The bound is twice the greatest error of some ten thousand rows that cover the ranges and their corners, rounded up.
    What has no range is sampled up to the size of usual values (``Field.scale``). ``narrow`` and ``wide`` are the
    function in single and in double precision.
    """
    rng = np.random.default_rng((seed, 1))
    arguments = subject.passed_to(narrow)
    low, high = reach_of(arguments)
    chunks = [_drawn(low, high, rng, ends=k >= _UNIFORM) for k in range(_UNIFORM + _ENDS)]
    chunks = [press(subject, arguments, rows, rng) for rows in chunks]
    best: list[list[tuple[float, Array]]] = [[] for _ in range(narrow.output.size)]
    greatest = np.zeros(narrow.output.size)
    # 2: further chunks, each of rows around the worst ones so far: rounding grows with the condition, which is smooth
    for k in range(_UNIFORM + _ENDS + 2):
        rows = chunks[k] if k < len(chunks) else _around([row for held in best for _, row in held], low, high, rng)
        rows = rows.astype(subject.real.dtype)
        # The rows themselves are in single precision: the error is that of the function, not of its inputs.
        off, size = _differences(narrow, wide, rows, arguments)
        greatest = np.maximum(greatest, size.max(axis=0))
        for j, held in enumerate(best):
            held += [(float(off[i, j]), rows[i]) for i in np.argsort(off[:, j])[-_BEST:]]
            held.sort(key=lambda entry: -entry[0])
            del held[_BEST:]
    return _by_field(narrow.output, np.array([held[0][0] for held in best]), greatest)


def _drawn(low: Array, high: Array, rng: np.random.Generator, *, ends: bool) -> Array:
    """Rows over ranges, drawn uniformly or with half of the entries at the ends, where rounding is often greatest."""
    rows = rng.uniform(low, high, (_CHUNK, len(low)))
    if not ends:
        return rows
    picked = rng.integers(0, 4, rows.shape)
    return np.where(picked == 0, low, np.where(picked == 1, high, rows))


def _differences(narrow: Call, wide: Call, rows: Array, arguments: list[Argument]) -> tuple[Array, Array]:
    """Absolute differences and absolute values in double (count, outputs).

    Zero in rows that are refused, and in rows where a code warns that they are out of range or leave it.
    """
    computed, codes = (narrow.compiled or narrow.reference)(split(rows, arguments))
    true, _ = (wide.compiled or wide.reference)(split(rows.astype(CReal.KINDS["double"].dtype), arguments))
    good = ((codes >= 0) & (codes != Code.WARN_LEFT_RANGE))[:, None]
    with np.errstate(invalid="ignore"):
        return np.where(good, np.abs(computed - true), 0.0), np.where(good, np.abs(true), 0.0)


def _around(rows: Sequence[Array], low: Array, high: Array, rng: np.random.Generator) -> Array:
    """Rows near some, half of their entries moved, within the ranges."""
    start = np.array(rows, dtype=float)[rng.integers(0, len(rows), _CHUNK)]
    # 0.1: standard deviation of a climb, in shares of the range
    moved = start + 0.1 * (high - low) * rng.standard_normal(start.shape) * rng.integers(0, 2, start.shape)
    return np.asarray(np.clip(moved, low, high))


def _by_field(output: Argument, off: Array, greatest: Array) -> tuple[OutputError, ...]:
    errors = []
    at = 0
    for field in output.fields:
        here = slice(at, at + field.size)
        bound = to_digits(_MARGIN * float(off[here].max()), 2, math.ceil)  # upwards: it is to remain a bound
        errors.append(OutputError(field.name, field.unit, float(f"{bound:.2g}"), float(f"{greatest[here].max():.2g}")))
        at += field.size
    return tuple(errors)


def check_errors(subject: Subject, errors: Mapping[str, tuple[OutputError, ...]], asked: float) -> None:
    """Refuse functions if one has a greater relative error than asked."""
    real = subject.real
    # Rates squared lose digits all over their range, whatever the bends.
    squared = subject.finger is not None and subject.finger.finger.damping.quadratic > 0.0
    advice = "leave finger.damping.quadratic out" if squared else "a smaller bending_range, or fewer elements"
    relative = {name: max(output.relative for output in outputs) for name, outputs in errors.items()}
    worst = max(relative, key=lambda name: relative[name], default="")
    if relative and relative[worst] > asked:
        raise InputError(
            f"{real.name} gives {worst} a relative error of {relative[worst]:.1g} within the ranges, "
            f"{asked:.1g} was asked for: take real='double', or {advice}",
            key="error",
        )
