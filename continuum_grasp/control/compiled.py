"""C of controllers and estimators: their source, and objects of it that take and return doubles."""

from __future__ import annotations

import ctypes
import hashlib
import re
import struct
from collections.abc import Sequence

import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.control.estimation.contact_model import ContactModel
from continuum_grasp.control.estimation.model import Estimation
from continuum_grasp.control.field import Field
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.control.rti import source as rti
from continuum_grasp.core.source import in_lanes, plain_source
from continuum_grasp.errors import InputError


def estimator_source(
    estimation: Estimation, periods: int, nu: int, np_: int, fields: Sequence[Field], real: str
) -> str:
    """Write the C of an estimator for Python: the functions of ``c/estimator_python.c``."""
    return "\n".join(
        [
            f"#include <stddef.h>\ntypedef {real} real;",
            *_estimator(estimation, periods, steps_ahead(periods, fields), nu, np_, real),
            _setter("ekf_settings", fields),
            _templates("doubles.h", "estimator_python.c"),
        ]
    )


def controller_source(
    stages: Stages,
    estimation: Estimation | None,
    periods: int,
    fields: Sequence[Field],
    real: str,
    contact: ContactModel | None = None,
) -> str:
    """Write the C of a controller for Python: the functions of ``c/controller_python.c``."""
    # The clock of timing.h is POSIX, which a compiler asked for plain C11 hides without the macro.
    filtered = None if estimation is None else estimation.single
    iterations = rti.iteration_source(stages, real=real, filtered=filtered)
    parts = ["#define _POSIX_C_SOURCE 199309L\n#include <stddef.h>", iterations]
    measured, sensors = stages.nd, 0
    if estimation is None:
        parts += ["#define CG_SINGLE" if real == "float" else "", _templates("checks.h")]
    else:
        measured, sensors = estimation.nm, len(estimation.sensor_names)
        has_lanes = "#define EKF_VECTOR" in iterations
        ahead = steps_ahead(periods, fields)
        dimensions, *rest = _estimator(estimation, periods, ahead, stages.nu, stages.np, real, has_lanes=has_lanes)
        # CasADi defines the prefix of its helpers' names once per file; here those of the stages come first.
        parts += [dimensions, "#undef CASADI_PREFIX", *rest]
    parts += [
        f"#define CONTROLLER_ND {stages.nd}\n#define CONTROLLER_NM {measured}\n#define CONTROLLER_NS {sensors}",
        f"#define CONTROLLER_ESTIMATES {int(estimation is not None)}",
        f"#define CONTROLLER_TOUCHES {int(contact is not None)}",
        *([] if contact is None else ["#undef CASADI_PREFIX", *_detector(contact, real)]),
        _templates("timing.h", "supervisor.h", "controller.h", "supervisor.c", "controller.c"),
        _setter("controller_settings", fields),
        _templates("doubles.h", *(["contact_python.c"] if contact is not None else []), "controller_python.c"),
    ]
    return "\n".join(parts)


def detector_source(model: ContactModel, real: str) -> str:
    """Write the C of a contact detector for Python: the functions of ``c/detector_python.c``."""
    return "\n".join(
        [
            f"#include <stddef.h>\ntypedef {real} real;",
            "#define CG_SINGLE" if real == "float" else "",
            *_detector(model, real),
            _setter("contact_settings", model.fields),
            _templates("doubles.h", "contact_python.c", "detector_python.c"),
        ]
    )


def mission_source(sizes: dict[str, int], fields: Sequence[Field]) -> str:
    """Write the C of the phases of a mission for Python: the functions of ``c/mission_python.c``."""
    # Setpoints to the bit as in exported C: products and sums are not fused.
    unfused = '#ifdef __clang__\n#pragma STDC FP_CONTRACT OFF\n#else\n#pragma GCC optimize("fp-contract=off")\n#endif'
    return "\n".join(
        [
            f"{unfused}\n#include <stddef.h>\ntypedef double real;",
            *[f"#define MISSION_{name} {size}" for name, size in sizes.items()],
            _templates("checks.h", "mission.h", "mission.c"),
            _setter("mission_settings", fields),
            _templates("doubles.h", "mission_python.c"),
        ]
    )


