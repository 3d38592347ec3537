"""The parameters that are to be estimated, and what of the model each of them sets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple, cast

import numpy as np

from continuum_grasp.addons.identification.scene import Estimate
from continuum_grasp.base import Array, InputError, nearest, split_unit
from continuum_grasp.model import FingerModel, Parameters
from continuum_grasp.scene import Consumer, Scene

LAG, DELAY = "drive_time_constant", "drive_delay"
"""Time constant of the lag of the drives, and the time before a command reaches them."""
ADDED = {"clamp_angle": "base_angle", "base_x": "base_position_x", "base_y": "base_position_y"}
"""Parameters of the model to whose values in the scene unknowns are added, by the names of these."""
ALONG = "along"
"""Target of the part of a vector across the finger that goes along a direction of ``DIRECTIONS``."""
DIRECTIONS = (0, 90)
"""Directions along which vectors across the finger have their parts [deg]."""
START = "start"
"""Target of coordinates and rates of a start that is estimated with the parameters."""
_OWN = {"youngs_modulus": "Pa", "clamp_angle": "rad", "base_x": "m", "base_y": "m", DELAY: "s"}
"""Unit of each unknown that the model does not have."""


_DRIVES = Consumer.refusals(
    f"""
    name={DELAY} without tendons: needs finger.tendons
    name={LAG} without tendons chambers: needs tendons or pressure
    """
)
_ESTIMATES = Consumer.refusals(
    """
    name=youngs_modulus with mixed:
        needs a rod whose whole stiffness follows from rod.youngs_modulus; or estimate bending_stiffness, a factor
    name=youngs_modulus without graded youngs_modulus:
        needs a rod that is given by its shape; or estimate bending_stiffness
    name=rest_curvature with own_rest_curvature:
        state the rest_curvature of the finger, not that of its rod, to estimate it
    """,
    mixed=lambda rod: rod.graded and not rod.one_modulus,
)


class Unknown(NamedTuple):
    """A parameter to estimate, between bounds."""

    name: str
    unit: str
    target: str
    """Run-time parameter of the model that it sets; or ``DELAY``, or ``START``, which the model does not have."""
    factor: float = 1.0
    """The run-time parameter is factor * value."""
    added: bool = False
    """Whether it is added to the scene's value rather than put in its place."""
    start: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    typical: float = 1.0
    """A typical size, against which it is judged whether the data see the parameter."""
    per: Literal["all", "set", "plane"] = "all"
    """Whether each set of data has a value of its own, or adds its part of a vector across the finger."""
    sigma: float = math.inf
    """Standard deviation about ``start`` with which it is known before anything is measured."""


def read_unknowns(scene: Scene, estimates: Sequence[Estimate | str]) -> list[Unknown]:
    """Parameters to estimate, with bounds and sizes; start values come from the scene.

    InputError if there is none, one is unknown or given twice, or a start value is missing or out of bounds.
    """
    chosen = [Estimate(name=estimate) if isinstance(estimate, str) else estimate for estimate in estimates]
    if not chosen:
        raise InputError("expected names of parameters to estimate; to estimate nothing, use compare", key="estimate")
    unknowns = [_unknown(scene, estimate, f"estimate[{k}]") for k, estimate in enumerate(chosen)]
    targets = [unknown.target for unknown in unknowns]
    for k, unknown in enumerate(unknowns):
        if unknown.target in targets[:k]:
            other = unknowns[targets.index(unknown.target)].name
            raise InputError(
                f"{unknown.name} and {other} set the same parameter of the model", key=f"estimate[{k}].name"
            )
    return unknowns


