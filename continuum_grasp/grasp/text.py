"""Parts of a report on a grasp; as text for people, and the summary as YAML."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from continuum_grasp.base import Array, Summarized, amount_text, prefixes
from continuum_grasp.grasp.judge.check import EXACT
from continuum_grasp.results import yaml_text

if TYPE_CHECKING:
    from continuum_grasp.grasp.judge.certificate import Certificate
    from continuum_grasp.grasp.judge.check import Check, Requirement
    from continuum_grasp.grasp.judge.drives import DriveState
    from continuum_grasp.grasp.result import GraspResult
    from continuum_grasp.grasp.robust.result import Robustness
    from continuum_grasp.grasp.values import Contact, FingerPosture, OutlineError

_HEAD = """\
# How the object is held, or why it is not. World frame, SI units. Forces at contacts are those on what touches the
# object: along its outward normal, and friction along the normal turned by +90 degrees; lift is on the object, out of
# the plane. result.npz holds all numbers, meta.json the configuration and every check.
"""


@dataclass(frozen=True)
class TextPart:
    """A part of the report on a grasp, as text and on the page: a table and sentences about it."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    numbers: Sequence[int] = ()  # columns that stand on the right
    lead: str = ""
    notes: Sequence[str] = ()


def parts(result: GraspResult, quality: bool = True) -> list[TextPart]:
    """Say all about a grasp, or about what there is in its place; parts without rows are left out."""
    every = [_fingers(result), _contacts(result)] if result.arrays else []
    if result.verified:
        every += [_quality(result), _disturbances(result)] if quality and result.solved else []
        every += [] if result.certificate is None else [_certificate(result.certificate, push=quality)]
        every += [_elements(result)] if result.element_errors else []
    every += [] if result.outline is None else [_outline(result.outline)]
    every += [_trials(result.robustness)] if result.robustness is not None else []
    return [part for part in every if part.rows]


def result_text(result: GraspResult) -> str:
    """The result as aligned text, for people."""
    lines = [f"{result.status.word}: {result.message}"]
    if not result.verified:
        lines += _why_lines(result)
    for part in parts(result, quality=result.certificate is not None):
        lines += ["", f"{part.title}. {part.lead}" if part.lead else part.title]
        left = {*range(len(part.rows[0]))} - {*part.numbers}
        rows = [part.head, *part.rows] if any(part.head) else part.rows
        lines += [f"  {line}" for line in Summarized.aligned(rows, left)]
        for note in part.notes:
            lines += textwrap.wrap(note, 108, initial_indent="    ", subsequent_indent="    ", break_on_hyphens=False)
    advice = further_advice(result)
    if advice:
        lines += ["", *textwrap.wrap(advice, 112)]
    return "\n".join(lines)


def _why_lines(result: GraspResult) -> list[str]:
    lines = []
    if result.reasons:
        lines += ["", "Why there is no grasp; any one of these repairs it:"]
        for r in result.reasons:
            now = (f"{each.key}, now {amount(each.limit, each.unit)}" for each in (r, *r.also))
            lines += [f"  {r.text}", f"    {r.repair}   ({'; '.join(now)})"]
    if result.violated:
        lines += ["", "Violated constraints of the closest attempt:", *(f"  {text}" for text in result.violated)]
    if result.arrays:
        lines += ["", f"{answer_words(result)}:"]
    return lines


def answer_words(result: GraspResult) -> str:
    """Kind of the numbers of a result without a grasp, in words."""
    if result.answer == "first_repair":
        return f"The grasp with the first repair ({result.reasons[0].repair})"
    if result.answer == "nominal_grasp" and result.robustness is not None:
        return f"The grasp {result.robustness.names[1]}"
    return "The closest attempt (not a grasp)"


def further_advice(result: GraspResult) -> str:
    """The advice without the repairs, where these are shown beside their reasons."""
    repairs = "Any one of these repairs it: " + "; ".join(reason.repair for reason in result.reasons) + "."
    return result.advice.removeprefix(repairs).strip() if result.reasons else result.advice


# -- parts -------------------------------------------------------------------------------------------------------


