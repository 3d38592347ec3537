"""Laws of a finger's sections beside linear elasticity and damping: by key, and in words."""

from __future__ import annotations

SECTION_LAWS = {
    "finger.stops": "stops",
    "finger.softening": "a material that softens",
    "finger.gyration_radius": "tendons that shorten the rod",
    "finger.damping.quadratic": "quadratic damping",
    "finger.damping.dry_friction": "dry friction in bending",
    "finger.damping.relaxation": "a material that relaxes",
}
FIT_MATCHED_TIP = ("finger.damping.quadratic", "finger.gyration_radius")
"""Laws under which the moment of the input alone gives the curvature at the tip."""


def unknown_to(who: str, *known: str) -> dict[str, str]:
    """Say, by key, why what has laws of its own refuses all but those that it knows."""
    others = {key: word for key, word in SECTION_LAWS.items() if key not in known}
    return {key: f"{who} does not know {word}: leave {key.rpartition('.')[2]} out" for key, word in others.items()}
