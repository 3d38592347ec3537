"""Test vectors of estimator and controller: calls in their order, on a finger that is simulated along.

The rows hold measurements, setpoints and settings; the strict build on this machine gives the expected outputs,
which computes to the last bit what every other strict build computes.
"""

from __future__ import annotations

import ctypes
import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.base import Array
from continuum_grasp.control import UNLIMITED
from continuum_grasp.core import CReal
from continuum_grasp.export.accuracy import OutputError
from continuum_grasp.export.build import strict_library
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.fields import Struct
from continuum_grasp.export.layer import Contents, library_files
from continuum_grasp.export.part import ROW_FLAGS, Bad, Code, Stateful, Vectors
from continuum_grasp.export.vectors import bad_entries

_EPISODE = 70
"""Calls from one start to the next: three times ``_HELD``, so that setpoints change in each, and some at the end."""
_EPISODES = 3
"""Episodes of a record, each with harder knocks than the last; from the second on, applied commands differ too."""
_HELD = 20
"""Calls for which setpoints stay."""
_ENDED = 5
"""Calls in the last phase of a mission, in which nothing happens any more."""
_DECIDED = 0.02
"""Share of the usual calls in which rounding may decide which of several plans follows. Of 11 to 1,991 usual calls of
18 controllers it was none to 1.4 %; all others agreed to 5e-5."""
_Call = tuple[int, Array]
"""Code and outputs of a call."""


class _Host:
    """The functions with memory, compiled on this machine with the strict flags, and run row by row."""

    def __init__(self, contents: Contents, files: Mapping[str, str]) -> None:
        self.dtype = contents.subject.real.dtype
        prefix = contents.subject.prefix
        retained = [(f"{prefix}_{kind}_memory", at) for f in contents.stateful for kind, at in _RETAINED[f.types[0]]]
        source = contents.fill(
            "tests/host.c",
            retained=retained,
            passed=_passed(files[f"include/{prefix}_memory.h"], prefix, [kind for kind, _ in retained]).items(),
        )
        self._library = strict_library({**files, "host.c": source})
        self._memory = ctypes.create_string_buffer(ctypes.c_size_t.in_dll(self._library, "host_bytes").value)

    def run(self, name: str, row: Array, outputs: int) -> tuple[int, Array]:
        """Code and outputs of a row, after those before."""
        entries = np.ascontiguousarray(row, dtype=self.dtype)
        out = np.zeros(outputs, dtype=self.dtype)
        run = getattr(self._library, f"host_{name}")
        return int(run(self._memory, *(ctypes.c_void_p(array.ctypes.data) for array in (entries, out)))), out

    def copy_memory(self, other: _Host) -> None:
        """Keep the same numbers as another build."""
        numbers = np.zeros(len(other._memory))  # as many as there may be: none has less than a byte
        for host, taken in ((other, 0), (self, 1)):
            host._library.host_retained(host._memory, ctypes.c_void_p(numbers.ctypes.data), taken)


_RETAINED = {
    "estimator": [("estimator", "estimator.memory")],
    "controller": [("controller", "controller.memory")],
    "mission": [("controller", "mission.controller.memory"), ("mission", "mission.memory")],
}
"""Memory that functions retain beside what rows set: its kind and its place, by the type of their owner."""
_STRUCT = re.compile(r"^typedef struct \{\n(.*?)^\} (\w+);", re.MULTILINE | re.DOTALL)
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_MEMBERS = re.compile(r"^(#.*)$|(signed char|\w+) +(\w[^;]*);", re.MULTILINE)


