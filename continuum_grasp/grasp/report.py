"""A grasp result as text and as meta data."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from continuum_grasp.grasp.certificate import Certificate
from continuum_grasp.grasp.model_error import ModelError

if TYPE_CHECKING:
    from continuum_grasp.grasp.result import GraspResult

__all__ = ["result_meta", "result_text"]


def result_text(result: GraspResult) -> str:
    """The result as aligned text, for people."""
    lines = [f"{result.status.value}: {result.message}"]
    if result.solved:
        lines += ["", *_grasp_lines(result), "", *_contact_lines(result)]
    if result.certificate is not None and result.solved:
        lines += ["", *_certificate_lines(result.certificate)]
    if result.reasons:
        lines += ["", "Why there is no grasp:", *(f"  {r.text} ({r.key})" for r in result.reasons)]
    if result.violated:
        lines += ["", "Broken constraints at the closest point:", *(f"  {text}" for text in result.violated)]
    if result.advice:
        lines += ["", result.advice]
    return "\n".join(lines)


def result_meta(result: GraspResult) -> dict[str, Any]:
    """Everything about the result that is not an array."""
    return {
        "kind": "grasp",
        "config": result.scene.model_dump(mode="json"),
        "seed": result.scene.solver.random_seed,
        "status": result.status.value,
        "message": result.message,
        "warnings": list(result.warnings),
        "certificate": None if result.certificate is None else _certificate_data(result.certificate),
        "violated": list(result.violated),
        "reasons": [asdict(reason) for reason in result.reasons],
        "advice": result.advice,
        "statistics": dict(result.statistics),
    }


def _grasp_lines(result: GraspResult) -> list[str]:
    tendons = result.scene.finger.tendons
    limit = "" if tendons is None else f" of {tendons.max_tension:g} N"
    first, second = result.tensions
    length = 1e3 * result.scene.finger.rod.length
    bends = ", ".join(f"{1e3 * h:.1f}" for h in result.lengths)
    return [
        f"  tendon tensions   {first:8.3f} N, {second:.3f} N{limit}",
        f"  middle contact at {1e3 * result.middle_position:8.2f} mm of {length:g} mm",
        f"  element lengths   {bends} mm ({result.arrays['family']})",
    ]


def _contact_lines(result: GraspResult) -> list[str]:
    lines = [
        "  contact      x [mm]    y [mm]  normal [N]  friction [N]  lift [N]  margin",
    ]
    for c in result.contacts:
        x, y = 1e3 * c.position
        margin = abs(c.friction_margin) if abs(c.friction_margin) < 5e-7 else c.friction_margin
        lines.append(
            f"  {c.name:<10}{x:9.2f} {y:9.2f} {c.normal_force:11.3f} {c.friction_force:13.3f}"
            f" {c.lift:9.3f} {margin:7.1%}"
        )
    return lines


def _certificate_lines(certificate: Certificate) -> list[str]:
    verdict = "all checks passed" if certificate.passed else f"{len(certificate.failed)} checks FAILED"
    lines = [f"Verified independently: {verdict}"]
    width = max(len(check.name) for check in certificate.checks)
    for check in certificate.checks:
        amount = "within" if check.value <= 0 else f"{check.value:.1e}"
        of = f" of {check.relative_to}" if check.relative_to else f" {check.unit}"
        mark = "ok" if check.passed else "FAILED"
        lines.append(f"  {check.name:<{width}}  {amount:>8}{of:<14} limit {check.limit:.0e}  {mark}")
    stability = certificate.stability
    word = "stable" if stability.stable else "UNSTABLE"
    lines += [
        f"  stability: {word}, least eigenvalue {stability.eigenvalue:.3g} E I / L",
        f"    ({stability.assumptions})",
        *_model_error_lines(certificate.model_error),
    ]
    return lines


def _model_error_lines(error: ModelError) -> list[str]:
    mark = "ok" if error.small else "WARNING: raise fidelity.elements"
    return [
        f"  model error: {error}; limit {1e3 * error.limit:.2g} mm  {mark}",
        f"    (its bending moment by {error.moment:.1%} of the greatest, and the tension perhaps by as much)",
    ]


def _certificate_data(certificate: Certificate) -> dict[str, Any]:
    error = certificate.model_error
    return {
        "passed": certificate.passed,
        "checks": [{**asdict(check), "passed": check.passed} for check in certificate.checks],
        "friction_margin": certificate.friction_margin,
        "model_error": {**asdict(error), "found": error.found, "small": error.small, "limit": error.limit},
        "stability": asdict(certificate.stability),
    }
