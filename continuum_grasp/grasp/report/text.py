"""A grasp result as text, for people and as YAML, and the rows that the page shows too."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.results.yaml_text import yaml_text
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity

if TYPE_CHECKING:
    from continuum_grasp.grasp.certificate.certificate import Certificate
    from continuum_grasp.grasp.certificate.check import Check
    from continuum_grasp.grasp.certificate.drives import DriveState
    from continuum_grasp.grasp.result import GraspResult
    from continuum_grasp.grasp.values import Contact, FingerPosture
    from continuum_grasp.scene.grasp import FingerSetup

_HEAD = """\
# How the object is held, or why it is not. World frame, SI units. Forces at contacts are those on what touches the
# object: along its outward normal, and friction along the normal turned by +90 degrees; lift is on the object, out of
# the plane. result.npz holds all numbers, meta.json the configuration and every check.
"""

_ROUNDING = 1e-6
"""Indices below this are nothing but rounding [1]."""


def result_text(result: GraspResult) -> str:
    """The result as aligned text, for people."""
    lines = [f"{result.status.value}: {result.message}"]
    if result.solved:
        lines += ["", *_finger_lines(result), "", *_contact_lines(result)]
        if result.lower_bound is not None:
            lines += _wrapped(result.bound_words)
        lines += ["", *_wrapped(str(result.plants))]
        if result.certificate is not None:
            lines += [*_quality_lines(result), "", *_certificate_lines(result.certificate)]
        lines += [f"  {name}: {value}" for name, value in fine_rows(result)]
    else:
        lines += _why_lines(result)
    lines += _robust_lines(result)
    advice = further_advice(result)
    if advice:
        lines += ["", *textwrap.wrap(advice, 112)]
    return "\n".join(lines)


def _finger_lines(result: GraspResult) -> list[str]:
    lines, width = [], max(len(setup.name) for setup in result.scene.setups)
    if result.scene.object.free is not None:
        x, y, angle = result.object_pose
        lines.append(f"  object at ({1e3 * x:.2f}, {1e3 * y:.2f}) mm, turned by {angle:.4f} rad")
    for setup in result.scene.setups:
        name, finger, posture = setup.name, setup.finger, result.fingers[setup.name]
        most = setup.max_tension
        left, right = (result.force_text(tension) for tension in posture.tensions)
        lines.append(f"  {name:<{width}}  tendons  left {left} N, right {right} N of {most:g} N")
        pad = " " * (width + 4)
        lines += [f"{pad}{text}" for text in drive_lines(result, name)]
        if finger.base_free is not None:
            x, y, angle = posture.base
            lines.append(f"{pad}base at ({1e3 * x:.2f}, {1e3 * y:.2f}) mm, angle {angle:.4f} rad")
        for contact in (c for c in result.contacts if c.name in setup.middle_names):
            what = contact.name.removeprefix(f"{name}.").replace("_", " ").replace("middle", "middle contact")
            lines.append(f"{pad}{what} at {1e3 * contact.station:.2f} mm of {1e3 * finger.rod.length:g} mm")
        elements = ", ".join(f"{1e3 * h:.1f}" for h in posture.lengths)
        lines.append(f"{pad}elements {elements} mm ({posture.family})")
    return lines


def drive_lines(result: GraspResult, finger: str) -> list[str]:
    """States of the drives of a finger, in words; none where its tensions are commanded."""
    lines = []
    for drive, taut in zip(result.drives.get(finger, ()), _taut(result, finger), strict=False):
        what = f"drive of {' and '.join(drive.tendons)}"
        if np.isnan(drive.torque):
            text = f"wound up by {1e3 * drive.position:.3f} mm"
        else:
            text = f"at {drive.position:.4f} rad, holds {1e3 * drive.torque:.4g} mN m, reached with "
            text += f"{1e3 * drive.torque_to_reach:.4g} mN m"
            text += "" if np.isnan(drive.current) else f", {drive.current:.4g} A"
        lines.append(f"{what} {text}{taut}")
    held = result.arrays.get(f"held.{finger}.tensions")
    if held is not None and np.ptp(held, axis=0).max() > 1e-3:
        ends = zip(("left", "right"), held.min(axis=0), held.max(axis=0), strict=True)
        parts = (f"{side} {result.force_text(low)} to {result.force_text(high)} N" for side, low, high in ends)
        lines.append(f"tensions by friction states: {', '.join(parts)}")
    return lines


def _taut(result: GraspResult, finger: str) -> list[str]:
    """Words for slack tendons of a finger, per drive."""
    slack = [side for side, pull in zip(("left", "right"), result.fingers[finger].tensions, strict=True) if pull < 1e-3]
    each = [[s for s in drive.tendons if s in slack] for drive in result.drives.get(finger, ())]
    return [f"; {' and '.join(own)} slack" if own else "" for own in each]


def _contact_lines(result: GraspResult) -> list[str]:
    lifted = isinstance(result.scene.gravity, OutOfPlaneGravity)
    width = max(len("contact"), *(len(c.name) for c in result.contacts)) if result.contacts else 7
    lift = f"{'lift [N]':>10}" if lifted else ""
    lines = [f"  {'contact':<{width}}    x [mm]    y [mm]  normal [N]  friction [N]{lift}  margin"]
    for c in result.contacts:
        x, y = (round(1e3 * v, 3) + 0.0 for v in c.position)  # no -0.0
        normal, friction, lift = (result.force_text(f) for f in (c.normal_force, c.friction_force, c.lift))
        words = f"{normal:>12}{friction:>14}{f'{lift:>10}' if lifted else ''}{result.margin_text(c):>8}"
        lines.append(f"  {c.name:<{width}}{x:10.2f}{y:10.2f}{words}")
    return lines


def _quality_lines(result: GraspResult) -> list[str]:
    held = "Disturbances (force x, y, moment), the multiple that is resisted, and what stops it"
    lines = []
    for title, rows in (("Quality", quality_rows(result)), (held, disturbance_rows(result))):
        lines += ["", title, *_aligned(rows, "<><")] if rows else []
    return lines


def _aligned(rows: Sequence[Sequence[str]], sides: str) -> list[str]:
    """Rows of a table, each column to its side, ``<`` or ``>``."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    formats = [f"{{:{side}{width}}}" for side, width in zip(sides, widths, strict=True)]
    return [f"  {'  '.join(f.format(cell) for f, cell in zip(formats, row, strict=True))}".rstrip() for row in rows]


