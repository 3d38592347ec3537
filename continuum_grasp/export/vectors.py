"""Test vectors: inputs with the outputs, to the last bit, and the codes that the C must give.

The outputs come from the kernels' references in numpy, not from the C.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.core import CReal
from continuum_grasp.export.fields import Field, fill
from continuum_grasp.export.layer import Contents
from continuum_grasp.export.part import Argument, Bad, Call, Code, Vectors
from continuum_grasp.export.subject import Subject

_LEAST, _IN_ALL = 64, 200
"""Rows per function, and of all functions together."""
_DRAWN = 512
"""Rows that are drawn; few of them are refused."""
_REFUSED = 4
"""Rows taken of those that are refused."""
_FREE = 24
"""Rows in which the object stays where it is drawn."""
_SIDES = 8
"""Rows with every bend at a limit."""
_TINY = (0.0, 1e-12, 1e-9)
"""Bends at which a formula with a division by them would fail."""


def vectors_of(subject: Subject, calls: Sequence[Call]) -> list[Vectors]:
    """Vectors of the functions of a package."""
    count = max(_LEAST, math.ceil(_IN_ALL / max(len(calls), 1)))
    return [_vectors(subject, call, seed, count) for seed, call in enumerate(calls)]


def _vectors(subject: Subject, call: Call, seed: int, count: int) -> Vectors:
    """Vectors of a function: at rest, at tiny bends, overflowing, at limits, over the whole range, and bad ones."""
    arguments = subject.passed_to(call)
    rows = _sample(subject, arguments, seed).astype(subject.real.dtype)
    outputs, codes = call.reference(split(rows, arguments))
    good = np.flatnonzero(codes >= 0)
    refused = np.flatnonzero(codes < 0)
    chosen = np.sort(np.concatenate([good[: count - min(_REFUSED, len(refused))], refused[:_REFUSED]]))
    rows = rows[chosen]
    outputs = outputs[chosen]
    codes = codes[chosen]
    base = int(np.flatnonzero(codes >= 0)[0])  # a good row, in which one number at a time is made bad
    bad = tuple(_bad(subject.real, arguments, base))
    pointers = 2 + sum(a.is_struct for a in call.inputs)
    return Vectors(call.name, _runner(subject, call), rows, outputs, codes, bad, pointers, call.output.size)


def reach_of(arguments: Sequence[Argument]) -> tuple[Array, Array]:
    """Least and greatest value of every number: of its range, and of usual values where it has none."""
    fields = [field for a in arguments for field in a.numbers]
    low, high = np.array([f.sampled for f in fields]).T
    return low, high


_DEPTHS = -0.2, 1.05
"""Depths to which objects are pressed in rows, per the greatest that is taken: apart, pressed, and too deep."""


def press(subject: Subject, arguments: Sequence[Argument], rows: Array, rng: np.random.Generator) -> Array:
    """Rows with the object moved against a station of the finger each: by chance surfaces hardly ever touch."""
    names = [field.name for a in arguments for field in a.numbers]
    system = subject.touching
    if system is None or not system.touch_names or "object_x" not in names:
        return rows
    arrays = split(rows, list(arguments))
    count = len(rows)
    whole = [arrays[key] if arrays[key].size else np.zeros((count, getattr(system, f"n{key}"))) for key in "xuwp"]
    touch = system.touch.map(count)(*(np.asarray(array, dtype=float).T for array in whole))
    gap = np.array(touch[0]).T
    normal = np.array(touch[6]).reshape(2, count, -1)
    stations = sum(name.startswith("finger.") for name in system.touch_names)
    station = rng.integers(0, stations, count)
    each = np.arange(count)
    depth = subject.pressed * rng.uniform(*_DEPTHS, count)
    moved = rows.copy()
    place = [names.index("object_x"), names.index("object_y")]
    moved[:, place] += (normal[:, each, station] * (gap[each, station] + depth)).T
    low, high = reach_of(arguments)
    moved[:, place] = np.clip(moved[:, place], low[place], high[place])
    return moved


def split(rows: Array, arguments: list[Argument]) -> dict[str, Array]:
    """Rows by the arrays of the arguments; empty ones for those that a function does not have."""
    arrays = {}
    start = 0
    for argument in arguments:
        arrays[argument.array] = rows[:, start : start + argument.size]
        start += argument.size
    for name in "pxuw":
        arrays.setdefault(name, rows[:, :0])
    return arrays


def _sample(subject: Subject, arguments: list[Argument], seed: int) -> Array:
    """Rows at rest, at tiny bends, hard driven, at limits, over the whole ranges, and overflowing."""
    rng = np.random.default_rng(seed)
    fields = [field for a in arguments for field in a.numbers]
    low, high = reach_of(arguments)
    scales = np.array([f.scale for f in fields])
    low = np.maximum(low, -scales)
    high = np.minimum(high, scales)
    rows = rng.uniform(low, high, (_DRAWN, len(fields)))
    first = 0 if subject.parameters is None else subject.parameters.size
    nominal = np.array(subject.moving.p_nominal)
    at_rest = np.clip(np.zeros(len(fields)), low, high)
    state = slice(first, first + subject.moving.nx)
    at_rest[state] = subject.start
    sides = rows[5 : 5 + _SIDES]
    bends = slice(first, first + subject.model.n)
    sides[:, bends] = np.where(rng.integers(0, 2, (_SIDES, subject.model.n)) == 1, high[bends], low[bends])
    for k, bend in enumerate(_TINY):
        rows[k] = at_rest
        rows[k, state][: subject.model.n] = bend
        rows[k, -1] = high[-1] if not arguments[-1].is_struct else rows[k, -1]
    rows[: len(_TINY), :first] = nominal
    rows[_FREE:] = press(subject, arguments, rows[_FREE:], rng)
    # Moments and inputs that throw a matched tip out of its range, though each is in its own.
    driven = slice(first + 2 * subject.model.n, first + subject.moving.nx + subject.model.nu)
    limits = np.array([f.high for f in fields])
    # 5.0: times the usual input, at which a matched tip is out of its range
    rows[4, driven] = np.minimum(5.0 * scales, limits)[driven]
    if any(argument.drawn for argument in arguments):
        # Bends and rates whose squares overflow: the function must refuse its own result.
        rows[3, state][: 2 * subject.model.n] = 0.5 * subject.real.greatest
        beyond = rows[5 + _SIDES : 5 + 2 * _SIDES]
        # 2.0: times a number within the range, up to which vectors draw states out of it
        beyond[:, state] *= rng.uniform(1.0, 2.0, (len(beyond), subject.moving.nx))
    return rows


def _bad(real: CReal, arguments: list[Argument], row: int) -> list[Bad]:
    """Cases in which each number is not finite, below its range, or above it."""
    bad = []
    first = 0
    for argument in arguments:
        ranges = [replace(f, low=-np.inf, high=np.inf) if argument.drawn else f for f in argument.fields]
        bad += bad_entries(real, ranges, row, first, argument.code)
        first += argument.size
    return bad


def bad_entries(real: CReal, fields: Sequence[Field], row: int, first: int, code: Code) -> list[Bad]:
    """Bad entries of the fields of one struct, whose numbers stand in the row from ``first`` on."""
    bad = []
    for entry, field in enumerate(f for f in fields for _ in range(f.size)):
        for value in (np.nan, np.inf, -np.inf):
            bad.append(Bad(row, first + entry, float(value), Code.ERR_NON_FINITE))
        if field.low > -np.inf:
            bad.append(Bad(row, first + entry, _beyond(real, field.low, -1.0), code))
        if field.high < np.inf:
            bad.append(Bad(row, first + entry, _beyond(real, field.high, 1.0), code))
    return bad


def _beyond(real: CReal, limit: float, side: float) -> float:
    """The next number beyond a limit; beyond zero the next that is normal, since fast flags drop those below."""
    if limit == 0.0:  # -ffast-math flushes subnormal numbers to zero
        return side * real.least_normal
    return float(np.nextafter(real.dtype(limit), real.dtype(side * np.inf)))


def _runner(subject: Subject, call: Call) -> str:
    """C that runs a function without memory on a row."""
    passed = subject.passed_to(call)
    ends = dict(zip([a.name for a in passed], itertools.accumulate(a.size for a in passed), strict=True))
    # ``null`` is the number of the pointer that is null in this call, counted from one; zero for none.
    structs = [a for a in (*call.inputs, call.output) if a.is_struct]
    pointers = {name: k for k, name in enumerate(["model", *(a.name for a in structs)], 1)}
    # The name of no function: local names hide those of the package, whose prefix may be the first word of an output.
    local = {call.output.name: "result"}
    taken = []
    for name in ("model", *(a.name for a in call.inputs), call.output.name):
        given = f"null == {pointers[name]} ? 0 : &{local.get(name, name)}" if name in pointers else ""
        taken.append(given or f"row[{ends[name] - 1}]")
    words = {
        "p": subject.prefix,
        "call": call,
        "indent": " " * len(f"static int {call.name}_run("),
        "declared": [(a.kind.name, local.get(a.name, a.name)) for a in structs],
        "copied": [(a, ends[a.name] - a.size) for a in passed if a.is_struct],
        "passed": taken,
    }
    return fill("tests/run.c", words)


_RANDOM = {
    "float": "next_random(seed)",
    "double": "(uint64_t)next_random(seed) << 32 | next_random(seed)",
}
"""C of random bits of a real number."""


def vectors_source(contents: Contents, vectors: Sequence[Vectors]) -> str:
    """Header with the vectors as hexadecimal floating literals, which are exact."""
    real = contents.subject.real
    return contents.fill("tests/vectors.h", tables=[_table(v, real) for v in vectors], width=str(real.width))


def check_source(contents: Contents, vectors: Sequence[Vectors]) -> str:
    """C that runs the vectors without a library but memcpy."""
    real = contents.subject.real
    return contents.fill(
        "tests/check.c",
        vectors=[(v, *v.inputs.shape, v.outputs.shape[1], len(v.bad)) for v in vectors],
        count=len(vectors),
        most_inputs=max(v.inputs.shape[1] for v in vectors),
        most_outputs=max(v.outputs.shape[1] for v in vectors),
        width=real.width,
        exponent=real.bit_pattern(real.exponent_mask),
        random_bits=_RANDOM[real.name],
    )


def _table(vectors: Vectors, real: CReal) -> dict[str, object]:
    inputs = vectors.inputs
    good = np.isfinite(vectors.inputs)
    spoilt = [(int(k), int(j), _bits(inputs[k, j], real), 0) for k, j in np.argwhere(~good)]
    numbers = {
        "inputs": np.where(good, inputs, 0),
        "outputs": np.where((vectors.codes < 0)[:, None], 0, vectors.outputs),
    }
    return {
        "name": vectors.name,
        # A text per row: a template that goes through single numbers takes 2 s for the vectors of a mission.
        **{name: [", ".join(map(real.hexadecimal, row)) for row in rows] for name, rows in numbers.items()},
        "codes": vectors.codes,
        # One at least, as C has no empty array.
        "bad": [(b.row, b.entry, _bits(b.value, real), int(b.code)) for b in vectors.bad] or [(-1, 0, 0, 0)],
        "spoilt": [*spoilt, (-1, 0, _bits(0.0, real), 0)],
    }


def _bits(value: float, real: CReal) -> str:
    return real.bit_pattern(int(np.array([value], dtype=real.dtype).view(real.bits)[0]))
