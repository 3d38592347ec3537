"""Plants as functions of state, input, forces and parameters: finger, drives, and the object that they touch.

Their C is CasADi's, from the same expressions as in Python, with the mathematical library of the machine: it agrees to
rounding, not to the last bit.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.export.casadi_source import generated_c
from continuum_grasp.export.control.loop import identifiers, unit_of
from continuum_grasp.export.fmu.variable import Count, Group, Kind, Unit, Variable
from continuum_grasp.export.part import Code
from continuum_grasp.export.parts.seen import TOUCH, by_component
from continuum_grasp.export.template import fill

_CODES = (Code.OK, Code.ERR_NON_FINITE, Code.ERR_RANGE, Code.ERR_RESULT)
_TIP = (
    ("x", "m", "of the tip in the world"),
    ("y", "m", "of the tip in the world"),
    ("angle", "rad", "of the tip; its tangent is (-sin, cos) of it"),
)


def tip_variables() -> tuple[Variable, ...]:
    """Position and angle of the tip."""
    return tuple(Variable(f"tip.{name}", unit, text, "output") for name, unit, text in _TIP)


def contact_variables(touching: Sequence[str]) -> list[Variable]:
    """Gaps, forces and places of contacts by their names."""
    names = identifiers(touching)
    return [Variable(f"contact.{at}.{field}", unit, text, "output") for field, unit, text in TOUCH for at in names]


def labeled(group: str, kind: Kind, labels: Sequence[str], starts: Sequence[float] | np.ndarray) -> Group:
    """Variables of labels ``name [unit]``, with their values to begin with."""
    named = zip(identifiers(labels), labels, starts, strict=True)
    own = tuple(Variable(f"{group}.{name}", unit_of(label), "", kind, float(start)) for name, label, start in named)
    return Group(f"FMU_{group.upper()}", own)


def shown(tip: Any, angle: Any, touch: Mapping[str, Any]) -> Any:
    """What is seen of a plant: its tip, then its contacts by the outputs of ``System.touch``; all SX, or all MX."""
    return ca.vertcat(ca.vec(tip), angle, *by_component(touch).values())


def moved_unit(
    *,
    functions: Mapping[str, ca.Function],
    groups: Sequence[Group],
    touching: Sequence[str],
    results: Sequence[Group] = (),
    words: Mapping[str, Any],
    manifest: Mapping[str, Any],
    identifier: str,
    **of_unit: Any,
) -> Unit:
    """A plant that is moved by ``plant_step`` and seen by ``shown``, and where it is late by ``measured``.

    All are functions (x, u, w, p) of one column; ``groups`` are the inputs, the forces, the parameters, others that are
    given, and the state, ``touching`` the contacts by name, ``results`` what is behind them.
    """
    named = [
        ca.Function(f"{identifier}_{name}", f.mx_in(), f.call(f.mx_in()), list("xuwp"), ["to"])
        for name, f in functions.items()
    ]
    source, header = generated_c(f"{identifier}_plant", named)
    seen = (*tip_variables(), *contact_variables(touching))
    x, u, *_ = (functions["plant_step"].size1_in(k) for k in range(4))
    sizes = {
        "nx": x,
        "nu": u,
        "shown": len(seen),
        "given": max(4, *(f.sz_arg() for f in named)),
        "found": max(1, *(f.sz_res() for f in named)),
        "work": max(1, *(f.sz_w() for f in named)),
        "whole_work": max(1, *(f.sz_iw() for f in named)),
        "prompt": "measured" not in functions,
        "late": "measured" in functions,
    }
    texts = "".join(f'    case {identifier.upper()}_{c.name}: return "{c.text}";\n' for c in _CODES)
    codes = ", ".join(f"{identifier.upper()}_{c.name} = {int(c)}" for c in _CODES)
    small = fill("fmu/plant.h", {"p": identifier, "P": identifier.upper(), "codes": codes, "texts": texts})
    look = functions["shown"]
    return Unit(
        identifier=identifier,
        groups=(*groups, Group("FMU_TIP", seen), *results),
        counts=(Count("code", "of the last step: 0 done, below what was refused"),),
        continuous=True,
        linear=False,
        feedthrough=any(look.jac_sparsity(0, k).nnz() for k in (1, 2)),
        glue=("moved_types.c", "moved.c", *(["late.c"] if sizes["late"] else [])),
        words={**sizes, **words},
        sources={
            f"{identifier}.h": small,
            f"{identifier}_plant.h": header,
            f"{identifier}_plant.c": source,
        },
        flags=("-std=c99",),
        manifest={"configuration_hash": hashlib.sha256(source.encode()).hexdigest()[:16], **manifest},
        **of_unit,
    )
