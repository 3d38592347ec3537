"""C source of estimators and controllers, compiled and called from Python with doubles."""

from __future__ import annotations

import ctypes
import hashlib
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.control.estimation.model import Estimation
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.control.rti.source import iteration_source, template
from continuum_grasp.core.cache import library_for
from continuum_grasp.core.compiler import CompileError, find_compiler, why_no_compiler
from continuum_grasp.core.precision import single
from continuum_grasp.core.source import generated
from continuum_grasp.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Field:
    """A member of a C structure of settings, and its values."""

    member: str
    values: ArrayLike
    whole: bool = False


def settings_values(fields: Sequence[Field]) -> Array:
    """Concatenate the values of all members."""
    return np.concatenate([np.ravel(np.asarray(f.values, dtype=float)) for f in fields])


def estimator_source(
    estimation: Estimation, periods: int, nu: int, np_: int, fields: Sequence[Field], real: str
) -> str:
    """Write the C of an estimator for Python: the functions of ``c/estimator_python.c``."""
    return "\n".join(
        [
            f"#include <stddef.h>\ntypedef {real} real;",
            _estimator_dimensions(estimation, periods, nu, np_, real),
            estimator_functions(estimation, periods, real),
            _templates("checks.h", "ekf.h", "ekf.c"),
            _setter("ekf_settings", fields),
            _templates("doubles.h", "estimator_python.c"),
        ]
    )


def controller_source(
    stages: Stages, estimation: Estimation | None, periods: int, fields: Sequence[Field], real: str
) -> str:
    """Write the C of a controller for Python: the functions of ``c/controller_python.c``."""
    parts = ["#define _POSIX_C_SOURCE 199309L\n#include <stddef.h>", iteration_source(stages, real=real)]
    measured = stages.nd if estimation is None else estimation.nm
    if estimation is not None:
        parts += [
            _estimator_dimensions(estimation, periods, stages.nu, stages.np, real),
            "#undef CASADI_PREFIX",
            estimator_functions(estimation, periods, real),
            _templates("checks.h", "ekf.h", "ekf.c"),
        ]
    else:
        parts += ["#define CG_SINGLE" if real == "float" else "", _templates("checks.h")]
    sensors = 0 if estimation is None else len(estimation.sensor_names)
    parts += [
        f"#define CONTROLLER_ND {stages.nd}\n#define CONTROLLER_NM {measured}\n#define CONTROLLER_NS {sensors}",
        f"#define CONTROLLER_ESTIMATES {int(estimation is not None)}",
        _templates("timing.h", "supervisor.h", "controller.h", "supervisor.c", "controller.c"),
        _setter("controller_settings", fields),
        _templates("doubles.h", "controller_python.c"),
    ]
    return "\n".join(parts)


def estimator_functions(estimation: Estimation, periods: int, real: str) -> str:
    """Write the C of an estimator's functions; that of the step without derivatives only where there is a delay."""
    flow = [estimation.flow] if periods else []
    code = generated("estimator", estimation.step, estimation.outputs, estimation.parameters, *flow)
    return single(code) if real == "float" else code


def _estimator_dimensions(estimation: Estimation, periods: int, nu: int, np_: int, real: str) -> str:
    sizes = {
        "NZ": estimation.nz,
        "NX": estimation.nx,
        "NU": nu,
        "NP": np_,
        "NY": estimation.ny,
        "NS": len(estimation.sensor_names),
        "NM": estimation.nm,
        "DELAY": periods,
    }
    lines = [f"#define EKF_{name} {size}" for name, size in sizes.items()]
    return "\n".join([*lines, "#define CG_SINGLE" if real == "float" else ""])


def _templates(*names: str) -> str:
    return "\n".join(re.sub(r'#include "\w+\.h"\n', "", template(name)) for name in names)


