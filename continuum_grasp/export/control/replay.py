"""Test vectors of estimator and controller: calls in their order, on a finger that is simulated along.

The rows hold what is measured, wanted and set; the expected outputs are those of the strict build on this machine.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.control.ocp.cost_terms import Outputs
from continuum_grasp.control.ocp.setpoints import setpoints
from continuum_grasp.export.accuracy import OutputError
from continuum_grasp.export.control.host import Host
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.fields import REALS, Real, Struct
from continuum_grasp.export.layer import abi_of, library_files, stateful_of
from continuum_grasp.export.part import Code, Part, Stateful, Vectors
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.vectors import bad_entries

Array = NDArray[Any]

_EPISODE = 70
"""Calls from one start to the next: three times ``_HELD``, so that setpoints change in each, and some at the end."""
_EPISODES = 3
"""Each with harder knocks than the one before; from the second on, commands that were applied differ too."""
_HELD = 20
"""Calls for which setpoints stay."""
_FLAGS = 4
"""Numbers before the others of a row: begin anew, late, whether something else was applied, kind of the call."""


class _Finger:
    """The prediction as a plant, with what is measured of it."""

    def __init__(self, loop: Loop, rng: np.random.Generator) -> None:
        self._loop, self._rng = loop, rng
        s = loop.stages
        self._parts = max(1, math.ceil(s.substeps * loop.period / s.stage - 1e-9))
        self.x = loop.first[: s.nd].copy()
        self._mixing = None if loop.estimation is None else np.linalg.pinv(loop.estimation.mixing)
        self._then: list[Array] = []

    def advance(self, u: Array) -> None:
        s = self._loop.stages
        held = np.asarray(u, dtype=float)
        for _ in range(self._parts):
            given = np.concatenate([self.x, held[: s.nx - s.nd]])
            x = np.array(s.step(given, held, s.p_nominal, self._loop.period / self._parts)[0]).ravel()[: s.nd]
            self.x = x if np.isfinite(x).all() else self._loop.first[: s.nd].copy()

    def measured(self, u: Array) -> Array:
        """What is measured now, of as long ago as measurements are late."""
        loop, e = self._loop, self._loop.estimation
        if e is None or self._mixing is None:
            return self.x.copy()
        z = np.zeros(e.nz)
        z[: e.nx] = self.x
        value = self._mixing @ np.array(e.outputs(z, u, loop.stages.p_nominal)[0]).ravel()
        self._then = [*self._then[-loop.periods :], value] if loop.periods else [value]
        noise = np.array([1e-4 if "[m]" in name else 1e-2 for name in loop.measurement_names])
        found: Array = self._then[0] + noise * self._rng.standard_normal(len(noise))
        return found

    def kick(self, size: float) -> None:
        """A push."""
        n = self._loop.prediction.system.finger_model.n
        self.x[n : 2 * n] += size * self._rng.standard_normal(n)


def _spoilt(loop: Loop, y: Array, episode: int, k: int, rng: np.random.Generator) -> Array:
    """What arrives of a measurement: now and then an entry is missing or infinite, later on all are, or far off."""
    y = y.copy()
    patience = round(loop.stages.stages * loop.stages.stage / loop.period)
    if k % 17 == 9:
        y[rng.integers(len(y))] = np.nan
    if k % 23 == 11:
        y[rng.integers(len(y))] = np.inf if k % 2 else -np.inf
    if episode and k % 19 == 13:
        at = rng.integers(len(y))
        y[at] += 0.4 * (loop.measurement.bounded[at][1] - y[at])
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
    parts = np.cumsum([0, s.nr, s.nr, s.nu, s.nu, s.nc, s.nc])
    values[: parts[2]] *= 1.5 if episode == 1 else 0.7
    width = values[parts[3] : parts[4]] - values[parts[2] : parts[3]]
    values[parts[3] : parts[4]] -= 0.3 * width * (episode == 1)
    for low, high in ((parts[4], parts[5]), (parts[5], parts[6])):
        rows = values[low:high]
        rows[np.abs(rows) < 1e20] *= 0.25 if episode == 2 else 0.6
    return values


def _target(loop: Loop, rng: np.random.Generator) -> Array:
    """Setpoints of the scene at some instant."""
    rows = setpoints(Outputs.of(loop.scene.controller.cost, loop.prediction), loop.scene.reference)
    found: Array = rows.rows(rng.uniform(0.0, loop.scene.duration or 1.0))[0]
    return found


def _kind(episode: int, planned: bool) -> int:
    """Kind of a call as in ``tests/check.h``: usual, without a plan before, or hard."""
    return 1 if not planned else 2 if episode else 0


def controller_vectors(loop: Loop, real: Real, host: Host, runner: str) -> Vectors:
    """Vectors of the controller."""
    rng = np.random.default_rng(0)
    nu, outputs = loop.command.size, loop.command.size + loop.start.size + 5
    rows, outs, codes = [], [], []
    for episode in range(_EPISODES):
        finger, u, planned = _Finger(loop, rng), loop.before.copy(), False
        later = _target(loop, rng)
        for k in range(_EPISODE):
            if k % _HELD == 0:
                now, later = later, _target(loop, rng)
            if k % 25 == 15:
                finger.kick(1.0 + episode)
            wanted = np.where(np.arange(len(now)) == k % len(now), np.nan, now) if k % 29 == 21 else now
            given = rng.uniform(loop.stages.u_min, loop.stages.u_max) if k % 27 == 5 else u
            if episode and k % 27 == 5:  # off, or beyond what can be commanded
                given = np.array([pair[k % 2] for pair in loop.applied.bounded]) * (k % 4 > 1)
            flags = [float(k == 0), float(k % 37 == 8), float(k % 27 in (5, 6)), float(_kind(episode, planned))]
            settings = _settings(loop, episode, k)
            y = _spoilt(loop, finger.measured(u), episode, k, rng)
            switch = (_HELD - k % _HELD) * loop.period / loop.stages.stage
            parts = [flags, settings, _known(loop, k), y, wanted, later, [switch], given]
            row = np.concatenate([np.asarray(part, dtype=float) for part in parts]).astype(real.dtype)
            code, out = host.run("mpc", row, outputs)
            planned = code not in (Code.WARN_SAFE_RAMP, *(c for c in Code if c < 0))
            rows.append(row)
            outs.append(out)
            codes.append(code)
            u = out[:nu].astype(float) if code >= 0 else u
            finger.advance(u)
    bad = bad_entries(real, loop.settings.fields, 0, _FLAGS, Code.ERR_RANGE)
    return Vectors(
        "mpc", runner, np.array(rows), np.array(outs), np.array(codes), tuple(bad), pointers=5, close=nu, stateful=True
    )


def estimator_vectors(loop: Loop, real: Real, host: Host, runner: str) -> Vectors:
    """Vectors of the estimator."""
    rng = np.random.default_rng(1)
    nz, low, high = loop.estimate.size, loop.stages.u_min, loop.stages.u_max
    outputs = 2 * nz + 1
    rows, outs, codes = [], [], []
    for episode in range(_EPISODES):
        finger, u = _Finger(loop, rng), loop.before.copy()
        for k in range(_EPISODE):
            if k % 10 == 0:
                target = low + (high - low) * rng.uniform(0.0, 0.3, len(low))
            u = u + 0.3 * (target - u)
            y = _spoilt(loop, finger.measured(u), episode, k, rng)
            flags = [float(k == 0), 0.0, 0.0, 0.0]
            p = np.array(loop.stages.p_nominal, dtype=float) if k % 31 == 20 else _known(loop, k)
            row = np.concatenate([flags, p, y, u]).astype(real.dtype)
            code, out = host.run("estimator_step", row, outputs)
            rows.append(row)
            outs.append(out)
            codes.append(code)
            finger.advance(u)
            if k % 25 == 15:
                finger.kick(1.0 + episode)
    known = loop.known.fields if loop.known is not None else ()
    bad = bad_entries(real, known, 0, _FLAGS, Code.ERR_RANGE)
    at = _FLAGS + loop.stages.np + loop.measurement.size
    bad += bad_entries(real, loop.applied.fields, 0, at, Code.ERR_RANGE)
    return Vectors(
        "estimator_step",
        runner,
        np.array(rows),
        np.array(outs),
        np.array(codes),
        tuple(bad),
        pointers=5,
        close=nz,
        stateful=True,
    )


def _replayed(loop: Loop, vectors: Vectors, host: Host, real: Real) -> tuple[Array, Array]:
    """Codes and outputs that a wider build gives for the same rows.

    Limits of the input, which rounding may have moved out of range, are those of the loop again.
    """
    rows = vectors.inputs.astype(real.dtype)
    for limit in (*loop.stages.u_min, *loop.stages.u_max):
        rows[vectors.inputs == vectors.inputs.dtype.type(limit)] = limit
    codes, outputs = zip(*(host.run(vectors.name, row, vectors.outputs.shape[1]) for row in rows), strict=True)
    return np.array(codes), np.array(outputs)


SIZES = ("estimator_bytes", "estimator_work_bytes", "controller_bytes", "controller_work_bytes")
"""Places of the header for what is known once it was compiled."""
UNKNOWN = "0x7fffffff"
"""What stands there before."""


def stateful_vectors(
    subject: Subject,
    parts: Sequence[Part],
    wide: Sequence[Part],
    files: Mapping[str, str],
    words: dict[str, str],
) -> tuple[list[Vectors], dict[str, tuple[OutputError, ...]]]:
    """Vectors of all such functions by a build on this machine, and their rounding errors; writes the sizes to words.

    The error is the greatest difference of the first outputs (command, estimate) in usual rows from a build in double
    that is given the same rows. It is no bound: where a measurement is left out by one build alone, or another active
    set ends the iterations, outputs jump.
    """
    functions = stateful_of(parts)
    host = _host(subject, functions, files)
    words |= {f"{name}_bytes": str(size) for name, size in host.sizes.items()}
    vectors = [function.vectors(host, function.runner) for function in functions]
    errors: dict[str, tuple[OutputError, ...]] = {}
    if subject.real.name == "float" and subject.loop is not None:
        double = replace(subject, real=REALS["double"])
        written = {**words, "real": "double", **dict.fromkeys(SIZES, UNKNOWN)}
        written["abi"] = abi_of(double, wide, written)
        other = _host(double, functions, library_files(double, wide, written))
        structs = {struct.name: struct for part in parts for struct in part.structs}
        for v, function in zip(vectors, functions, strict=True):
            output = structs[function.output]
            errors[v.name] = _differences(v, output, *_replayed(subject.loop, v, other, double.real))
    return vectors, errors


def stateful_usage(prefix: str, function: Stateful) -> str:
    """C of a first call."""
    owner = function.types[0]
    structs = [*function.inputs, function.output]
    lines = [f"static {prefix}_{name} {name};" for name in (*function.types, *structs)]
    passed = ", ".join(f"&{name}" for name in (*function.types, *structs))
    lines.append(f"int code = {prefix}_{owner}_init(&{owner});")
    notes = {
        "measurement": " /* nothing measured: NaN */",
        "reference": " /* the setpoints of the scene, at all nodes */",
        "command": " /* what was applied before */",
    }
    for name in function.inputs:
        lines.append(f"if (code >= 0) code = {prefix}_{name}_init(&{name});{notes[name]}")
    lines.append("/* every period: write what was measured into the measurement, leave the rest NaN; then */")
    lines.append(f"if (code >= 0) code = {prefix}_{function.name}({passed});")
    lines.append(f"if (code < 0) report({prefix}_strerror(code)); /* above zero: a warning, see the table of codes */")
    return "\n".join(lines)


def _host(subject: Subject, functions: Sequence[Stateful], files: Mapping[str, str]) -> Host:
    runners = {function.name: function.runner for function in functions}
    owners = list(dict.fromkeys(name for function in functions for name in function.types))
    return Host(files, subject.prefix, subject.real, runners, owners)


def _differences(vectors: Vectors, output: Struct, codes: np.ndarray, other: np.ndarray) -> tuple[OutputError, ...]:
    """Greatest of each output; infinite where only one of them gives an output."""
    usual = vectors.inputs[:, 3] == 0.0
    found, true = vectors.outputs[usual, : vectors.close].astype(float), other[usual, : vectors.close]
    off = np.abs(found - true).max(axis=0)
    if ((codes < 0) != (vectors.codes < 0))[usual].any():
        off[:] = np.inf
    return tuple(
        OutputError(field.name, field.unit, float(f"{difference:.2g}"), float(f"{size:.2g}"))
        for field, difference, size in zip(output.fields, off, np.abs(true).max(axis=0), strict=True)
    )