def _passed(header: str, prefix: str, names: Sequence[str]) -> dict[str, str]:
    """C that passes every member of the named types of a header, and of those that they have, which come first."""
    bodies = {name: body for body, name in _STRUCT.findall(_COMMENT.sub("", header))}
    numbers = {f"{prefix}_real", "int", "uint32_t", "signed char"}
    passed = dict[str, str]()

    def add(name: str) -> None:
        lines = list[str]()
        for directive, kind, members in _MEMBERS.findall(bodies[name]):
            if directive:
                lines.append(directive)
                continue
            if kind in bodies and kind not in passed:  # of what is left out by a condition there may be no type
                add(kind)
            macro = "PASS" if kind in numbers else "PASS_STRUCT"
            lines += [f"  {macro}({kind}, {member.split('[')[0].strip()})" for member in members.split(",")]
        passed[name] = "\n".join(lines)

    for name in names:
        add(name)
    return passed


class _Record:
    """Rows of a function with the codes and outputs of a build, and of one in ``double`` where there is one.

    That one is called from the same memory, so that the difference is what the rounding of a single call costs, and
    once more row by row from its own.
    """

    def __init__(
        self,
        loop: Loop,
        builds: tuple[_Host, _Host | None],
        function: Stateful,
        report: Callable[[float], None],
        outputs: int,
        close: int,
        most: int,
    ) -> None:
        self._host, self._double = builds
        self._function = function
        self._outputs = outputs
        self._close = close
        self._report = report
        self._most = most
        self._limits = np.concatenate([loop.stages.u_min, loop.stages.u_max])
        self._rows = list[Array]()
        self._calls = list[_Call]()
        self._exact = list[_Call]()

    def call(self, *parts: ArrayLike) -> _Call:
        """Code and outputs of the row that the parts make up."""
        row = np.concatenate([np.asarray(part, dtype=float) for part in parts]).astype(self._host.dtype)
        if self._double is not None:
            self._double.copy_memory(self._host)
            self._exact.append(self._in_double(self._double, row))
        self._rows.append(row)
        self._report(len(self._rows) / self._most)
        self._calls.append(self._host.run(self._function.name, row, self._outputs))
        return self._calls[-1]

    def _in_double(self, double: _Host, row: Array) -> _Call:
        """Code and outputs for the same numbers; limits of the input, which rounding has moved, are as given."""
        exact = row.astype(float)
        for limit in self._limits:
            exact[row == row.dtype.type(limit)] = limit
        return double.run(self._function.name, exact, self._outputs)

    def vectors(self, bad: Sequence[Bad]) -> Vectors:
        """All rows so far, and bad inputs; the first ``close`` outputs must agree where rounding may differ."""
        codes, outs = zip(*self._calls, strict=True)
        function = self._function
        return Vectors(
            function.name,
            function.runner,
            np.array(self._rows),
            np.array(outs),
            np.array(codes),
            tuple(bad),
            pointers=len(function.types) + len(function.inputs) + 1,
            close=self._close,
            stateful=True,
        )

    def errors(self, output: Struct) -> tuple[OutputError, ...]:
        """Rounding errors of the first outputs in usual rows; none without a build in ``double``."""
        if self._double is None:
            return ()
        alone = [self._in_double(self._double, row) for row in self._rows]
        usual = np.array(self._rows)[:, 3] == 0.0
        off, apart = (self._differences(of, usual) for of in (self._exact, alone))
        size = np.abs([out[: self._close] for _, out in self._exact])[usual].max(axis=0)
        columns = off[-1 - int(_DECIDED * len(off))], size, off[-1], apart[-1]
        errors = []
        for field, *values in zip(output.fields, *columns, strict=True):
            rounded = [float(f"{value:.2g}") for value in values]
            errors.append(OutputError(field.name, field.unit, *rounded))
        return tuple(errors)

    def _differences(self, exact: Sequence[_Call], usual: NDArray[np.bool_]) -> Array:
        """Differences of the first outputs in usual rows, each from the least to the greatest (rows, outputs).

        Infinite where only one of both gives an output.
        """
        rows = [
            np.abs(out[: self._close].astype(float) - true[: self._close]) if (code < 0) == (true_code < 0) else np.inf
            for (code, out), (true_code, true) in zip(self._calls, exact, strict=True)
        ]
        return np.sort(np.array([np.broadcast_to(row, self._close) for row in rows])[usual], axis=0)