def _fingers(result: GraspResult) -> TextPart:
    """Tensions, base and contacts of each finger, and what its drives do."""
    rows = []
    notes = []
    unit = result.force_units[0]
    if result.scene.object.free is not None:
        notes.append(f"object at {_mm(result.object_pose[:2])} mm, turned by {result.object_pose[2]:.4f} rad")
    for setup in result.scene.setups:
        posture = result.fingers[setup.name]
        base = f"{_mm(posture.base[:2])}; {np.degrees(posture.base[2]):.1f}\N{DEGREE SIGN}"
        middles = _mm([c.station for c in result.contacts if c.name in setup.middle_names])
        tensions = (result.force_text(tension, unit) for tension in posture.tensions)
        most = f"{prefixes('N')[unit] * setup.max_tension:g}"
        rows.append((setup.name, *tensions, most, base, middles, f"{1e3 * posture.lengths.sum():g}"))
        notes.append(f"{setup.name}: elements of {_mm(posture.lengths)} mm ({posture.family})")
        notes += [f"{setup.name}: {text}" for text in _drives(result, setup.name)]
    pulled = (f"Left tendon [{unit}]", f"Right [{unit}]", f"At most [{unit}]")
    head = ("Finger", *pulled, "Base [mm]", "Middle at [mm]", "Length [mm]")
    return TextPart("Fingers", head, rows, (1, 2, 3), notes=notes)


def _drives(result: GraspResult, finger: str) -> list[str]:
    """States of the drives of a finger, in words; none where its tensions are commanded."""
    return drive_lines(result.drives.get(finger, ()), result.fingers[finger].tensions)


def drive_lines(drives: Iterable[DriveState], tensions: Array) -> list[str]:
    """States of the drives of a finger with tensions (2,) [N]."""
    lines = []
    slack = [side for side, pull in zip(("left", "right"), tensions, strict=True) if pull < 1e-3]
    for drive in drives:
        text = f"drive of {' and '.join(drive.tendons)} "
        if np.isnan(drive.torque):
            text += f"wound up by {1e3 * drive.position:.3f} mm"
        else:
            text += f"at {drive.position:.4f} rad, holds {1e3 * drive.torque:.4g} mN m, reached with "
            text += f"{1e3 * drive.torque_to_reach:.4g} mN m"
        loose = [side for side in drive.tendons if side in slack]
        lines.append(text + (f"; {' and '.join(loose)} slack" if loose else ""))
    return lines


def _contacts(result: GraspResult) -> TextPart:
    """Places of the contacts, and their forces."""
    rows = []
    lifted = result.scene.spatial
    unit = result.force_units[1]
    for c in result.contacts:
        x, y = (round(1e3 * v, 3) + 0.0 for v in c.position)  # no -0.0
        forces = (result.force_text(f, unit) for f in (c.normal_force, c.friction_force, *([c.lift] if lifted else [])))
        coefficient = f"{result.scene.friction(c.name):g}"
        rows.append((c.name, f"{x:.2f}", f"{y:.2f}", *forces, result.margin_text(c), coefficient))
    lift = [f"Lift [{unit}]"] if lifted else []
    head = (
        "Contact",
        "x [mm]",
        "y [mm]",
        f"Normal [{unit}]",
        f"Friction [{unit}]",
        *lift,
        "Margin",
        "Friction coefficient",
    )
    notes = [result.bound_words] if result.bound_words else []
    return TextPart("Contacts", head, rows, range(1, len(head)), notes=notes)


def _quality(result: GraspResult) -> TextPart:
    rows = [(name.replace("_", " "), _short(value), description) for name, value, description in result.quality.rows()]
    return TextPart("Quality", ("Index", "Value", "Meaning"), rows, (1,))


def _disturbances(result: GraspResult) -> TextPart:
    """The scene's disturbances, as far as they are resisted."""
    held = result.quality.resistance
    rows = []
    for (x, y, moment), factor, limiting in zip(held.wrenches, held.factors, held.limiting, strict=True):
        what = ", ".join(amount_text(value, unit) for value, unit in ((x, "N"), (y, "N"), (moment, "N m")))
        rows.append((what, "no limit" if np.isinf(factor) else _short(factor), ", ".join(limiting)))
    head = ("Disturbance: force x, y, moment", "Multiple resisted", "Then limited by")
    return TextPart("Resisted disturbances", head, rows, (1,))


