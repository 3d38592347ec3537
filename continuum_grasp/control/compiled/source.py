"""C source of estimators and controllers, with an interface of doubles for Python."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.control.estimation.model import Estimation
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.control.rti.source import iteration_source, template
from continuum_grasp.core.precision import single

__all__ = ["Field", "controller_source", "estimator_functions", "estimator_source", "settings_values"]

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
    options = {"with_header": False, "with_export": False, "static_aux": True, "with_mem": False}
    generator = ca.CodeGenerator("estimator.c", options)
    for function in (estimation.step, estimation.outputs, estimation.parameters):
        generator.add(function)
    if periods:
        generator.add(estimation.flow)
    code = str(generator.dump())
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
