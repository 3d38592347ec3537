"""What is shown of a result beyond its own numbers, for text, files, pictures and pages alike."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from continuum_grasp.grasp.certificate.certificate import Certificate
    from continuum_grasp.grasp.quality.quality import Quality
    from continuum_grasp.grasp.result import GraspResult


def quality_of(result: GraspResult) -> Quality | None:
    """The indices of a verified grasp; None where there is none."""
    return result.quality if result.solved else None


def resisted_forces(result: GraspResult) -> NDArray[Any] | None:
    """The greatest force that a grasp resists in each direction around the circle, on top of the weight.

    Parameters
    ----------
    result : GraspResult

    Returns
    -------
    ndarray, shape (D, 2), or None
        In the world's axes, from +X counter-clockwise [N]; None where there is no verified grasp.
    """
    quality = quality_of(result)
    return None if quality is None else quality.resistance_polygon


def quality_rows(result: GraspResult) -> list[tuple[str, str, str]]:
    """Indices of quality as (name, value with unit, description); none where there is no grasp."""
    quality = quality_of(result)
    return [
        (name.replace("_", " "), _short(value) + ("" if unit == "1" else f" {unit}"), description)
        for name, value, unit, description in (() if quality is None else quality.rows())
    ]


def further_advice(result: GraspResult) -> str:
    """The advice without the repairs, where these are shown beside their reasons."""
    repairs = "Any one of these repairs it: " + "; ".join(reason.repair for reason in result.reasons) + "."
    return result.advice.removeprefix(repairs).strip() if result.reasons else result.advice


def disturbance_rows(result: GraspResult) -> list[tuple[str, str, str]]:
    """The scene's disturbances as (force and moment, multiple that is resisted, what stops it then)."""
    quality = quality_of(result)
    if quality is None:
        return []
    held = quality.resistance
    rows = []
    for (x, y, moment), factor, limiting in zip(held.wrenches, held.factors, held.limiting, strict=True):
        what = f"{x:.3g} N, {y:.3g} N, {moment:.3g} N m"
        rows.append((what, "no limit" if np.isinf(factor) else _short(factor), ", ".join(limiting)))
    return rows


def _short(value: float) -> str:
    """Four digits; what is nothing but rounding is 0."""
    return "0" if abs(value) < 1e-6 else f"{value:.4g}"


def result_data(result: GraspResult, *, quality: bool = True) -> dict[str, Any]:
    """What a person wants to read of a result, as plain data; SI units, which the names carry.

    ``quality=False`` leaves out the indices of quality, which cost more than the rest.
    """
    found: dict[str, Any] = {
        "name": result.scene.name,
        "status": result.status.value,
        "message": result.message,
        "warnings": list(result.warnings),
        "advice": result.advice,
    }
    if result.reasons:
        found["reasons"] = [asdict(reason) for reason in result.reasons]
    if result.violated:
        found["broken_constraints_at_the_closest_point"] = list(result.violated)
    if result.arrays:
        what = "grasp" if result.solved else "closest_point"
        found[what] = {
            "tension_N": result.tension,
            "object": _pose(result.object_pose),
            "fingers": {name: _finger(result, name) for name in result.fingers},
            "contacts": [_contact(contact) for contact in result.contacts],
        }
    held = quality_of(result) if quality else None
    if held is not None:
        found["quality"] = held.data()
    fine = {key: value for key, value in result.statistics.items() if key.startswith("fine") and value is not None}
    found.update(fine)
    if result.solved and result.certificate is not None:
        found["certificate"] = _summary(result.certificate)
    return found


def fine_rows(result: GraspResult) -> list[tuple[str, str]]:
    """What the statistics say about the grasp in a fine model, as (name, value)."""
    found = []
    for key, value in result.statistics.items():
        if key.startswith("fine") and value is not None:
            parts = value.items() if isinstance(value, Mapping) else [("", value)]
            found += [(" ".join(part for part in (key, name) if part).replace("_", " "), v) for name, v in parts]
    return [(name, _short(v) if isinstance(v, float) else str(v)) for name, v in found]


def _pose(pose: NDArray[Any]) -> dict[str, float]:
    return {"x_m": float(pose[0]), "y_m": float(pose[1]), "angle_rad": float(pose[2])}


def _finger(result: GraspResult, name: str) -> dict[str, Any]:
    finger, tendons = result.fingers[name], result.scene.named_fingers[name].tendons
    return {
        "tension_left_N": float(finger.tensions[0]),
        "tension_right_N": float(finger.tensions[1]),
        "tension_max_N": None if tendons is None else tendons.max_tension,
        "base": _pose(finger.base),
        "tip": _pose(finger.backbone[-1, 1:4]),
        "family": finger.family,
        "element_lengths_m": [float(v) for v in finger.lengths],
    }


def _contact(contact: Any) -> dict[str, Any]:
    found = {
        "name": contact.name,
        "x_m": float(contact.position[0]),
        "y_m": float(contact.position[1]),
        "normal": [float(v) for v in contact.normal],
        "normal_force_N": contact.normal_force,
        "friction_force_N": contact.friction_force,
        "lift_N": contact.lift,
        "friction_margin": contact.friction_margin,
    }
    return {**found, "position_along_finger_m": contact.station} if np.isfinite(contact.station) else found


def _summary(certificate: Certificate) -> dict[str, Any]:
    stability = certificate.stability
    return {
        "passed": certificate.passed,
        "checks": len(certificate.checks),
        "failed": [check.name for check in certificate.failed],
        "friction_margin": certificate.friction_margin,
        "stable": stability.stable,
        "stability_eigenvalue": stability.eigenvalue,
        "model_error_m": certificate.model_error.greatest,
        "overlap_of_fingers_m": certificate.overlap,
    }
