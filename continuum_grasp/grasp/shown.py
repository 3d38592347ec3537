"""What is shown of a result beyond its own numbers, for text, files, pictures and pages alike."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from continuum_grasp.grasp.certificate import Certificate
    from continuum_grasp.grasp.result import GraspResult

__all__ = ["certificate_data", "quality_rows", "resisted_forces", "result_data"]

DIRECTIONS = 72
"""Of the disturbance polygon."""


def resisted_forces(result: GraspResult, directions: int = DIRECTIONS) -> NDArray[Any] | None:
    """The greatest force that a grasp resists in each direction around the circle, on top of the weight.

    Parameters
    ----------
    result : GraspResult
    directions : int, optional

    Returns
    -------
    ndarray, shape (directions, 2), or None
        In the world's axes, from +X counter-clockwise [N]; None where there is no verified grasp.
    """
    if not result.solved:
        return None
    from continuum_grasp.grasp.resistance import resistance_polygon

    return np.asarray(resistance_polygon(result.scene, result.arrays, directions))


def certificate_data(certificate: Certificate) -> dict[str, Any]:
    """A certificate as plain data."""
    error, quality = certificate.model_error, getattr(certificate, "quality", None)
    return {
        "passed": certificate.passed,
        "checks": [{**asdict(check), "passed": check.passed} for check in certificate.checks],
        "friction_margin": certificate.friction_margin,
        "model_error": {**asdict(error), "found": error.found, "small": error.small, "limit": error.limit},
        "stability": asdict(certificate.stability),
        "quality": None if quality is None else quality.data(),
    }


def quality_rows(certificate: Certificate) -> list[tuple[str, str, str]]:
    """Indices of quality as (name, value with unit, what it means); none where there is no certificate of them."""
    quality = getattr(certificate, "quality", None)
    if quality is None:
        return []
    return [(str(name), str(value), str(meaning)) for name, value, meaning in quality.rows()]


def result_data(result: GraspResult) -> dict[str, Any]:
    """What a person wants to read of a result, as plain data; SI units, which the names carry."""
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
    if result.solved and result.certificate is not None:
        found.update(_summary(result.certificate))
    return found


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
    quality, stability = getattr(certificate, "quality", None), certificate.stability
    found: dict[str, Any] = {} if quality is None else {"quality": quality.data()}
    found["certificate"] = {
        "passed": certificate.passed,
        "checks": len(certificate.checks),
        "failed": [check.name for check in certificate.failed],
        "friction_margin": certificate.friction_margin,
        "stable": stability.stable,
        "stability_eigenvalue": stability.eigenvalue,
        "model_error_m": certificate.model_error.greatest,
    }
    return found