class ReplayedFinger:
    """The prediction as a plant, with its measurements."""

    def __init__(self, loop: Loop, rng: np.random.Generator) -> None:
        self._loop = loop
        self._rng = rng
        s = loop.stages
        self._parts = max(1, math.ceil(s.substeps * loop.period / s.stage - 1e-9))
        self.x = loop.first[: s.nd].copy()
        self._then: list[Array] = []

    def advance(self, u: Array) -> None:
        s = self._loop.stages
        held = np.asarray(u, dtype=float)
        for _ in range(self._parts):
            state = np.concatenate([self.x, held[: s.nx - s.nd]])
            x = np.array(s.step(state, held, s.p_nominal, self._loop.period / self._parts)[0]).ravel()[: s.nd]
            # A finger that a bad command threw out of the model's range starts again, so that the episode goes on.
            self.x = x if np.isfinite(x).all() else self._loop.first[: s.nd].copy()

    def measured(self, u: Array) -> Array:
        """Measurements that arrive now, delayed as in the scene."""
        loop = self._loop
        e = self._loop.estimation
        if e is None:
            return self.x.copy()
        value = loop.measured(np.concatenate([self.x, np.zeros(e.nz - e.nx)]), u)
        self._then = [*self._then[-loop.periods :], value] if loop.periods else [value]
        noise = np.array([1e-4 if "[m]" in name else 1e-2 for name in loop.measurement_names])
        measurements: Array = self._then[0] + noise * self._rng.standard_normal(len(noise))
        return measurements

    def kick(self, size: float) -> None:
        """Push it: change its rates, or states of which nothing more is known, at once."""
        at = np.flatnonzero(self._loop.kicks)
        self.x[at] += size * self._loop.kicks[at] * self._rng.standard_normal(len(at))


def _spoilt(loop: Loop, y: Array, episode: int, k: int, rng: np.random.Generator) -> Array:
    """A measurement as it arrives: now and then an entry is missing or infinite, later on all are, or far off."""
    y = y.copy()
    # Periods without a common divisor (here and of the calls below), so that faults meet in ever new combinations.
    patience = round(loop.stages.stages * loop.stages.stage / loop.period)
    if k % 17 == 9:
        y[rng.integers(len(y))] = np.nan
    if k % 23 == 11:
        y[rng.integers(len(y))] = np.inf if k % 2 else -np.inf
    if episode and k % 19 == 13:
        at = rng.integers(len(y))
        # An outlier: in its range, far from what the filter expects.
        y[at] += 0.4 * (min(loop.measurement.bounded[at][1], UNLIMITED) - y[at])
    # Blind for longer than a plan lasts, late enough for something to be known before.
    start = _EPISODE - 2 * patience - 4 if 2 * patience + 4 < _EPISODE else _EPISODE - 4
    if episode and start <= k < start + patience + 3:
        y[:] = np.nan
    return y


def _known(loop: Loop, k: int) -> Array:
    """Parameters: nominal; at times another within their range, and one that is none."""
    p = np.array(loop.stages.p_nominal, dtype=float)
    if loop.known is not None and k % 31 == 20:
        p[0] = np.nan
    elif loop.known is not None and k % 31 > 24:
        low, high = loop.known.bounded[0]
        p[0] = min(max(1.02 * p[0], low), high)
    return p


def _settings(loop: Loop, episode: int, k: int) -> Array:
    """Settings of the scene; in later episodes other weights, tighter limits."""
    s = loop.stages
    values = loop.nominal_settings.copy()
    if episode == 0 or k < 10:
        return values
    parts = np.cumsum([0, s.nr, s.nr, s.nu, s.nu, s.nc, s.nc])  # where the members of CHANGEABLE begin
    values[: parts[2]] *= 1.5 if episode == 1 else 0.7
    width = values[parts[3] : parts[4]] - values[parts[2] : parts[3]]
    values[parts[3] : parts[4]] -= 0.3 * width * (episode == 1)
    for low, high in ((parts[4], parts[5]), (parts[5], parts[6])):
        rows = values[low:high]
        # Infinite bounds are great numbers here, and stay.
        rows[np.abs(rows) < 1e20] *= 0.25 if episode == 2 else 0.6
    return values