def _unknown(scene: Scene, asked: Estimate, key: str) -> Unknown:
    name = asked.name
    finger = scene.finger
    rod = scene.finger.rod
    for feature in _DRIVES:
        feature.check(finger, key, asked)
    for feature in _ESTIMATES:
        feature.check(rod, key, asked)
    target = name
    factor = 1.0
    nominal = 0.0
    unit = _OWN.get(name, "")
    if name == "youngs_modulus":
        target = "bending_stiffness"
        nominal = cast(float, rod.youngs_modulus)
        factor = (1.0 if rod.graded else rod.stiffness) / nominal
    elif name in ADDED:
        target = ADDED[name]
    elif name == LAG and not finger.winches:
        lags = [of.time_constant for of in finger.tendon_list] + [of.time_constant for of in finger.chambers]
        nominal = max(lag or 0.0 for lag in lags)
        unit = "s"
    elif name != DELAY:
        nominal, unit = _of_model(scene, name, key)
    typical = _typical(scene, name) if nominal == 0.0 else abs(nominal)
    lower, upper = asked.min, asked.max
    if lower is None:
        lower = _least(scene, name, target) * typical
    if upper is None:
        upper = math.inf
    # a scene's value beside the bounds starts on them; a start that is asked for must be inside
    start = asked.start if asked.start is not None else min(max(nominal, lower), upper)
    if name == LAG and start <= lower and asked.start is None:
        raise InputError(f"{LAG} needs a start value, or tendons with a time_constant", key=f"{key}.start")
    if not lower <= start <= upper:
        raise InputError(f"{start:g} is outside {lower:g} to {upper:g}", key=f"{key}.start")
    typical = max(typical, abs(start)) if nominal == 0.0 else typical
    sigma = math.inf if asked.sigma is None else asked.sigma
    return Unknown(name, unit, target, factor, name in ADDED, start, lower, upper, typical, asked.per, sigma)


def _least(scene: Scene, name: str, target: str) -> float:
    """Least value of an unknown, per typical size."""
    if name in ADDED:
        return -math.inf
    return 0.0 if name == DELAY else Parameters.numbers_of(scene.finger)[target].least


def prior(unknowns: Sequence[Unknown], values: Array) -> tuple[Array, Array]:
    """Distance of values (n,) from their prior (k,), per deviation, and its derivatives (k, n)."""
    known = [k for k, unknown in enumerate(unknowns) if math.isfinite(unknown.sigma)]
    rows = np.zeros((len(known), len(unknowns)))
    for row, k in zip(rows, known, strict=True):
        row[k] = 1.0 / unknowns[k].sigma
    return rows @ (values - np.array([unknown.start for unknown in unknowns])), rows


def _of_model(scene: Scene, name: str, key: str) -> tuple[float, str]:
    """Nominal value and unit of a run-time parameter of the model."""
    try:
        model = FingerModel(scene, parameters=(name,), input_rates=False)
    except InputError as error:
        hint = nearest(name, _OWN, say_all=False) if "did you mean" not in error.message else ""
        raise InputError(f"{error.message}{hint}", key=f"{key}.name") from None
    if model.np != 1:
        raise InputError(f"{name} has {model.np} entries; only single numbers can be estimated", key=f"{key}.name")
    return float(model.p_nominal[0]), split_unit(model.p_names[0]).unit


def _typical(scene: Scene, name: str) -> float:
    """Size of a parameter whose nominal value is zero."""
    rod = scene.finger.rod
    length, stiffness, mass = rod.length, rod.stiffness, rod.mass_per_length
    # time scale of bending; the first pulsation of a clamped rod is 3.5 over it
    slow = length**2 * math.sqrt(mass / stiffness)
    sizes = {
        "base_angle": 0.1,
        "clamp_angle": 0.1,
        "base_x": length,
        "base_y": length,
        "rest_curvature": 0.1 / length,
        "material_damping": 0.02 * stiffness * slow,
        "per_arc_damping": 0.02 * stiffness / length * slow,
        "quadratic_damping": 0.02 * stiffness * slow**2 * length,
        "rotary_inertia": 1e-4 * mass * length**2,
        "tendon_friction": 0.1,
        "tip_body_inertia": 0.01 * mass * length**3,
        "tip_body_across": 0.1 * length,
        "tip_body_along": 0.1 * length,
        LAG: 0.02,
        DELAY: 0.02,
        "drive_pretension": 1.0,
        "drive_slack": 1e-3,
        "drive_viscous_friction": 1e-3,
        "drive_coulomb_friction": 1e-3,
    }
    return sizes.get(name, 0.1 * mass * length)  # point masses: a tenth of the finger's