def _detector(model: ContactModel, real: str) -> list[str]:
    """Write dimensions, generated functions and templates of a contact detector."""
    return [
        *[f"#define CONTACT_{name} {size}" for name, size in model.sizes.items()],
        plain_source("contact", model.functions, real),
        _templates("checks.h", "contact_detector.h", "contact_detector.c"),
    ]


def steps_ahead(periods: int, fields: Sequence[Field]) -> int:
    """Number of a filter's steps from a measurement, some periods ago, to now, from the members of its settings.

    The first is that of the next call's prediction; only further ones need the step without derivatives.
    """
    substeps = next(field.values for field in fields if field.member in ("substeps", "ekf.substeps"))
    return periods * int(np.asarray(substeps))


def estimator_sizes(estimation: Estimation, periods: int, ahead: int, nu: int, np_: int) -> dict[str, int]:
    """Dimensions of the C of an estimator."""
    return {
        "NZ": estimation.nz,
        "NX": estimation.nx,
        "NU": nu,
        "NP": np_,
        "NY": estimation.ny,
        "NS": len(estimation.sensor_names),
        "NM": estimation.nm,
        "DELAY": periods,
        "AHEAD": ahead,
        "NF": len(estimation.friction),
        "NA": len(estimation.adapted),
    }


def _estimator(
    estimation: Estimation, periods: int, ahead: int, nu: int, np_: int, real: str, *, has_lanes: bool = False
) -> list[str]:
    """Write dimensions, generated functions, those in lanes unless it has them already, and templates of an
    estimator.
    """
    lines = [
        f"#define EKF_{name} {size}" for name, size in estimator_sizes(estimation, periods, ahead, nu, np_).items()
    ]
    # Step and half a step are two lanes of one, where they are made alike.
    vector = in_lanes([estimation.single], real) if estimation.single is not None and not has_lanes else ""
    scalar = [] if vector or has_lanes else [estimation.step, *([estimation.flow] if ahead > 1 else [])]
    return [
        "\n".join([*lines, "#define CG_SINGLE" if real == "float" else ""]),
        plain_source("estimator", [*scalar, estimation.outputs, estimation.parameters], real),
        f"{vector}#define EKF_VECTOR" if vector else "",
        _templates("checks.h", "ekf.h", "ekf.c"),
    ]


def _templates(*names: str) -> str:
    """Join templates without their includes of one another."""
    return "\n".join(re.sub(r'#include "\w+\.[ch]"\n', "", rti.template(name)) for name in names)


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


def _values(fields: Sequence[Field]) -> Array:
    """Concatenate the values of all members."""
    return np.concatenate([np.ravel(np.asarray(f.values, dtype=float)) for f in fields])


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

    A call reads the vectors ``given`` and writes those of ``parts``, each named with its size, one after the other.
    Messages call it ``what``.
    """

    def __init__(
        self, source: str, fields: Sequence[Field], given: dict[str, int], parts: dict[str, int], what: str
    ) -> None:
        self.library = rti.load_library(source, what)
        for name in ("cg_size", "cg_state_size"):
            getattr(self.library, name).restype = ctypes.c_size_t
        # The memory's layout depends on the source, what a state means on the settings too.
        self._key = hashlib.sha256(source.encode() + _values(fields).tobytes()).digest()[:16]
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
        self.configure(fields)

    def configure(self, fields: Sequence[Field]) -> None:
        """Set the settings; the state stays."""
        values = _values(fields)
        self.library.cg_settings(self.address, ctypes.c_void_p(values.ctypes.data))

    def found(self) -> dict[str, Array]:
        """Copy what the last call wrote, by name."""
        values = self.output.copy()
        return {name: values[part] for name, part in self.parts.items()}

    def start(self, *arguments: Array) -> None:
        """Start again from the arguments of ``cg_start``."""
        values = np.concatenate(arguments)
        self.library.cg_start(self.address, ctypes.c_void_p(values.ctypes.data))

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
            raise InputError("the saved state is of another problem, version or precision")
        self.state[:] = np.frombuffer(saved, np.uint8, offset=_HEAD.size)
        return step, flags
