"""The parameters that are to be estimated, and what of the model each of them sets."""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import InputError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.families import default_family
from continuum_grasp.scene.identify import Estimate
from continuum_grasp.scene.simulate import Scene

Array = NDArray[np.float64]

DEADBAND = "tension_deadband"
"""Of the drive, not of the model: the difference of tensions that friction takes before the finger feels any."""
_LEAST = 1e-9
"""Lower bound per typical size [1] of what must stay positive."""
_UNITS = {"youngs_modulus": "Pa", "clamp_angle": "rad", DEADBAND: "N"}


@dataclass(frozen=True)
class Unknown:
    """One parameter to estimate.

    Attributes
    ----------
    name, unit : str
    target : str
        Run-time parameter of the model that it sets, or ``tension_deadband``.
    factor : float
        The run-time parameter is factor * value.
    added : bool
        Whether it is added to the scene's value rather than put in its place.
    start, lower, upper : float
    typical : float
        A typical size, against which it is judged whether the data see the parameter.
    """

    name: str
    unit: str
    target: str
    factor: float
    added: bool
    start: float
    lower: float
    upper: float
    typical: float


def read_unknowns(scene: Scene, estimates: Sequence[Estimate | str]) -> list[Unknown]:
    """What is to be estimated, with bounds and sizes.

    Parameters
    ----------
    scene : Scene
        Where start values come from.
    estimates : sequence of Estimate or str

    Raises
    ------
    InputError
        If there is none, one is unknown or given twice, or a start value is missing or out of bounds.
    """
    if isinstance(estimates, str):
        raise InputError(f"expected a list of names, got {estimates!r:.60}", key="estimate")
    chosen = [Estimate(name=one) if isinstance(one, str) else one for one in estimates]
    for k, asked in enumerate(chosen):
        if not isinstance(asked, Estimate):
            raise InputError(f"expected a name or an Estimate, got {asked!r:.60}", key=f"estimate[{k}]")
    if not chosen:
        raise InputError("expected the names of the parameters to estimate", key="estimate")
    found = [_unknown(scene, one, f"estimate[{k}]") for k, one in enumerate(chosen)]
    targets = [one.target for one in found]
    for k, one in enumerate(found):
        if one.target in targets[:k]:
            other = found[targets.index(one.target)].name
            raise InputError(f"{one.name} and {other} set the same parameter of the model", key=f"estimate[{k}].name")
    return found


def _unknown(scene: Scene, asked: Estimate, key: str) -> Unknown:
    name, finger, rod = asked.name, scene.finger, scene.finger.rod
    factor, added, unit = 1.0, False, _UNITS.get(name, "")
    if name == "youngs_modulus":
        target, factor = "bending_stiffness", _second_moment(scene, asked, key)
        nominal = rod.stiffness / factor
    elif name == "clamp_angle":
        target, added, nominal = "base_angle", True, 0.0
    elif name == DEADBAND:
        if finger.tendons is None:
            raise InputError(f"{DEADBAND} needs finger.tendons", key=f"{key}.name")
        target, nominal = DEADBAND, 0.0
    else:
        target = name
        nominal, unit = _of_model(scene, name, key)
    typical = _typical(scene, name) if nominal == 0.0 else abs(nominal)
    lower, upper = _bounds(name, typical)
    lower = asked.min if asked.min is not None else lower
    upper = asked.max if asked.max is not None else upper
    start = asked.start if asked.start is not None else nominal
    if asked.start is None:
        start = min(max(start, lower), upper)
    if not lower <= start <= upper:
        raise InputError(f"{start:g} is outside {lower:g} to {upper:g}", key=f"{key}.start")
    typical = max(typical, abs(start)) if nominal == 0.0 else typical
    return Unknown(name, unit, target, factor, added, start, lower, upper, typical)


def _second_moment(scene: Scene, asked: Estimate, key: str) -> float:
    rod = scene.finger.rod
    if rod.youngs_modulus is not None:
        if asked.second_moment is not None:
            raise InputError("the rod's section gives it already", key=f"{key}.second_moment")
        return rod.stiffness / rod.youngs_modulus
    if asked.second_moment is None:
        raise InputError(
            "youngs_modulus needs a rod with a diameter, or second_moment [m4]; or estimate bending_stiffness",
            key=f"{key}.name",
        )
    return asked.second_moment


def _of_model(scene: Scene, name: str, key: str) -> tuple[float, str]:
    """Nominal value and unit of a run-time parameter of the model."""
    try:
        stated = name != "tendon_friction" or scene.fidelity.family is not None
        family = None if stated else default_family(free_tip=True)
        model = FingerModel(scene, parameters=(name,), input_rates=False, family=family)
    except InputError as error:
        near = difflib.get_close_matches(name, ("youngs_modulus", "clamp_angle", DEADBAND), n=1)
        hint = f"; did you mean {near[0]}?" if near and "did you mean" not in error.message else ""
        raise InputError(f"{error.message}{hint}", key=f"{key}.name") from None
    if model.np != 1:
        raise InputError(f"{name} has {model.np} entries; only single numbers can be estimated", key=f"{key}.name")
    return float(model.p_nominal[0]), model.p_names[0].partition("[")[2].rstrip("]")


def _typical(scene: Scene, name: str) -> float:
    """Size of a parameter whose nominal value is zero."""
    rod = scene.finger.rod
    length, stiffness, mass = rod.length, rod.stiffness, rod.mass_per_length
    slow = length**2 * math.sqrt(mass / stiffness)
    sizes = {
        "base_angle": 0.1,
        "clamp_angle": 0.1,
        "rest_curvature": 0.1 / length,
        "material_damping": 0.02 * stiffness * slow,
        "per_arc_damping": 0.02 * stiffness / length * slow,
        "rotary_inertia": 1e-4 * mass * length**2,
        "tendon_friction": 0.1,
        DEADBAND: 1.0,
    }
    return sizes.get(name, 0.1 * mass * length)


def _bounds(name: str, typical: float) -> tuple[float, float]:
    if name in ("rest_curvature", "clamp_angle", "base_angle"):
        return -math.inf, math.inf
    if name in ("youngs_modulus", "bending_stiffness", "linear_density", "tendon_offset"):
        return _LEAST * typical, math.inf
    return 0.0, math.inf