def _certificate_lines(certificate: Certificate) -> list[str]:
    verdict = "all checks passed" if certificate.passed else f"{len(certificate.failed)} checks FAILED"
    lines = [f"Verified independently: {verdict}"]
    rows = [(a, b, c, f"limit {d}", e) for a, b, c, d, e in check_rows(certificate)]
    lines += _aligned(rows, "<><<<")
    lines += [f"  FAILED: {text}" for text in failed_checks(certificate)]
    stability, error, overlap = certificate.stability, certificate.model_error, certificate.overlap
    word = "stable" if stability.stable else "UNSTABLE"
    mark = "ok" if error.small else "WARNING: raise fidelity.elements"
    lines += [
        f"  stability: {word}, least eigenvalue {stability.eigenvalue:.3g} E I / L",
        *_wrapped(f"({stability.assumptions})"),
        f"  model error, limit {1e3 * error.limit:.2g} mm: {mark}",
        *_wrapped(str(error)),
        f"    (its bending moment by {error.moment:.1%} of the greatest, and the tension perhaps by as much)",
    ]
    if overlap > 0:
        lines.append(f"  fingers overlap by {1e3 * overlap:.2f} mm in the plane: they must lie at different heights")
    return lines


def check_rows(certificate: Certificate) -> list[tuple[str, str, str, str, str]]:
    """Per kind of check, whichever finger or contact it is of: name and count, worst value, of what, limit, verdict."""
    kinds: dict[str, list[Check]] = {}
    for check in certificate.checks:
        kinds.setdefault(check.name.partition(", ")[0], []).append(check)
    rows = []
    for name, checks in kinds.items():
        bad = [check for check in checks if not check.passed]
        worst = bad[0] if bad else max(checks, key=lambda check: check.value - check.limit)
        amount = "within" if worst.value <= 0 else f"{worst.value:.1e}"
        count = f" ({len(checks)})" if len(checks) > 1 else ""
        of = f"of {worst.relative_to}" if worst.relative_to else worst.unit.removeprefix("1")
        rows.append((name + count, amount, of, f"{worst.limit:.0e}", "FAILED" if bad else "ok"))
    return rows


def failed_checks(certificate: Certificate) -> list[str]:
    """The checks that did not pass, by how much."""
    return [f"{check.name}, {check.value:.2e}, limit {check.limit:.0e}" for check in certificate.failed]


def _robust_lines(result: GraspResult) -> list[str]:
    rows = robust_rows(result)
    if not rows:
        return []
    title, head = robust_head(result)
    return ["", title, *_aligned([head, *rows], "<<<")]


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, 108, initial_indent="    ", subsequent_indent="    ", break_on_hyphens=False)


def _why_lines(result: GraspResult) -> list[str]:
    lines = []
    if result.reasons:
        lines += ["", "Why there is no grasp; any one of these repairs it:"]
        for r in result.reasons:
            now = ((each.key, each.limit, "" if each.unit in ("", "1") else f" {each.unit}") for each in (r, *r.also))
            lines += [f"  {r.text}", f"    {r.repair}   ({'; '.join(f'{k}, now {v:.4g}{u}' for k, v, u in now)})"]
    if result.violated:
        lines += ["", "Broken constraints at the closest attempt:", *(f"  {text}" for text in result.violated)]
    if result.arrays:
        what = "The closest attempt, which is no grasp:"
        if result.robustness is not None:
            what = f"The grasp {result.robustness.names[1]}:"
        lines += ["", what, *_finger_lines(result), "", *_contact_lines(result)]
    return lines