def _certificate(certificate: Certificate, *, push: bool) -> TextPart:
    """Per requirement, whichever finger or contact it is of, the check that takes the greatest share of its limit."""
    kinds: dict[Requirement, list[Check]] = {}
    for check in certificate.checks:
        kinds.setdefault(check.requirement, []).append(check)
    rows = []
    for requirement, checks in kinds.items():
        worst = max(checks, key=lambda check: check.share)
        count = f" ({len(checks)})" if len(checks) > 1 else ""
        found = "within" if worst.value <= 0.0 else f"{worst.value:.1e}"
        unit = "" if worst.unit == "1" else worst.unit
        verdict = "ok" if worst.passed else "FAILED"
        rows.append((requirement.value + count, found, f"{worst.limit:.0e}", unit, verdict))
    verdict = "all checks passed" if certificate.passed else f"{len(certificate.failed)} checks FAILED"
    notes = [f"FAILED: {check}" for check in certificate.failed]
    if push and certificate.rods:
        borne = amount_text(certificate.push, "N", ".3g")
        notes.append(
            f"{certificate.word} at constant tensions; bears a push of {borne} in any direction, to first order"
        )
    head = ("Check", "Found", "Limit", "Unit", "Verdict")
    return TextPart("Certificate", head, rows, (1, 2), f"Verified independently: {verdict}", notes)


def _elements(result: GraspResult) -> TextPart:
    """Differences of elements from the exact rods that they stand for."""
    rows = [
        (name, str(error.elements), f"{error.normal_force:.2%}", f"{error.displacement:.3%}")
        for name, error in result.element_errors.items()
    ]
    head = ("Finger", "Elements", "Normal forces change by", "Shape, per length")
    return TextPart("Elements that stand for the rods in quality, missions and motions", head, rows, (1, 2, 3))


def _outline(outline: OutlineError) -> TextPart:
    return TextPart("Outline of the object", ("", ""), [("error", str(outline))])


def _trials(robustness: Robustness) -> TextPart:
    """The nominal grasp and that for all errors side by side."""
    title, nominal, robust = robustness.names
    return TextPart(title, ("", f"best {nominal}", robust), robustness.rows())


def amount(value: float, unit: str) -> str:
    """Write a limit with its unit."""
    return amount_text(value, "" if unit == "1" else unit, ".4g")


def _mm(lengths: Iterable[float]) -> str:
    return ", ".join(f"{1e3 * length + 0.0:.1f}" for length in lengths)


def _short(value: float) -> str:
    return "0" if abs(value) < EXACT else f"{value:.4g}"


def result_yaml(result: GraspResult, *, quality: bool = True) -> str:
    """Summary of a result as YAML, under the names that its parts have in Python and in the run folder.

    ``quality=False`` leaves out the indices of quality, which cost more than the rest.
    """
    about = dict(result.details(quality=quality))
    if result.certificate is not None:
        about["certificate"] |= result.certificate.summary
    answer: dict[str, Any] | None = None
    if result.arrays:
        fingers = {}
        for name, finger in result.fingers.items():
            drives = [_plain(drive) for drive in result.drives.get(name, ())]
            fingers[name] = _plain(finger) | {"drives": drives}
        contacts = [_plain(contact) for contact in result.contacts]
        answer = {
            "tension": result.total_tension,
            "object": result.object_pose,
            "fingers": fingers,
            "contacts": contacts,
        }
    summary = {
        "name": result.scene.name,
        "status": result.status.value,
        "warnings": list(result.warnings),
        **{key: about.pop(key) for key in ("message", "advice", "reasons", "violated")},
        result.answer: answer,
        **about,
    }
    return _HEAD + yaml_text({key: value for key, value in summary.items() if value not in (None, "", [], {})})


def _plain(part: FingerPosture | DriveState | Contact) -> dict[str, Any]:
    """A part of a grasp as plain data, without its long arrays and the numbers that it does not have."""
    values = {entry.name: getattr(part, entry.name) for entry in fields(part) if entry.repr}
    return {key: value for key, value in values.items() if not (isinstance(value, float) and np.isnan(value))}
