"""A scene with estimated values in it."""

from __future__ import annotations

import math
from typing import Any

from continuum_grasp.errors import InputError
from continuum_grasp.scene.finger import Finger, PointMass, Rod
from continuum_grasp.scene.simulate import Scene

__all__ = ["with_parameter"]


def with_parameter(scene: Scene, target: str, value: float) -> Scene:
    """The scene with one run-time parameter of the model at another value.

    Parameters
    ----------
    scene : Scene
    target : str
        Name of the parameter, as in ``FingerModel(..., parameters=...)``.
    value : float

    Raises
    ------
    InputError
        If no value of a scene is behind the parameter, or the scene does not take this one.
    """
    finger = scene.finger
    changes: dict[str, Any]
    if target in ("bending_stiffness", "linear_density", "rotary_inertia"):
        changes = {"rod": _rod(finger.rod, target, value)}
    elif target in ("material_damping", "per_arc_damping"):
        key = target.removesuffix("_damping")
        changes = {"damping": finger.damping.model_copy(update={key: value})}
    elif target == "rest_curvature":
        changes = {"rest_curvature": value}
    elif target == "base_angle":
        changes = {"base": finger.base.model_copy(update={"angle": value})}
    elif target in ("tendon_offset", "tendon_friction") and finger.tendons is not None:
        changes = {"tendons": finger.tendons.model_copy(update={target.removeprefix("tendon_"): value})}
    elif target == "tip_mass" or target.startswith("mass_"):
        changes = {"masses": _masses(finger, target, value)}
    else:
        raise InputError(f"no value of a scene is behind {target}")
    parts = {name: getattr(finger, name) for name in finger.model_fields_set | changes.keys()}
    return scene.model_copy(update={"finger": Finger(**{**parts, **changes})})


def _rod(rod: Rod, target: str, value: float) -> Rod:
    """The rod in its own terms: by section, or by linear density and bending stiffness."""
    given = {name: getattr(rod, name) for name in rod.model_fields_set}
    if target == "rotary_inertia":
        return Rod(**{**given, "rotary_inertia": value})
    if rod.youngs_modulus is None or rod.density is None:
        return Rod(**{**given, target: value})
    if target == "bending_stiffness":
        return Rod(**{**given, "youngs_modulus": value * rod.youngs_modulus / rod.stiffness})
    unchanged = {"rotary_inertia": rod.inertia_per_length}  # in the model it stays while the linear density changes
    return Rod(**{**given, **unchanged, "density": value * rod.density / rod.mass_per_length})


def _masses(finger: Finger, target: str, value: float) -> tuple[PointMass, ...]:
    length, masses = finger.rod.length, list(finger.masses)
    if target == "tip_mass":
        others = [mass for mass in masses if not math.isclose(mass.at, length, rel_tol=1e-9)]
        return (*others, PointMass(at=length, mass=value))
    k = int(target.removeprefix("mass_"))
    masses[k] = PointMass(at=masses[k].at, mass=value)
    return tuple(masses)
