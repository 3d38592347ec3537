"""A grasp result as one web page that needs nothing but itself, and as a picture, with the forces that it resists."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from continuum_grasp.grasp.report.html import (
    badge,
    cards,
    details,
    document,
    escaped,
    figure,
    items,
    nested,
    section,
    table,
)
from continuum_grasp.grasp.report.text import (
    ROBUST_HEAD,
    disturbance_rows,
    fine_rows,
    further_advice,
    quality_rows,
    robust_rows,
)
from continuum_grasp.results.yaml_text import yaml_text
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.grasp.certificate.certificate import Certificate
    from continuum_grasp.grasp.result import GraspResult


def picture(
    result: GraspResult, *, ax: Axes | None = None, tendons: bool = True, numbers: bool = True, resisted: bool = True
) -> Axes:
    """Draw a grasp as `plot_grasp` does, with the forces that it resists in a new figure that has numbers."""
    from continuum_grasp.plotting.grasp.picture import plot_grasp

    polygon = _resisted(result) if resisted and numbers and ax is None else None
    return plot_grasp(result, ax=ax, tendons=tendons, numbers=numbers, resisted=polygon)


def page(result: GraspResult) -> str:
    """Write the web page of a result."""
    return result_page(result, resisted=_resisted(result))


def _resisted(result: GraspResult) -> ArrayLike | None:
    return result.quality.resistance_polygon if result.solved else None


def result_page(result: GraspResult, *, resisted: ArrayLike | None = None) -> str:
    """The result as an HTML page: picture, numbers, certificate, and the reasons where there is no grasp.

    ``resisted`` (D, 2) is the greatest resisted force in each of D directions around the circle [N]. The page, HTML5,
    has its pictures inside and refers to no other file or site.
    """
    name = result.scene.name or "grasp"
    scene = result.scene
    # A scene that was made in Python may not have its version set, which a file needs.
    given = {"schema_version": scene.schema_version, **scene.model_dump(mode="json", exclude_unset=True)}
    body = [
        f"<h1>{escaped(name)}</h1>",
        f"<p>{badge(result.status.value, result.solved)} {escaped(result.message)}</p>",
        f'<div class="warning">{items(result.warnings)}</div>' if result.warnings else "",
        _why(result),
        _picture(result),
        _key_numbers(result),
        section("Fingers", _fingers(result)),
        section("Contacts", *_contacts(result)),
        section("Quality", table(("Index", "Value", "What it means"), quality_rows(result), (1,))),
        section("Resisted disturbances", _resistance(resisted), _disturbances(result)),
        section("Errors of the object", table(ROBUST_HEAD, robust_rows(result))),
        _certificate(result.certificate) if result.solved and result.certificate is not None else "",
        section("The same grasp in a fine model", table((), fine_rows(result))),
        section("The search", nested(result.statistics)),
        section(
            "The scene", details("Configuration, as it was read", f"<pre>{escaped(yaml_text(given, exact=True))}</pre>")
        ),
    ]
    return document(name, "\n".join(part for part in body if part))


def _why(result: GraspResult) -> str:
    if result.solved:
        return f"<p>{escaped(result.advice)}</p>" if result.advice else ""
    rows = [(r.text, r.key, _amount(r.limit, r.unit), _amount(r.needed, r.unit), r.repair) for r in result.reasons]
    head = ("What stands against it", "Key", "As given", "Needed", "Repair")
    broken = "<p>Broken constraints at the closest point:</p>" + items(result.violated) if result.violated else ""
    more = further_advice(result)
    advice = f"<p>{escaped(more)}</p>" if more else ""
    lead = "<p>Any one of these would make a grasp possible.</p>" if rows else f"<p>{escaped(result.message)}</p>"
    return section("Why there is no grasp", lead, table(head, rows, (2, 3)), broken, advice, kind="why")


def _picture(result: GraspResult) -> str:
    from continuum_grasp.plotting.drawing.axes import inline_svg
    from continuum_grasp.plotting.grasp.picture import plot_grasp

    caption = (
        "Arrows are the forces that the object bears, to scale; the light wedges are friction cones; the small circles "
        "are joints of the finger's elements."
        if result.arrays
        else "The scene as it starts; the fingers are drawn unloaded."
    )
    drawing = inline_svg(plot_grasp(result, numbers=False), "drawing", "drawing of object, fingers and forces")
    return figure("drawing", drawing, caption)


def _key_numbers(result: GraspResult) -> str:
    if not result.solved:
        return ""
    contacts, certificate = result.contacts, result.certificate
    pairs = [("sum of tensions", f"{result.tension:.2f} N")]
    if contacts:
        pairs += [
            ("greatest normal force", f"{max(c.normal_force for c in contacts):.2f} N"),
            ("least friction margin", f"{max(min(c.friction_margin for c in contacts), 0.0):.1%}"),
        ]
    if certificate is not None:
        pairs += [
            ("checks passed", f"{len(certificate.checks) - len(certificate.failed)} of {len(certificate.checks)}"),
            ("second-order test", "stable" if certificate.stability.stable else "unstable"),
        ]
        if math.isfinite(certificate.model_error.greatest):
            pairs.append(("model error", f"{1e3 * certificate.model_error.greatest:.2f} mm"))
    return cards(pairs)


def _fingers(result: GraspResult) -> str:
    """Tensions, base and contacts of each finger."""
    rows, contacts = [], result.contacts
    for setup in result.scene.setups if result.arrays else ():
        posture = result.fingers[setup.name]
        x, y, angle = posture.base
        middles = ", ".join(f"{1e3 * c.station:.1f}" for c in contacts if c.name in setup.middle_names)
        base = f"{1e3 * x:.1f}, {1e3 * y:.1f}; {math.degrees(angle):.1f}\N{DEGREE SIGN}"
        left, right = (f"{v:.3f}" for v in posture.tensions)
        most, length = f"{setup.tendons.max_tension:g}", f"{1e3 * setup.finger.rod.length:g}"
        rows.append((setup.name, left, right, most, base, middles, length, posture.family))
    head = ("Finger", "Left tendon [N]", "Right tendon [N]", "At most [N]", "Base x, y [mm]; angle")
    return table((*head, "Middle contacts at [mm]", "Length [mm]", "Family"), rows, (1, 2, 3))


def _contacts(result: GraspResult) -> tuple[str, str]:
    """Where the object is touched, and with what forces."""
    lifted = isinstance(result.scene.gravity, OutOfPlaneGravity)
    rows: list[tuple[Any, ...]] = []
    for c in result.contacts:
        margin = 0.0 if abs(c.friction_margin) < 5e-7 else c.friction_margin  # "-0.0 %" is rounding
        lift = [f"{c.lift:.3f}"] if lifted else []
        forces = (f"{c.normal_force:.3f}", f"{c.friction_force:.3f}", *lift, f"{margin:.1%}")
        place = (f"{1e3 * c.position[0]:.2f}", f"{1e3 * c.position[1]:.2f}")
        rows.append((c.name, *place, *forces, f"{result.scene.friction(c.name):g}"))
    lift = ["Lift [N]"] if lifted else []
    head = ("Contact", "x [mm]", "y [mm]", "Normal [N]", "Friction [N]", *lift, "Margin", "Friction coefficient")
    note = (
        '<p class="quiet">Forces on what touches the object: along the object\'s outward normal, and friction along '
        "that normal turned by +90\N{DEGREE SIGN}. Lift acts on the object, out of the plane. The margin is what is "
        "left of the friction cone: 0&nbsp;% is about to slip.</p>"
    )
    return table(head, rows, range(1, len(head))), note if rows else ""


def _resistance(resisted: ArrayLike | None) -> str:
    from continuum_grasp.plotting.drawing.axes import inline_svg
    from continuum_grasp.plotting.grasp.resistance import plot_resistance, resistance_extremes, resistance_words

    if resisted is None or resistance_extremes(resisted)[1] <= 0:
        return ""
    words = resistance_words(resisted)
    caption = (
        "The greatest pure force at the center of mass that is resisted on top of the weight, direction by direction; "
        f"the dashed circle is what is resisted whichever way it acts. {words[0].upper() + words[1:]}."
    )
    drawing = inline_svg(plot_resistance(resisted), "resisted", "resisted force by direction")
    return figure("polygon", drawing, caption)


def _disturbances(result: GraspResult) -> str:
    head = ("Disturbance: force x, y, moment", "Multiple that is resisted", "What stops it then")
    return table(head, disturbance_rows(result), (1,))


def _certificate(certificate: Certificate) -> str:
    rows = [
        (
            check.name,
            "within" if check.value <= 0 else f"{check.value:.2e}",
            f"{check.limit:.0e}",
            check.relative_to or check.unit,
            "ok" if check.passed else "FAILED",
        )
        for check in certificate.checks
    ]
    stability = certificate.stability
    word = "stable" if stability.stable else "unstable"
    lead = (
        "Recomputed from the stored numbers by code that shares nothing with the search. A value is relative to what "
        "stands beside it."
    )
    return section(
        "Certificate",
        f'<p class="quiet">{escaped(lead)}</p>',
        table(("Check", "Found", "Limit", "Relative to, or unit", ""), rows, (1, 2)),
        f"<p><b>Stability:</b> {word}, least eigenvalue {stability.eigenvalue:.3g} E I / L "
        f'<span class="quiet">({escaped(stability.assumptions)})</span>.</p>',
        f"<p><b>Model error:</b> {escaped(str(certificate.model_error))}.</p>",
        f"<p><b>Fingers overlap</b> by {1e3 * certificate.overlap:.2f} mm in the plane: they must lie at different "
        "heights.</p>"
        if certificate.overlap > 0
        else "",
    )


def _amount(value: float, unit: str) -> str:
    return f"{value:.4g}" if unit in ("", "1") else f"{value:.4g} {unit}"
