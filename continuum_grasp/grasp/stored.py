"""The arrays of a grasp."""

from __future__ import annotations

from continuum_grasp.results import Dimension, Stored

SHAPE = (
    Stored(
        "{finger}.q",
        "({finger} coordinate,)",
        "",
        "above rest: bends of the elements [rad] (arc) or nodal curvatures [1/m]",
    ),
    Stored("{finger}.lengths", "({finger} element,)", "m", "lengths of the elements"),
    Stored(
        "{finger}.curvature_shapes",
        "({finger} element, {finger} spread, {finger} shape)",
        "",
        "curvature above rest at places spread evenly along each element, per coordinate",
    ),
    Stored("{finger}.tip_curvature", "()", "1/m", "curvature at the tip above rest"),
    Stored("{finger}.tensions", "(tendon,)", "N", "tensions of the tendons"),
)
"""Arrays of the shape of a finger in its plane, and of what bends it."""
BASE_MOMENT = Stored("{finger}.base_moment", "(axis,)", "N m", "moment in the base, world; of exact rods alone")
"""The array from which the shape of an exact rod follows."""
_POSTURE = (
    Stored("object.pose", "(pose,)", "", "pose of the object: x, y [m], angle [rad]"),
    Stored("contact_positions", "(contact, xy)", "m", "contacts on the object's surface, world"),
    Stored("contact_normals", "(contact, xy)", "1", "outward normals of the object there, world"),
    Stored(
        "contact_forces",
        "(contact, part)",
        "N",
        "normal force, friction along the surface, friction out of the plane",
    ),
    Stored("contact_stations", "(contact,)", "m", "positions along the finger; NaN for supports"),
    *SHAPE,
    Stored("{finger}.base", "(base,)", "", "world x, y [m] and angle [rad] of the base"),
    Stored("{finger}.backbone", "({finger} place, section)", "", "shape of the finger from base to tip"),
)
"""Arrays that a grasp has, and with other friction states of its tendons has anew."""


_CONTACTS = (
    Stored("contact_names", "(contact,)", "text", "name of each contact"),
    Stored("contact_parts", "(contact,)", "1", "index of the object's convex part"),
)
"""With other friction states contacts may be clear: their names are empty then, and their numbers NaN."""


def _held(stored: Stored) -> Stored:
    axes = stored.shape.replace("contact", "{held} contact").strip("()").rstrip(",").split(", ")
    dimensions = ", ".join(["state", *filter(None, axes)])
    dimensions += "," * ("," not in dimensions)
    meaning = f"with other friction states: {stored.meaning}"
    return Stored(f"{{held}}.{stored.name}", f"({dimensions})", stored.unit, meaning)


_STATES = Stored(
    "{finger}.friction_states",
    "({finger} cell,)",
    "1",
    "these states, +1: the left tendon was pulled last; then states of dry friction in bending, cell by cell with one "
    "per branch, +1: against a bend towards the left",
)
STORED = (
    *_CONTACTS,
    Stored("{finger}.family", "()", "text", "arc, clothoid or matched_clothoid"),
    BASE_MOMENT,
    *_POSTURE,
    *(_held(stored) for stored in (*_CONTACTS, *_POSTURE, _STATES)),
    Stored("{trials}.errors", "(draw, error)", "", "errors of the object that were drawn, where the scene has robust"),
    Stored("{held trials}.friction_states", "(draw, cell)", "1", "friction states that were drawn"),
    Stored("{trials}.margins", "(draw,)", "1", "least friction margin of each; -inf: a contact parts, NaN: no answer"),
    Stored("{trials}.nominal_margins", "(nominal draw,)", "1", "the same, of the best grasp without errors"),
)
"""Stored arrays; where there is no grasp: of the first repair, or of the point that comes closest, or none of them."""
OF_FINGERS = (
    Dimension("{finger} coordinate", "bending coordinates"),
    Dimension("{finger} shape", "the same, and the tip's curvature where the balance of moments sets it"),
    Dimension("{finger} element", "elements, from the base"),
    Dimension("{finger} spread", "places spread evenly along an element"),
    Dimension("{finger} place", "places along the finger"),
)
"""Dimensions of the arrays of each finger."""
DIMENSIONS = (
    Dimension("contact", "contacts of the object", "contact_names"),
    Dimension.XY,
    Dimension.POSE,
    Dimension("part", "parts of a contact force", ("normal", "friction", "lift")),
    Dimension("tendon", "tendons: on the finger's left (-X side), on its right", ("left", "right")),
    Dimension("base", "pose of the base", ("x [m]", "y [m]", "angle [rad]")),
    Dimension("axis", "axes of the world", ("x", "y", "z")),
    Dimension("section", "of a section", ("s [m]", "x [m]", "y [m]", "angle [rad]")),
    Dimension("state", "sets of friction states"),
    Dimension("{held} contact", "contacts of the grasp, then those made with other friction states alone"),
    Dimension("{finger} cell", "friction cells, from the base"),
    Dimension("draw", "random errors of the object, and friction states"),
    Dimension("nominal draw", "the first of these"),
    Dimension("error", "errors of an object", ("x [m]", "y [m]", "angle [rad]", "radius", "friction", "mass")),
    Dimension("cell", "friction cells of all fingers"),
    *OF_FINGERS,
)
