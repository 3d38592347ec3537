"""A grasp result as one web page that needs nothing but itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from continuum_grasp.grasp.html import cards, details, escaped, folded, items, report, section, table
from continuum_grasp.grasp.text import amount, answer_words, further_advice, parts

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.grasp.result import GraspResult


def page(result: GraspResult, *, pictures: Mapping[str, Axes] | None = None) -> str:
    """The result as an HTML page: picture, numbers, certificate, and the reasons where there is no grasp.

    ``pictures`` has the drawing as ``grasp``; where it is not given, `plot_grasp` draws it.
    The page, HTML5, has its pictures inside and refers to no other file or site.
    """
    from continuum_grasp.plotting import plot_grasp

    drawn = (pictures or {}).get("grasp") or plot_grasp(result)
    beside = {str(panel.get_label()): panel for panel in drawn.figure.axes}
    scene = result.scene
    # A scene that was made in Python may not have its version set, which a file needs.
    configuration = {"schema_version": scene.schema_version, **scene.model_dump(mode="json", exclude_unset=True)}
    extra = {"Contacts": _friction(beside), "Resisted disturbances": _resistance(beside)}
    sections = []
    for part in parts(result):
        lead = f'<p class="quiet">{escaped(part.lead)}. Recomputed from the stored numbers.</p>'
        head = part.head if any(part.head) else ()
        notes = [f"<p>{escaped(note)}.</p>" for note in part.notes]
        written = table(head, part.rows, part.numbers)
        sections.append(section(part.title, *[lead] * bool(part.lead), written, *notes, extra.get(part.title, "")))
    if result.arrays and not result.verified:
        lead = f'<p class="quiet">{_WORTH[result.answer]}</p>'
        sections = [details(answer_words(result), "\n".join((lead, *sections)))]
    return report(
        scene.name or "grasp",
        result.status.word,
        result.message,
        result.warnings,
        _why(result),
        _picture(result, drawn),
        cards(result.pairs().items() if result.verified else ()),
        *sections,
        section("The search", folded("Statistics", result.statistics)),
        section("The scene", folded("Configuration as read", configuration, exact=True)),
        solved=result.solved,
    )


_WORTH = {
    "first_repair": "Forces and margins with the repair, next to the limits of the unchanged scene.",
    "nominal_grasp": "Verified for the nominal object only.",
    "closest_attempt": "The closest attempt of the search: its forces are out of balance or violate limits.",
}
"""Worth of the numbers of a scene without a grasp."""


def _why(result: GraspResult) -> str:
    if result.verified:
        return f"<p>{escaped(result.advice)}</p>" if result.advice else ""
    rows = []
    for reason in result.reasons:
        # Limits that must be changed together have a row each; the first one's sentences are about all of them.
        words = [(reason.text, reason.repair), *[("at once with it", "")] * len(reason.also)]
        for each, (what, repair) in zip((reason, *reason.also), words, strict=True):
            rows.append((what, each.key, amount(each.limit, each.unit), amount(each.needed, each.unit), repair))
    head = ("What stands against it", "Key", "As given", "Needed", "Repair")
    broken = "<p>Violated constraints of the closest attempt:</p>" + items(result.violated) if result.violated else ""
    more = further_advice(result)
    advice = f"<p>{escaped(more)}</p>" if more else ""
    lead = "<p>Any one of these makes a grasp possible.</p>" if rows else ""
    return section("Why there is no grasp", lead, table(head, rows, (2, 3)), broken, advice, kind="why")


def _picture(result: GraspResult, drawn: Axes) -> str:
    if result.verified:
        caption = (
            "Arrows are the forces that the object bears, to scale; the light wedges are friction cones"
            f"{', darker where lift leaves them for friction in the plane' if result.scene.spatial else ''}; the small "
            "circles are joints of the finger's elements."
        )
    elif result.arrays:
        caption = f"No grasp: {result.message}. {answer_words(result)} is drawn in gray, without forces."
    else:
        caption = "No grasp: the scene as it starts; the fingers are drawn unloaded."
    return _figure("drawing", drawn, "drawing of object, fingers and forces", caption)


def _figure(name: str, drawn: Axes, described: str, caption: str) -> str:
    from continuum_grasp.plotting import StyledAxes

    drawing = StyledAxes(drawn).svg(name, described)
    return f'<figure class="{name}">\n{drawing}\n<figcaption>{escaped(caption)}</figcaption>\n</figure>'


def _friction(beside: Mapping[str, Axes]) -> str:
    """Say what the forces in the table of contacts are, and draw friction."""
    note = (
        '<p class="quiet">Forces on what touches the object: along the object\'s outward normal, and friction along '
        "that normal turned by +90\N{DEGREE SIGN}. Lift acts on the object, out of the plane. The margin is the unused "
        "share of the friction cone: at 0&nbsp;% the contact is about to slip.</p>"
    )
    if "friction" not in beside:
        return note
    caption = (
        "Friction at each contact: in the plane to the right, lift up. The rim is the friction coefficient times"
        " the normal force; a dot on it is about to slip."
    )
    return note + _figure("friction", beside["friction"], "friction by contact", caption)


def _resistance(beside: Mapping[str, Axes]) -> str:
    if "resisted" not in beside:
        return ""
    words = beside["resisted"].get_title(loc="left")
    caption = (
        "The greatest pure force at the center of mass that the grasp resists on top of the weight, by direction; the "
        f"dashed circle is the force that it resists in every direction. {words[0].upper() + words[1:]}."
    )
    return _figure("polygon", beside["resisted"], "resisted force by direction", caption)