def _target(loop: Loop, rng: np.random.Generator) -> Array:
    """Setpoints at some instant."""
    setpoints: Array = loop.setpoints.rows(rng.uniform(0.0, loop.duration))[0]
    return setpoints


_Begin = Callable[[int, int, int], _Record]
"""Begins a record of a function by the number of its outputs, of those that must agree, and of rows at most."""


def _controller_rows(loop: Loop, real: CReal, begin: _Begin) -> tuple[_Record, list[Bad]]:
    rng = np.random.default_rng(0)
    nu = loop.command.size
    record = begin(nu + loop.start.size + 5, nu, _EPISODES * _EPISODE)
    limits = np.clip((loop.stages.u_min, loop.stages.u_max), -UNLIMITED, UNLIMITED)
    for episode in range(_EPISODES):
        finger = ReplayedFinger(loop, rng)
        u = loop.before.copy()
        planned = False
        later = _target(loop, rng)
        for k in range(_EPISODE):
            if k % _HELD == 0:
                now = later
                later = _target(loop, rng)
            if k % 25 == 15:
                finger.kick(1.0 + episode)
            wanted = np.where(np.arange(len(now)) == k % len(now), np.nan, now) if k % 29 == 21 else now
            applied = rng.uniform(*limits) if k % 27 == 5 else u
            if episode and k % 27 == 5:  # off, or beyond what can be commanded
                applied = np.clip([pair[k % 2] for pair in loop.applied.bounded], -UNLIMITED, UNLIMITED) * (k % 4 > 1)
            # Kind of the call as in tests/check.h: usual, without a plan before, or hard.
            if not planned:
                kind = 1
            elif episode:
                kind = 2
            else:
                kind = 0
            settings = _settings(loop, episode, k)
            y = _spoilt(loop, finger.measured(u), episode, k, rng)
            switch = (_HELD - k % _HELD) * loop.period / loop.stages.stage
            flags = (k == 0, k % 37 == 8, k % 27 in (5, 6), kind)
            code, out = record.call(flags, settings, _known(loop, k), y, wanted, later, [switch], applied)
            planned = code >= 0 and code != Code.WARN_SAFE_RAMP
            u = out[:nu].astype(float) if code >= 0 else u
            finger.advance(u)
    return record, bad_entries(real, loop.settings.fields, 0, ROW_FLAGS, Code.ERR_RANGE)


def _estimator_rows(loop: Loop, real: CReal, begin: _Begin) -> tuple[_Record, list[Bad]]:
    rng = np.random.default_rng(1)
    nz = loop.estimate.size
    low, high = loop.stages.u_min, loop.stages.u_max
    record = begin(2 * nz + 1, nz, _EPISODES * _EPISODE)
    for episode in range(_EPISODES):
        finger = ReplayedFinger(loop, rng)
        u = loop.before.copy()
        for k in range(_EPISODE):
            if k % 10 == 0:
                target = low + (high - low) * rng.uniform(0.0, 0.3, len(low))
            u = u + 0.3 * (target - u)
            y = _spoilt(loop, finger.measured(u), episode, k, rng)
            # The estimator refuses parameters that are none, which is among the bad entries.
            p = loop.stages.p_nominal if k % 31 == 20 else _known(loop, k)
            record.call((k == 0, 0, 0, 0), p, y, u)
            finger.advance(u)
            if k % 25 == 15:
                finger.kick(1.0 + episode)
    known = loop.known.fields if loop.known is not None else ()
    bad = bad_entries(real, known, 0, ROW_FLAGS, Code.ERR_RANGE)
    at = ROW_FLAGS + loop.stages.np + loop.measurement.size
    return record, bad + bad_entries(real, loop.applied.fields, 0, at, Code.ERR_RANGE)


