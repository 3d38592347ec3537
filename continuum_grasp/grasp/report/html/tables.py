"""Tables of a grasp's web page."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from continuum_grasp.grasp.report.html.text import details, table
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity

if TYPE_CHECKING:
    from continuum_grasp.grasp.result import GraspResult

__all__ = ["contacts_table", "fingers_table", "statistics_table"]


def fingers_table(result: GraspResult) -> str:
    """Tensions, base and contacts of each finger."""
    rows = []
    for name, posture in result.fingers.items():
        finger = result.scene.named_fingers[name]
        most = "" if finger.tendons is None else f"{finger.tendons.max_tension:g}"
        x, y, angle = posture.base
        middles = ", ".join(f"{1e3 * c.station:.1f}" for c in result.contacts if c.name.startswith(f"{name}.middle"))
        base = f"{1e3 * x:.1f}, {1e3 * y:.1f}; {math.degrees(angle):.1f}\N{DEGREE SIGN}"
        left, right = (f"{v:.3f}" for v in posture.tensions)
        rows.append((name, left, right, most, base, middles, f"{1e3 * finger.rod.length:g}", posture.family))
    head = ("Finger", "Left tendon [N]", "Right tendon [N]", "At most [N]", "Base x, y [mm]; angle")
    return table((*head, "Middle contacts at [mm]", "Length [mm]", "Family"), rows, (1, 2, 3))


def contacts_table(result: GraspResult) -> str:
    """Where the object is touched, and with what forces."""
    lifted = isinstance(result.scene.gravity, OutOfPlaneGravity)
    rows = []
    for c in result.contacts:
        margin = 0.0 if abs(c.friction_margin) < 5e-7 else c.friction_margin
        lift = [f"{c.lift:.3f}"] if lifted else []
        forces = (f"{c.normal_force:.3f}", f"{c.friction_force:.3f}", *lift, f"{margin:.1%}")
        place = (f"{1e3 * c.position[0]:.2f}", f"{1e3 * c.position[1]:.2f}")
        rows.append((c.name, *place, *forces, f"{result.scene.friction(c.name):g}"))
    lift = ["Lift [N]"] if lifted else []
    head = ("Contact", "x [mm]", "y [mm]", "Normal [N]", "Friction [N]", *lift, "Margin", "Friction coefficient")
    return table(head, rows, range(1, len(head)))


def statistics_table(statistics: Mapping[str, Any]) -> str:
    """What the search took, however it is nested."""
    simple, tables = [], []
    for name, value in _flattened(statistics):
        if isinstance(value, (list, tuple)) and value and all(isinstance(v, Mapping) for v in value):
            head = list(dict.fromkeys(key for row in value for key in row))
            rows = [[_said(row.get(key)) for key in head] for row in value]
            tables.append(
                details(
                    f"{name.replace('_', ' ')} ({len(value)})", table([key.replace("_", " ") for key in head], rows)
                )
            )
        else:
            simple.append((name.replace("_", " "), _said(value)))
    return "\n".join((table((), simple, (1,)), *tables))


def _flattened(values: Mapping[str, Any], before: str = "") -> list[tuple[str, Any]]:
    found: list[tuple[str, Any]] = []
    for key, value in values.items():
        name = f"{before}{key}"
        found += _flattened(value, f"{name}, ") if isinstance(value, Mapping) else [(name, value)]
    return found


def _said(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, (list, tuple)):
        return ", ".join(_said(v) for v in value)
    return str(value)
