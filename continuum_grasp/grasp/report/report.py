"""A grasp result as text, for people and as YAML."""

from __future__ import annotations

import json
import math
import re
import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from continuum_grasp.grasp.report.shown import (
    disturbance_rows,
    fine_rows,
    further_advice,
    quality_rows,
    result_data,
)
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity

if TYPE_CHECKING:
    from continuum_grasp.grasp.certificate.certificate import Certificate
    from continuum_grasp.grasp.certificate.check import Check
    from continuum_grasp.grasp.certificate.model_error import ModelError
    from continuum_grasp.grasp.result import GraspResult

_HEAD = """\
# How the object is held, or why it is not. World frame, SI units. Forces at contacts are those on what touches the
# object: along its outward normal, and friction along the normal turned by +90 degrees; lift is on the object, out of
# the plane. result.npz holds all numbers, meta.json the configuration and every check.
"""

_BARE = re.compile(r"[A-Za-z][A-Za-z0-9_./+-]*( [A-Za-z0-9_./+-]+)*")
_WORDS = {"true", "false", "yes", "no", "on", "off", "null", "y", "n"}
_WIDTH = 110
"""Of a line [characters]: fits terminals and the page of a report without a bar to scroll."""


def result_text(result: GraspResult) -> str:
    """The result as aligned text, for people."""
    lines = [f"{result.status.value}: {result.message}"]
    if result.solved:
        lines += ["", *_finger_lines(result), "", *_contact_lines(result)]
        if result.certificate is not None:
            lines += [*_quality_lines(result), "", *_certificate_lines(result.certificate)]
        lines += [f"  {name}: {value}" for name, value in fine_rows(result)]
    else:
        lines += _why_lines(result)
    advice = further_advice(result)
    if advice:
        lines += ["", *textwrap.wrap(advice, 112)]
    return "\n".join(lines)


def result_yaml(result: GraspResult, *, quality: bool = True) -> str:
    """The result as YAML for people and other programs; SI units, which the names carry."""
    return _HEAD + yaml_text(result_data(result, quality=quality))


def _finger_lines(result: GraspResult) -> list[str]:
    lines, width = [], max(len(name) for name in result.fingers)
    if result.scene.object.free is not None:
        x, y, angle = result.object_pose
        lines.append(f"  object at ({1e3 * x:.2f}, {1e3 * y:.2f}) mm, turned by {angle:.4f} rad")
    for name, posture in result.fingers.items():
        finger = result.scene.named_fingers[name]
        most = "" if finger.tendons is None else f" of {finger.tendons.max_tension:g} N"
        left, right = posture.tensions
        lines.append(f"  {name:<{width}}  tendons  left {left:.3f} N, right {right:.3f} N{most}")
        pad = " " * (width + 4)
        if finger.base_free is not None:
            x, y, angle = posture.base
            lines.append(f"{pad}base at ({1e3 * x:.2f}, {1e3 * y:.2f}) mm, angle {angle:.4f} rad")
        middles = [c for c in result.contacts if c.name.startswith(f"{name}.middle")]
        for contact in middles:
            what = contact.name.removeprefix(f"{name}.").replace("_", " ").replace("middle", "middle contact")
            lines.append(f"{pad}{what} at {1e3 * contact.station:.2f} mm of {1e3 * finger.rod.length:g} mm")
        elements = ", ".join(f"{1e3 * h:.1f}" for h in posture.lengths)
        lines.append(f"{pad}elements {elements} mm ({posture.family})")
    return lines


def _contact_lines(result: GraspResult) -> list[str]:
    lifted = isinstance(result.scene.gravity, OutOfPlaneGravity)
    width = max(len("contact"), *(len(c.name) for c in result.contacts)) if result.contacts else 7
    lift = f"{'lift [N]':>10}" if lifted else ""
    lines = [f"  {'contact':<{width}}    x [mm]    y [mm]  normal [N]  friction [N]{lift}  margin"]
    for c in result.contacts:
        x, y, friction = (round(v, 3) + 0.0 for v in (*(1e3 * c.position), c.friction_force))  # no -0.0
        margin = abs(c.friction_margin) if abs(c.friction_margin) < 5e-7 else c.friction_margin
        lift = f"{c.lift:10.3f}" if lifted else ""
        lines.append(f"  {c.name:<{width}}{x:10.2f}{y:10.2f}{c.normal_force:12.3f}{friction:14.3f}{lift}{margin:8.1%}")
    return lines


def _quality_lines(result: GraspResult) -> list[str]:
    quality = _aligned(quality_rows(result))
    held = _aligned(disturbance_rows(result))
    return [
        *(["", "Quality", *quality] if quality else []),
        *(
            ["", "Disturbances (force x, y, moment), the multiple that is resisted, and what stops it", *held]
            if held
            else []
        ),
    ]


def _aligned(rows: list[tuple[str, str, str]]) -> list[str]:
    first, second = (max((len(row[k]) for row in rows), default=0) for k in (0, 1))
    return [f"  {a:<{first}}  {b:>{second}}  {c}".rstrip() for a, b, c in rows]