def _mission_rows(loop: Loop, real: CReal, begin: _Begin) -> tuple[_Record, list[Bad]]:
    """All phases in turn; missions that let go after the lift, are aborted in the squeeze, are blind from there on."""
    rng = np.random.default_rng(2)
    nu = loop.command.size
    phases = [] if loop.phases is None else [*loop.phases.names]
    numbers = {} if loop.phases is None else loop.phases.members
    begins = np.asarray(numbers["begin"])
    last = float(np.sum(numbers["length"]))
    lifted, squeezed = (begins[phases.index(name)] for name in ("hold", "squeeze"))
    courses = ((last, 0), (lifted + 0.5 * last, 1), (squeezed + 0.5 * last, 2), (squeezed + 0.5 * last, 3))
    record = begin(nu + loop.start.size + 3, nu, sum(math.ceil(ends / loop.period) for ends, _ in courses))
    for ends, asked in courses:
        finger = ReplayedFinger(loop, rng)
        u = loop.before.copy()
        ended = 0
        opens = round((lifted if asked == 1 else squeezed) / loop.period) + 10
        for k in range(math.ceil(ends / loop.period)):
            flags = (k == 0, asked == 1 and k == opens, asked == 2 and k == opens, 1 if k == 0 else 0)
            y = finger.measured(u)
            reported = 1 + (k % 7 == 3 if asked else 0)
            if k % 53 == 20:
                y[rng.integers(len(y))] = np.nan
            if asked == 3 and k >= opens:
                y[:] = np.nan
            # It sinks in the hold, by what is squeezed for, and where it is let go after the lift by what is set down.
            sinks = -1e-3 * (1 + 4 * asked) * min(max(k * loop.period - lifted, 0.0) / 0.2, 1.0)
            height = [sinks] if loop.phases and loop.phases.watches else []
            code, out = record.call(flags, y, [reported if loop.phases and loop.phases.reported else 0], height)
            ended += bool(phases) and int(out[-3]) == len(phases) - 1
            if ended == _ENDED:
                break
            u = out[:nu].astype(float) if code >= 0 else u
            finger.advance(u)
    return record, []


_ROWS = {"mpc": _controller_rows, "estimator_step": _estimator_rows, "mission_step": _mission_rows}


def stateful_vectors(
    contents: Contents, double: Contents | None, files: Mapping[str, str], report: Callable[[float, str], None]
) -> tuple[list[Vectors], dict[str, tuple[OutputError, ...]]]:
    """Vectors of all such functions by a build on this machine, and their rounding errors.

    The error is the difference of the first outputs (command, estimate) from a build in ``double``, where there is one,
    that is called from the same memory: the greatest of the usual rows but for a share of ``_DECIDED``. It is no bound:
    where a measurement is left out by one build alone, or another active set ends the iterations, outputs jump.
    """
    loop, real = contents.subject.loop, contents.subject.real
    if loop is None or not contents.stateful:
        return [], {}
    report(0.0, "compiling the code for its test vectors")
    builds = _Host(contents, files), None if double is None else _Host(double, library_files(double))
    structs = {struct.name: struct for part in contents.parts for struct in part.structs}
    vectors = list[Vectors]()
    errors = dict[str, tuple[OutputError, ...]]()
    for k, function in enumerate(contents.stateful):

        def vectors_of(share: float, done: int = k, name: str = function.name) -> None:
            # 0.3: compiling takes about as long as 40 % of the rows
            report(0.3 + 0.7 * (done + share) / len(contents.stateful), f"computing test vectors of {name}")

        record, bad = _ROWS[function.name](loop, real, partial(_Record, loop, builds, function, vectors_of))
        vectors.append(record.vectors(bad))
        if double is not None:
            errors[function.name] = record.errors(structs[function.output])
    return vectors, errors