def quality_rows(result: GraspResult) -> list[tuple[str, str, str]]:
    """Indices of quality as (name, value, description); none where there is no grasp."""
    rows = result.quality.rows() if result.solved else ()
    return [(name.replace("_", " "), _short(value), description) for name, value, description in rows]


def further_advice(result: GraspResult) -> str:
    """The advice without the repairs, where these are shown beside their reasons."""
    repairs = "Any one of these repairs it: " + "; ".join(reason.repair for reason in result.reasons) + "."
    return result.advice.removeprefix(repairs).strip() if result.reasons else result.advice


def disturbance_rows(result: GraspResult) -> list[tuple[str, str, str]]:
    """The scene's disturbances as (force and moment, multiple that is resisted, what stops it then)."""
    if not result.solved:
        return []
    held, rows = result.quality.resistance, []
    for (x, y, moment), factor, limiting in zip(held.wrenches, held.factors, held.limiting, strict=True):
        what = f"{x:.3g} N, {y:.3g} N, {moment:.3g} N m"
        rows.append((what, "no limit" if np.isinf(factor) else _short(factor), ", ".join(limiting)))
    return rows


def robust_head(result: GraspResult) -> tuple[str, tuple[str, str, str]]:
    """Title and head of the table of trials."""
    title, nominal, robust = ("", "", "") if result.robustness is None else result.robustness.names
    return title, ("", f"best {nominal}", robust)


def robust_rows(result: GraspResult) -> list[tuple[str, str, str]]:
    """The nominal grasp and that for all errors side by side, as (name, nominal, robust)."""
    return [] if result.robustness is None else result.robustness.rows()


def fine_rows(result: GraspResult) -> list[tuple[str, str]]:
    """Statistics about the grasp in a fine model, as (name, value)."""
    found = []
    for key, value in result.statistics.items():
        if key.startswith("fine") and value is not None:
            parts = value.items() if isinstance(value, Mapping) else [("", value)]
            found += [(" ".join(part for part in (key, name) if part).replace("_", " "), v) for name, v in parts]
    return [(name, _short(v) if isinstance(v, float) else str(v)) for name, v in found]


def _short(value: float) -> str:
    return "0" if abs(value) < _ROUNDING else f"{value:.4g}"


def result_yaml(result: GraspResult, *, quality: bool = True) -> str:
    """Summary of a result as YAML; SI units, which the names carry.

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
        found["broken_constraints_at_the_closest_attempt"] = list(result.violated)
    if result.arrays:
        found["grasp" if result.solved else "closest_attempt"] = {
            "tension_N": result.tension,
            "object": _pose(result.object_pose),
            "fingers": {
                setup.name: _finger(setup, result.fingers[setup.name])
                | ({"drives": [_drive(d) for d in result.drives[setup.name]]} if setup.name in result.drives else {})
                for setup in result.scene.setups
            },
            "contacts": [_contact(contact) for contact in result.contacts],
        }
    if quality and result.plants is not None:
        found["quality"] = result.quality.data()
        found["plants"] = result.plants.data()
    if result.robustness is not None:
        found["robustness"] = result.robustness.data()
    found |= {key: value for key, value in result.statistics.items() if key.startswith("fine") and value is not None}
    certificate = result.certificate
    if result.solved and certificate is not None:
        found["certificate"] = {
            "passed": certificate.passed,
            "checks": len(certificate.checks),
            "failed": [check.name for check in certificate.failed],
            "friction_margin": certificate.friction_margin,
            "stable": certificate.stability.stable,
            "stability_eigenvalue": certificate.stability.eigenvalue,
            "model_error_m": certificate.model_error.greatest,
            "overlap_of_fingers_m": certificate.overlap,
        }
        if certificate.states:
            found["certificate"]["friction_states"] = certificate.states
    return _HEAD + yaml_text(found)


def _pose(pose: NDArray[Any]) -> dict[str, float]:
    return {"x_m": float(pose[0]), "y_m": float(pose[1]), "angle_rad": float(pose[2])}


def _finger(setup: FingerSetup, finger: FingerPosture) -> dict[str, Any]:
    return {
        "tension_left_N": float(finger.tensions[0]),
        "tension_right_N": float(finger.tensions[1]),
        "tension_max_N": setup.max_tension,
        "base": _pose(finger.base),
        "tip": _pose(finger.backbone[-1, 1:4]),
        "family": finger.family,
        "element_lengths_m": [float(v) for v in finger.lengths],
    }


def _drive(drive: DriveState) -> dict[str, Any]:
    found: dict[str, Any] = {"tendons": list(drive.tendons), "command": drive.command}
    if np.isnan(drive.torque):
        return {**found, "wound_up_m": drive.position}
    found |= {"motor_angle_rad": drive.position, "torque_N_m": drive.torque}
    found["torque_to_reach_N_m"] = drive.torque_to_reach
    return found if np.isnan(drive.current) else {**found, "current_A": drive.current}


def _contact(contact: Contact) -> dict[str, Any]:
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
