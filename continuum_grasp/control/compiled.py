"""C of controllers and estimators: their source, and objects of it that take and return doubles."""

from __future__ import annotations

import ctypes
import hashlib
import math
import re
import struct

import numpy as np

from continuum_grasp.base import Array, InputError
from continuum_grasp.control.iteration import source as rti
from continuum_grasp.control.members import REPORTED
from continuum_grasp.control.parts import ControlParts, Settings, is_whole
from continuum_grasp.core import CodeKind, Compiler, CSource


def estimator_source(parts: ControlParts, real: str) -> str:
    """Write the C of an estimator for Python: the functions of ``c/estimator_python.c``."""
    return _joined(
        real,
        *parts.macros(controls=False),
        *_estimator(parts, real),
        _setter("ekf_settings", parts.filter),
        _templates("doubles.h", "estimator_python.c"),
    )


def controller_source(parts: ControlParts, real: str) -> str:
    """Write the C of a controller for Python: the functions of ``c/controller_python.c``."""
    estimation = parts.estimation
    filtered = None if estimation is None else estimation.single
    iterations = rti.iteration_source(parts.stages, real=real, filtered=filtered)
    # The clock of timing.h is POSIX, which a compiler asked for plain C11 hides without the macro.
    texts = ["#define _POSIX_C_SOURCE 199309L\n#include <stddef.h>", iterations, *parts.macros(controls=True)]
    texts += ["#define CG_SINGLE" if real == "float" else "", _templates("checks.h")]
    # CasADi defines the prefix of its helpers' names once per file; here the stages come first.
    if estimation is not None:
        texts += ["#undef CASADI_PREFIX", *_estimator(parts, real, has_lanes="#define EKF_VECTOR" in iterations)]
    texts += [
        _templates("timing.h", "supervisor.h", "controller.h", "supervisor.c", "controller.c"),
        _setter("controller_settings", parts.settings_in(real)),
        _reported(),
        _templates("doubles.h", "controller_python.c"),
    ]
    return "\n".join(texts)


def _mission_source(sizes: dict[str, int], settings: Settings) -> str:
    """Write the C of the phases of a mission for Python: the functions of ``c/mission_python.c``."""
    # Setpoints to the bit as in exported C: products and sums are not fused.
    unfused = '#ifdef __clang__\n#pragma STDC FP_CONTRACT OFF\n#else\n#pragma GCC optimize("fp-contract=off")\n#endif'
    macros = [f"#define MISSION_{name} {size}" for name, size in sizes.items()]
    parts = _templates("checks.h", "mission.h", "mission.c"), _setter("mission_settings", settings)
    return "\n".join([unfused, _joined("double", *macros, *parts, _templates("doubles.h", "mission_python.c"))])


def _joined(real: str, *texts: str) -> str:
    """Join C that computes in a type."""
    return "\n".join([f"#include <stddef.h>\ntypedef {real} real;", "#define CG_SINGLE" * (real == "float"), *texts])


def _estimator(parts: ControlParts, real: str, *, has_lanes: bool = False) -> list[str]:
    """Write generated functions, those in lanes unless they are there already, and templates of an estimator."""
    e = parts.observed
    # A step and half a step are two lanes of one function if they have the same form.
    vector = CSource([e.single], real).lanes() if e.single is not None and not has_lanes else ""
    scalar = [] if vector or has_lanes else [e.step, *([e.flow] if parts.ahead > parts.shared else [])]
    return [
        CSource([*scalar, e.outputs, e.parameters], real).plain("estimator"),
        f"{vector}#define EKF_VECTOR" if vector else "",
        _templates("checks.h", "ekf.h", "ekf.c"),
    ]


def _templates(*names: str) -> str:
    """Join templates without their includes of one another."""
    return "\n".join(re.sub(r'#include "\w+\.[ch]"\n', "", rti.template(name)) for name in names)


def _setter(structure: str, settings: Settings) -> str:
    """Write ``cg_fill``, which reads settings from the concatenated values of all members."""
    lines = [f"static void cg_fill({structure} *o, const double *v)", "{", "  memset(o, 0, sizeof *o);"]
    for member, setting in settings.items():
        values = np.asarray(setting)
        kind = "int" if is_whole(values) else "real"
        if values.ndim == 0:
            lines.append(f"  o->{member} = ({kind})*v++;")
        elif values.size:
            lines += [
                f"  for (int i = 0; i < {values.size}; ++i) (({kind} *)o->{member})[i] = ({kind})v[i];",
                f"  v += {values.size};",
            ]
    return "\n".join([*lines, "}"])