def _certificate_lines(certificate: Certificate) -> list[str]:
    verdict = "all checks passed" if certificate.passed else f"{len(certificate.failed)} checks FAILED"
    lines = [f"Verified independently: {verdict}"]
    rows = [_check_row(name, checks) for name, checks in _by_kind(certificate).items()]
    widths = [max(len(row[k]) for row in rows) for k in range(4)]
    lines += [f"  {a:<{widths[0]}}  {b:>{widths[1]}} {c:<{widths[2]}}  {d:<{widths[3]}}  {e}" for a, b, c, d, e in rows]
    lines += [f"  FAILED: {check.name}, {check.value:.2e}, limit {check.limit:.0e}" for check in certificate.failed]
    stability, overlap = certificate.stability, certificate.overlap
    word = "stable" if stability.stable else "UNSTABLE"
    lines += [
        f"  stability: {word}, least eigenvalue {stability.eigenvalue:.3g} E I / L",
        *_wrapped(f"({stability.assumptions})"),
        *_model_error_lines(certificate.model_error),
    ]
    if overlap > 0:
        lines.append(f"  fingers overlap by {1e3 * overlap:.2f} mm in the plane: they must lie at different heights")
    return lines


def _by_kind(certificate: Certificate) -> dict[str, list[Check]]:
    """Checks of the same kind, whichever finger or contact they are of."""
    kinds: dict[str, list[Check]] = {}
    for check in certificate.checks:
        kinds.setdefault(check.name.partition(", ")[0], []).append(check)
    return kinds


def _check_row(name: str, checks: list[Check]) -> tuple[str, str, str, str, str]:
    """The worst of a kind, and how many there are."""
    bad = [check for check in checks if not check.passed]
    worst = bad[0] if bad else max(checks, key=lambda check: check.value - check.limit)
    amount = "within" if worst.value <= 0 else f"{worst.value:.1e}"
    of = f"of {worst.relative_to}" if worst.relative_to else worst.unit.removeprefix("1")
    count = f" ({len(checks)})" if len(checks) > 1 else ""
    return name + count, amount, of, f"limit {worst.limit:.0e}", "FAILED" if bad else "ok"


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, 108, initial_indent="    ", subsequent_indent="    ", break_on_hyphens=False)


def _model_error_lines(error: ModelError) -> list[str]:
    mark = "ok" if error.small else "WARNING: raise fidelity.elements"
    return [
        f"  model error, limit {1e3 * error.limit:.2g} mm: {mark}",
        *_wrapped(str(error)),
        f"    (its bending moment by {error.moment:.1%} of the greatest, and the tension perhaps by as much)",
    ]


def _why_lines(result: GraspResult) -> list[str]:
    lines = []
    if result.reasons:
        lines += ["", "Why there is no grasp; any one of these repairs it:"]
        for r in result.reasons:
            unit = "" if r.unit in ("", "1") else f" {r.unit}"
            lines += [f"  {r.text}", f"    {r.repair}   ({r.key}, now {r.limit:.4g}{unit})"]
    if result.violated:
        lines += ["", "Broken constraints at the closest point:", *(f"  {text}" for text in result.violated)]
    if result.arrays:
        lines += ["", "The closest point, which is no grasp:", *_finger_lines(result), "", *_contact_lines(result)]
    return lines


def yaml_text(value: Any, *, exact: bool = False) -> str:
    """Mappings, lists, texts, numbers and None as block-style YAML 1.1, which 1.2 reads alike.

    Parameters
    ----------
    value : dict, list, ndarray, str, float, int, bool or None
        What to write.
    exact : bool, optional
        Keep all digits of numbers, so that the same ones are read back; otherwise nine.

    Returns
    -------
    str
        Ends in a line break.
    """
    value = _plain(value, exact)
    return ("\n".join(_lines(value)) if isinstance(value, (dict, list)) and value else _scalar(value)) + "\n"


def _plain(value: Any, exact: bool) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(inner, exact) for key, inner in value.items()}
    if hasattr(value, "tolist"):  # of numpy
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(inner, exact) for inner in value]
    return float(f"{value:.9g}") if isinstance(value, float) and not exact else value


def _lines(value: Any) -> list[str]:
    found = []
    if isinstance(value, dict):
        for key, inner in value.items():
            name = _text(str(key))
            if _nested(inner):
                indent = "  " if isinstance(inner, dict) else ""
                found += [f"{name}:", *(indent + line for line in _lines(inner))]
            else:
                found.append(f"{name}: {_flat(inner)}")
        return found
    for inner in value:
        if _nested(inner):
            first, *rest = _lines(inner)
            found += [f"- {first}", *(f"  {line}" for line in rest)]
        else:
            found.append(f"- {_flat(inner)}")
    return found


def _nested(value: Any) -> bool:
    """Whether a value takes lines of its own."""
    if not isinstance(value, (dict, list)) or not value:
        return False
    if isinstance(value, dict):
        return True
    return any(isinstance(v, (Mapping, list, tuple, str)) for v in value) or len(_flat(value)) > _WIDTH


def _flat(value: Any) -> str:
    if isinstance(value, dict):
        return "{}"
    if isinstance(value, list):
        return "[" + ", ".join(_scalar(v) for v in value) + "]"
    return _scalar(value)


def _scalar(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return _number(value)
    if isinstance(value, (dict, list)):
        return _flat(value)
    return _text(str(value))


def _number(value: float) -> str:
    if not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    digits, exponent, power = repr(value).partition("e")
    if "." not in digits:  # 1e-06 would be a text in YAML 1.1
        digits += ".0"
    return digits + exponent + power


def _text(value: str) -> str:
    if _BARE.fullmatch(value) and value.lower() not in _WORDS:
        return value
    quoted = json.dumps(value, ensure_ascii=False)
    return "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in quoted)
