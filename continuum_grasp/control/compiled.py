"""C of controllers and estimators: their settings, their source, and objects of it that take and return doubles."""

from __future__ import annotations

import ctypes
import hashlib
import math
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.control.estimation.model import Estimation
from continuum_grasp.control.estimation.noise import Ranges, measurement_std, noise_of, ranges_of
from continuum_grasp.control.ocp.bounds import ABSENT
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.control.rti import source as rti
from continuum_grasp.core.source import plain_source
from continuum_grasp.errors import InputError
from continuum_grasp.scene.control import ControlScene

if TYPE_CHECKING:
    from continuum_grasp.control.estimation.contact_model import ContactModel

Array = NDArray[np.float64]

_RAMP = 0.5
"""Time in which the safe ramp crosses the whole range of an input [s]: longer than the period of the first mode of the
shipped fingers (0.4 s), so that the ramp does not make them swing."""
_WINDOW = 0.2
"""Time over which mismatch and activity are averaged [s]: a shorter one reports noise, and a swinging loop is lost
within a second."""
_LEAST_WINDOW = 20
"""Least number of calls of that window [1]: a mean over fewer exceeds the thresholds of ``c/supervisor.c`` by
chance."""
_SETTLING = 3
"""Calls beyond the estimator's delay until innovations are compared [1]: the first ones contain the error of the
start."""
_RUNGS = 2
"""Fourfold raises of the weight of the command's rate [1]: 16 times the weight tolerates three periods of unmodeled
delay."""
_STILL = 1e-3
"""Change of a reading, relative to its sensor's standard deviation, up to which it is at rest [1]: 20 readings of white
noise in a row stay within it once in 1e60 cases, at a tenth of the declared noise once in 1e45."""
_CROSSING = 0.1
"""Time in which a fully active command crosses its range where its rate has no tighter limit [s]: that of the shipped
scenes (59 N at 600 N/s)."""
_FAR = 0.1
"""Distance of the tip from its setpoint beyond which it is away, in finger lengths [1]: working loops stay below 0.09
(configs/mpc/keep_out.yaml: 16 mm of 180 mm), lost ones reach 0.5."""


@dataclass(frozen=True)
class Field:
    """A member of a C structure of settings, and its values."""

    member: str
    values: ArrayLike
    whole: bool = False


def delay_periods(scene: ControlScene) -> int:
    """Return the age of measurements in control periods."""
    return 0 if scene.estimator is None else round(scene.estimator.delay / scene.controller.step)


def estimator_fields(
    scene: ControlScene, model: Prediction, stages: Stages, estimation: Estimation, ranges: Ranges
) -> list[Field]:
    """List the members of ``ekf_settings`` of a scene with an estimator."""
    process, initial, measured = noise_of(scene, model, estimation)
    states = np.vstack([ranges.x, ranges.disturbances])
    period = scene.controller.step
    # Steps as long as those of the stages, which the stiffness allows; rounding must not add one.
    substeps = max(1, math.ceil(stages.substeps * period / stages.stage - 1e-9))
    return [
        Field("noise", process),
        Field("initial", initial),
        Field("z_min", states[:, 0]),
        Field("z_max", states[:, 1]),
        Field("mixing", estimation.mixing),
        Field("variance", measured),
        Field("y_min", ranges.measurement[:, 0]),
        Field("y_max", ranges.measurement[:, 1]),
        Field("period", period),
        Field("substeps", substeps, whole=True),
        Field("gate", scene.estimator.outlier if scene.estimator is not None else math.inf),
        Field("sensor", [estimation.sensor_names.index(name) for name in estimation.sensors], whole=True),
        *([Field("friction", estimation.friction, whole=True)] if estimation.friction else []),
    ]


def controller_fields(
    scene: ControlScene,
    model: Prediction,
    stages: Stages,
    estimation: Estimation | None,
    precision: str,
    contact: ContactModel | None = None,
) -> list[Field]:
    """List the members of ``controller_settings``, for C in double or float."""
    ranges, asked = ranges_of(scene, model, stages, estimation), scene.controller
    fields = [
        *_nested("rti", _iteration_fields(scene, stages, precision)),
        Field("period", asked.step),
        Field("u_rate", np.full(stages.nu, asked.input.rate_max or ABSENT)),
        Field("u_safe", scene.rest_input),
        # The C refuses a rate of zero, which an input that cannot move would have.
        Field("safe_rate", np.maximum((stages.u_max - stages.u_min) / _RAMP, 1e-9)),
        Field("applied_min", ranges.applied[:, 0]),
        Field("applied_max", ranges.applied[:, 1]),
        Field("r_min", ranges.r[:, 0]),
        Field("r_max", ranges.r[:, 1]),
        Field("p_min", ranges.p[:, 0]),
        Field("p_max", ranges.p[:, 1]),
        Field("x_min", ranges.x[:, 0]),
        Field("x_max", ranges.x[:, 1]),
        Field("sqp_iterations", asked.sqp_iterations, whole=True),
        Field("start_iterations", asked.start_iterations, whole=True),
        *_nested("supervisor", _supervisor_fields(scene, stages, estimation)),
    ]
    if estimation is not None:
        fields += _nested("ekf", estimator_fields(scene, model, stages, estimation, ranges))
        if contact is not None:
            felt = [estimation.measurement_names.index(name) for name in contact.measurement_names]
            fields += [*_nested("contact", contact.fields), Field("felt", felt, whole=True)]
    return fields