def _setter(structure: str, fields: Sequence[Field]) -> str:
    """Write ``cg_fill``, which reads settings from the concatenated values of all members."""
    lines = [f"static void cg_fill({structure} *o, const double *v)", "{", "  memset(o, 0, sizeof *o);"]
    for field in fields:
        values = np.asarray(field.values)
        kind = "int" if field.whole else "real"
        if values.ndim == 0:
            lines.append(f"  o->{field.member} = ({kind})*v++;")
        elif values.size:
            lines += [
                f"  for (int i = 0; i < {values.size}; ++i) (({kind} *)o->{field.member})[i] = ({kind})v[i];",
                f"  v += {values.size};",
            ]
    return "\n".join([*lines, "}"])


_HEAD = struct.Struct("<8s16sqqq")
_MAGIC = b"cgstate1"
_ALIGNMENT = 64
"""Of the object's memory [bytes]: a cache line, and the widest vector register (AVX-512)."""


def load_library(source: str, users: str) -> ctypes.CDLL:
    """Compile a C source, or find it in the cache, and load it.

    Raises
    ------
    InputError
        If there is no C compiler, or it fails; ``users`` need it.
    """
    compiler = find_compiler()
    if compiler is None:
        raise InputError(f"{users} need a C compiler: {why_no_compiler()}")
    try:
        return ctypes.CDLL(str(library_for(source, compiler)))
    except (CompileError, OSError) as error:
        raise InputError(f"{users} need a C compiler, and compiling failed: {error}") from error


class Compiled:
    """An object of a C source that defines ``cg_size``, ``cg_settings`` and ``cg_start``, its state first.

    Parameters
    ----------
    fields : sequence of Field
        Its settings.
    inputs, outputs : int
        Numbers of doubles that a call takes and returns.

    Attributes
    ----------
    input, output : ndarray
        What a call reads and writes.

    Raises
    ------
    InputError
        If there is no C compiler.
    """

    def __init__(self, source: str, fields: Sequence[Field], inputs: int, outputs: int) -> None:
        self._library = load_library(source, "controllers and estimators")
        for name in ("cg_size", "cg_state_size"):
            getattr(self._library, name).restype = ctypes.c_size_t
        self._key = hashlib.sha256(source.encode() + settings_values(fields).tobytes()).digest()[:16]
        memory = np.zeros(self._library.cg_size() + _ALIGNMENT, np.uint8)
        start = -memory.ctypes.data % _ALIGNMENT
        self._memory = memory[start : start + self._library.cg_size()]
        self.state = self._memory[: self._library.cg_state_size()]
        self.input, self.output = np.zeros(inputs), np.zeros(outputs)
        self.address = ctypes.c_void_p(self._memory.ctypes.data)
        self.input_address = ctypes.c_void_p(self.input.ctypes.data)
        self.output_address = ctypes.c_void_p(self.output.ctypes.data)
        self.configure(fields)

    def configure(self, fields: Sequence[Field]) -> None:
        """Set the settings; the state stays."""
        values = settings_values(fields)
        self._library.cg_settings(self.address, ctypes.c_void_p(values.ctypes.data))

    def function(self, name: str) -> Any:
        """Return a function of the library."""
        return getattr(self._library, name)

    def start(self, values: Array) -> None:
        """Start again from the arguments of ``cg_start``."""
        self._library.cg_start(self.address, ctypes.c_void_p(values.ctypes.data))

    def save(self, step: int, flags: int = 0) -> bytes:
        """Serialize the state with two numbers of its owner."""
        return _HEAD.pack(_MAGIC, self._key, self.state.size, step, flags) + self.state.tobytes()

    def restore(self, saved: bytes) -> tuple[int, int]:
        """Restore a saved state; return the owner's numbers.

        Raises
        ------
        InputError
            If the state is not one of the same problem, version and precision.
        """
        head = _HEAD.unpack(saved[: _HEAD.size]) if len(saved) >= _HEAD.size else (b"", b"", 0, 0, 0)
        magic, key, size, step, flags = head
        if magic != _MAGIC or size != len(saved) - _HEAD.size:
            raise InputError(f"expected a state from save_state, got {len(saved)} bytes of something else")
        if key != self._key or size != self.state.size:
            raise InputError("the saved state is of another problem, version or precision")
        self.state[:] = np.frombuffer(saved, np.uint8, offset=_HEAD.size)
        return step, flags
