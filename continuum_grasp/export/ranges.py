"""Ranges of the numbers that a package takes, and sizes of usual ones for its test vectors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

from continuum_grasp.errors import InputError
from continuum_grasp.export.descriptions import describe
from continuum_grasp.export.fields import Field, fields_of
from continuum_grasp.model import FingerModel

__all__ = ["force_fields", "input_fields", "parameter_fields", "state_fields"]

_USUAL_RATE = 10.0
"""Bending ranges per second of usual motions."""
_SPREAD = 2.0
"""Factor up and down from its nominal value that a parameter may take by default."""

_SIGNED = ("base_angle", "gravity", "rest_curvature")
"""Parameters that may be below zero."""


def parameter_fields(model: FingerModel, given: Mapping[str, Sequence[float]]) -> tuple[Field, ...]:
    """Entries of the parameters.

    Parameters
    ----------
    model : FingerModel
    given : mapping
        Ranges by the name of an entry, least and greatest.

    Raises
    ------
    InputError
        If a range is none, goes below zero where the parameter cannot, leaves out the nominal value, is for no
        parameter, or is missing where the nominal value of zero tells nothing.
    """
    found = []
    for field, nominal in zip(_fields(model, model.p_names), model.p_nominal, strict=True):
        low, high = _given(field.name, given[field.name]) if field.name in given else _usual(field.name, nominal, model)
        if low < 0.0 and not field.name.startswith(_SIGNED):
            raise InputError(f"it cannot be below zero, got a range from {low:g}", key=f"ranges.{field.name}")
        if not low <= nominal <= high:
            message = f"range {low:g} to {high:g} leaves out the nominal value {nominal:g} {field.unit}"
            raise InputError(message, key=f"ranges.{field.name}")
        found.append(field.within(low, high, max(abs(low), abs(high))))
    unknown = sorted(set(given) - {field.name for field in found})
    if unknown:
        names = ", ".join(field.name for field in found) or "none"
        raise InputError(f"{unknown[0]!r} is no run-time parameter of this model (it has {names})", key="ranges")
    return tuple(found)


def state_fields(model: FingerModel, parameters: Sequence[Field]) -> tuple[Field, ...]:
    """Entries of the state: bends within the declared range, rates of any size."""
    reach = _reach(model, parameters)
    stiffness = _greatest(parameters, "bending_stiffness", model.finger.rod.stiffness)
    usual_moment = stiffness * max(model.ranges) / model.finger.rod.length
    found = []
    for k, field in enumerate(_fields(model, model.x_names)):
        if k < model.n:
            found.append(field.within(-reach[k], reach[k], reach[k]))
        elif k < 2 * model.n:
            found.append(field.within(-math.inf, math.inf, _USUAL_RATE * reach[k - model.n]))
        else:
            found.append(field.within(-math.inf, math.inf, usual_moment * (1.0 if k == 2 * model.n else _USUAL_RATE)))
    return tuple(found)


def input_fields(model: FingerModel) -> tuple[Field, ...]:
    """Entries of the input: tensions from zero on, up to the greatest where the finger has one."""
    tendons = model.finger.tendons
    usual_moment = model.finger.rod.stiffness * max(model.ranges) / model.finger.rod.length
    found = []
    for field in _fields(model, model.u_names):
        if field.name in ("tension_1", "tension_2") and tendons is not None:
            high = math.inf if tendons.max_tension is None else tendons.max_tension
            usual = usual_moment / tendons.offset
            found.append(field.within(0.0, high, min(high, usual)))
        else:
            found.append(field.within(-math.inf, math.inf, usual_moment))
    return tuple(found)


def force_fields(model: FingerModel) -> tuple[Field, ...]:
    """Entries of the forces, of any size."""
    rod = model.finger.rod
    usual = {"N": rod.stiffness / rod.length**2, "N m": rod.stiffness / rod.length}
    return tuple(field.within(-math.inf, math.inf, usual[field.unit]) for field in _fields(model, model.w_names))


def _fields(model: FingerModel, labels: Sequence[str]) -> list[Field]:
    return [replace(field, text=describe(model, field.name)) for field in fields_of(labels)]


def _reach(model: FingerModel, parameters: Sequence[Field]) -> list[float]:
    """Greatest absolute value of each coordinate within the declared bending ranges."""
    if model.family == "arc":
        return list(model.ranges)
    lengths = [_greatest(parameters, f"element_lengths_{k + 1}", h) for k, h in enumerate(model.lengths)]
    if len(lengths) == 1:
        lengths = [_greatest(parameters, "element_lengths", lengths[0])]
    per_element = [reach / h for reach, h in zip(model.ranges, lengths, strict=True)]
    nodes = [per_element[0], *(min(pair) for pair in pairwise(per_element)), per_element[-1]]
    return nodes[: model.n]


def _greatest(parameters: Sequence[Field], name: str, value: float) -> float:
    return next((field.high for field in parameters if field.name == name), value)


def _given(name: str, pair: Sequence[float]) -> tuple[float, float]:
    low, high = (float(v) for v in pair) if len(pair) == 2 else (math.nan, math.nan)
    if not -math.inf < low <= high < math.inf:
        raise InputError(f"expected a least and a greatest value, got {tuple(pair)!r:.60}", key=f"ranges.{name}")
    return low, high


def _usual(name: str, nominal: float, model: FingerModel) -> tuple[float, float]:
    if name == "base_angle":
        return -2.0 * math.pi, 2.0 * math.pi
    if name.startswith("gravity"):
        return -max(20.0, 2.0 * abs(nominal)), max(20.0, 2.0 * abs(nominal))
    if name == "tendon_friction":
        return 0.0, max(0.5, _SPREAD * nominal)
    if "mass" in name:
        return 0.0, max(_SPREAD * nominal, model.finger.rod.mass_per_length * model.finger.rod.length)
    if name == "rest_curvature":
        most = max(_SPREAD * abs(nominal), 0.5 * min(model.ranges) / max(model.lengths))
        return -most, most
    if nominal <= 0.0:
        raise InputError("its nominal value is zero: give its least and greatest value", key=f"ranges.{name}")
    return nominal / _SPREAD, _SPREAD * nominal
