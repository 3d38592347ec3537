"""What the numbers of a model are, for the header."""

from __future__ import annotations

import re

from continuum_grasp.model import FingerModel

__all__ = ["describe", "rate_unit"]

_PATTERNS = (
    (r"theta_(\d+)", "bend of element {0}, positive towards the base's -X"),
    (r"kappa_(\d+)", "curvature at node {0}, counted from the base as 0"),
    (r"(theta|kappa)_(\d+)_rate", "its rate"),
    (r"tip_moment", "moment at the tip, positive like bends"),
    (r"tip_moment_rate", "its rate"),
    (r"tip_couple_(\d+)", "further moment at the tip"),
    (r"tension_1", "tendon on the base's -X side, which bends positively"),
    (r"tension_2", "tendon on the other side"),
    (r"(\w+)_acceleration", "second derivative of {0}"),
    (r"(\w+)_rate", "rate of {0}"),
    (r"tip_([xy])", "world force at the tip"),
    (r"load_(\d+)_([xy])", "world force of load {0}"),
    (r"load_(\d+)_across", "force of load {0} across the finger, which it follows"),
    (r"load_(\d+)_along", "the same along the finger"),
    (r"load_(\d+)_moment", "moment of load {0}"),
    (r"base_angle", "from the world's to the base's axes"),
    (r"gravity_([xy])", "world gravity"),
    (r"element_lengths(?:_(\d+))?", "length of the element"),
    (r"linear_density", "mass per length"),
    (r"bending_stiffness", "E I"),
    (r"rotary_inertia", "per length"),
    (r"material_damping", "moment per rate of curvature"),
    (r"per_arc_damping", "moment per rate of an element's bend"),
    (r"rest_curvature", "curvature of the finger that is left alone"),
    (r"tendon_offset", "of the tendons from the backbone"),
    (r"tendon_friction", "between tendon and guides"),
    (r"tip_mass", "at the tip"),
)


def describe(model: FingerModel, name: str) -> str:
    """What a number is; empty where its name says it."""
    contact = re.fullmatch(r"contact_(\d+)_[xy]", name)
    if contact:
        return f"world force at contact {contact[1]}, {model.contacts[int(contact[1]) - 1]:g} m along the finger"
    mass = re.fullmatch(r"mass_(\d+)", name)
    if mass:
        return f"at {model.finger.masses[int(mass[1])].at:g} m along the finger"
    for pattern, text in _PATTERNS:
        match = re.fullmatch(pattern, name)
        if match:
            return text.format(*(group or "" for group in match.groups()))
    return ""


def rate_unit(unit: str) -> str:
    """Unit of the rate of something."""
    return unit[:-2] + "/s2" if unit.endswith("/s") else f"{unit}/s"