def _reported() -> str:
    """Write ``cg_write_reported``, which writes the report of a call as doubles."""
    lines = [f"  *out++ = (double)from->{each.place};" for each in REPORTED]
    head = "static double *cg_write_reported(double *out, const controller_output *from)"
    return "\n".join([head, "{", *lines, "  return out;", "}"])


def _values(settings: Settings) -> Array:
    """Concatenate the values of all members."""
    return np.concatenate([np.ravel(np.asarray(values, dtype=float)) for values in settings.values()])


_HEAD = struct.Struct("<8s16sqqq")
"""Head of a saved state: magic, key of problem and precision, bytes of the state, two numbers of its owner."""
_MAGIC = b"cgstate1"
_ALIGNMENT = 64
"""Alignment of the object's memory [bytes]: a cache line, and the widest vector register (AVX-512)."""


def _slices(sizes: dict[str, int]) -> dict[str, slice]:
    """Slice of each named vector in their concatenation."""
    ends = np.cumsum([0, *sizes.values()])
    return {name: slice(int(a), int(b)) for name, a, b in zip(sizes, ends[:-1], ends[1:], strict=True)}


class Compiled:
    """An object of a C source that defines ``cg_size``, ``cg_settings`` and ``cg_start``, its state first.

    A call reads the vectors ``given`` and writes the vectors of ``parts``, each named with its size, one after the
    other. Messages call it ``what``; ``passes`` through its code that are expected decide how it is compiled.
    """

    def __init__(
        self,
        source: str,
        settings: Settings,
        given: dict[str, int],
        parts: dict[str, int],
        what: str,
        passes: float = math.inf,
    ) -> None:
        # Each line of the source runs once in a pass.
        self.code = CodeKind.of_source(source, passes * source.count("\n"))
        self.library = Compiler.load(source, what, quick=self.code is CodeKind.QUICK)
        for name in ("cg_size", "cg_state_size"):
            getattr(self.library, name).restype = ctypes.c_size_t
        # The memory's layout depends on the source, what a state means on the settings too.
        self._key = hashlib.sha256(source.encode() + _values(settings).tobytes()).digest()[:16]
        memory = np.zeros(self.library.cg_size() + _ALIGNMENT, np.uint8)
        start = -memory.ctypes.data % _ALIGNMENT
        self._memory = memory[start : start + self.library.cg_size()]
        self.state = self._memory[: self.library.cg_state_size()]
        self._input, self.output = np.zeros(sum(given.values())), np.zeros(sum(parts.values()))
        self.given = [self._input[part] for part in _slices(given).values()]
        self.parts = _slices(parts)
        self.address = ctypes.c_void_p(self._memory.ctypes.data)
        self.input_address = ctypes.c_void_p(self._input.ctypes.data)
        self.output_address = ctypes.c_void_p(self.output.ctypes.data)
        self.configure(settings)

    @staticmethod
    def of_mission(sizes: dict[str, int], settings: Settings, given: dict[str, int], parts: dict[str, int]) -> Compiled:
        """The phases of a mission, by dimensions and settings of ``c/mission.h``."""
        return Compiled(_mission_source(sizes, settings), settings, given, parts, "the mission")

    def configure(self, settings: Settings) -> None:
        """Set the settings; the state stays."""
        values = _values(settings)
        self.library.cg_settings(self.address, ctypes.c_void_p(values.ctypes.data))

    def step(self) -> tuple[int, dict[str, Array]]:
        """Call ``cg_step``; return its status and its outputs by name."""
        status = self.library.cg_step(self.address, self.input_address, self.output_address)
        values = self.output.copy()
        return status, {name: values[part] for name, part in self.parts.items()}

    def give(self, function: str, *arguments: Array) -> None:
        """Call a function of the object that takes its arguments one after the other."""
        values = np.concatenate(arguments)
        getattr(self.library, function)(self.address, ctypes.c_void_p(values.ctypes.data))

    def save(self, step: int, flags: int = 0) -> bytes:
        """Serialize the state with two numbers of its owner."""
        return _HEAD.pack(_MAGIC, self._key, self.state.size, step, flags) + self.state.tobytes()

    def restore(self, saved: bytes) -> tuple[int, int]:
        """Restore a saved state of the same problem, version and precision; return the owner's numbers."""
        head = _HEAD.unpack(saved[: _HEAD.size]) if len(saved) >= _HEAD.size else (b"", b"", 0, 0, 0)
        magic, key, size, step, flags = head
        if magic != _MAGIC or size != len(saved) - _HEAD.size:
            raise InputError(f"expected a state from save_state, got {len(saved)} bytes of something else")
        if key != self._key or size != self.state.size:
            raise InputError("the saved state belongs to another problem, version or precision")
        self.state[:] = np.frombuffer(saved, np.uint8, offset=_HEAD.size)
        return step, flags