def _iteration_fields(scene: ControlScene, stages: Stages, precision: str) -> list[Field]:
    """List the members of ``rti_settings``."""
    real = np.float64 if precision == "double" else np.float32
    return [
        *[Field(name, getattr(stages, name)) for name in rti.SETTINGS],
        Field("stage", stages.stage),
        Field("substeps", stages.substeps, whole=True),
        Field("iterations", scene.controller.iterations, whole=True),
        Field("tolerance", float(real(rti.TOLERANCE[precision]))),
        Field("regularization", float(real(rti.REGULARIZATION))),
    ]


def _nested(name: str, fields: list[Field]) -> list[Field]:
    return [Field(f"{name}.{f.member}", f.values, f.whole) for f in fields]


def _supervisor_fields(scene: ControlScene, stages: Stages, estimation: Estimation | None) -> list[Field]:
    """List the members of ``supervisor_settings``."""
    asked, period = scene.controller, scene.controller.step
    window = max(_LEAST_WINDOW, math.ceil(_WINDOW / period - 1e-9)) if asked.supervisor else 0
    names = estimation.measurement_names if estimation is not None else tuple("x" * stages.nd)
    devices = estimation.sensor_names if estimation is not None else ()
    sensor = [devices.index(estimation.device(name)) for name in names] if estimation is not None else [0] * len(names)
    checks_frozen = scene.estimator is not None and scene.estimator.frozen
    rate = np.minimum(asked.input.rate_max or math.inf, (stages.u_max - stages.u_min) / _CROSSING)
    return [
        Field("window", window, whole=True),
        Field("delay", delay_periods(scene) + _SETTLING, whole=True),
        # Without a weight of the command's rate there is nothing to raise.
        Field("rungs", _RUNGS if asked.cost.input_rate else 0, whole=True),
        Field("sensor", sensor, whole=True),
        # Tip and angles show the shape; drives do not.
        Field("shape", [int(name in ("tip", "bending")) for name in devices] or [0], whole=True),
        # A tension moves with its own command, everything else with all of them.
        Field("cause", [_first(name, stages.u_names) for name in names], whole=True),
        # Below zero: not tested.
        Field("still", [_STILL * measurement_std(scene, name) if checks_frozen else -1.0 for name in names]),
        # Divisors in the C: not zero where an input cannot move.
        Field("change", np.maximum(rate * period, 1e-12)),
        Field("tip", _first("tip_x [m]", names), whole=True),
        Field("setpoint", _first("tip_x [m]", stages.r_names), whole=True),
        Field("far", _FAR * scene.finger.rod.length),
    ]


def _first(name: str, names: tuple[str, ...]) -> int:
    return names.index(name) if name in names else -1


def estimator_source(
    estimation: Estimation, periods: int, nu: int, np_: int, fields: Sequence[Field], real: str
) -> str:
    """Write the C of an estimator for Python: the functions of ``c/estimator_python.c``."""
    return "\n".join(
        [
            f"#include <stddef.h>\ntypedef {real} real;",
            *_estimator(estimation, periods, nu, np_, real),
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
    parts = ["#define _POSIX_C_SOURCE 199309L\n#include <stddef.h>", rti.iteration_source(stages, real=real)]
    measured, sensors = stages.nd, 0
    if estimation is None:
        parts += ["#define CG_SINGLE" if real == "float" else "", _templates("checks.h")]
    else:
        measured, sensors = estimation.nm, len(estimation.sensor_names)
        dimensions, *rest = _estimator(estimation, periods, stages.nu, stages.np, real)
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


def _detector(model: ContactModel, real: str) -> list[str]:
    """Write dimensions, generated functions and templates of a contact detector."""
    return [
        *[f"#define CONTACT_{name} {size}" for name, size in model.sizes.items()],
        plain_source("contact", model.functions, real),
        _templates("checks.h", "contact_detector.h", "contact_detector.c"),
    ]


def estimator_sizes(estimation: Estimation, periods: int, nu: int, np_: int) -> dict[str, int]:
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
        "NF": len(estimation.friction),
    }


def _estimator(estimation: Estimation, periods: int, nu: int, np_: int, real: str) -> list[str]:
    """Write dimensions, generated functions and templates of an estimator."""
    lines = [f"#define EKF_{name} {size}" for name, size in estimator_sizes(estimation, periods, nu, np_).items()]
    # The step without derivatives predicts over the delay, and is not needed without one.
    flow = [estimation.flow] if periods else []
    functions = [estimation.step, estimation.outputs, estimation.parameters, *flow]
    return [
        "\n".join([*lines, "#define CG_SINGLE" if real == "float" else ""]),
        plain_source("estimator", functions, real),
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
"""Of the object's memory [bytes]: a cache line, and the widest vector register (AVX-512)."""


def _slices(sizes: dict[str, int]) -> dict[str, slice]:
    """Where each of the named vectors lies in their concatenation."""
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
