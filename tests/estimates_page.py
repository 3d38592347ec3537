"""The list of numbers to estimate in docs/real_rods.md; from inside: written from the tables of unknowns and laws.

The list of numbers to estimate in docs/real_rods.md, as the model has them; ``python -m tests.estimates_page``.
"""

from __future__ import annotations

from pathlib import Path

from continuum_grasp.addons.identification.unknowns import _OWN, ADDED
from continuum_grasp.model import Parameters
from continuum_grasp.model.laws import _LAWS
from continuum_grasp.model.parameters import _VECTORS
from continuum_grasp.scene import Finger

PAGE = Path(__file__).parents[1] / "docs" / "real_rods.md"
BEGIN = "<!-- What follows is written by `python -m tests.estimates_page`. -->\n"
END = "<!-- The list above is written by `python -m tests.estimates_page`. -->\n"
ROD = {"length": 0.2, "linear_density": 0.03, "bending_stiffness": 0.005}
FINGERS = [
    {"masses": [{"at": 0.1, "mass": 0.01}], "damping": {"relaxation": [{"share": 0.1, "time": 0.1}]}},
    {"softening": {"curvature": 5.0, "stiffness_ratio": 0.5}},
    {"damping": {"dry_friction": [{"stiffness": 0.001, "moment": 0.001}]}},
    {"tendons": {"offset": 0.005, "max_tension": 10.0}, "gyration_radius": 0.002},
]
"""Fingers that have all laws between them."""
WORDS = {
    **{name: f"finger.base, added to its {'angle' if name == 'clamp_angle' else 'position'}" for name in ADDED},
    "youngs_modulus": "finger.rod, if given by its shape",
    "bending_stiffness": "finger.rod, for a graded rod a factor in its factors",
    "linear_density": "finger.rod, for a graded rod a factor in its factors",
    "rotary_inertia": "finger.rod, for a graded rod a factor in its factors",
    "tip_mass": "finger.masses, at the tip",
    "drive_delay": "estimator.delay of a closed loop",
    "drive_time_constant": "finger.tendons.time_constant, finger.pressure.time_constant; or their drive",
}
"""Places of numbers that are no single key."""


def fingers() -> list[Finger]:
    """Fingers whose numbers are all that there are."""
    made = [Finger(**{"rod": ROD, **keys}) for keys in FINGERS]
    assert all(any(law.numbers_of(finger) for finger in made) for law in _LAWS)
    return made


def rows() -> dict[str, tuple[str, str]]:
    """Unit and place of every single number that can be estimated, by name."""
    numbers = {name: number for finger in fingers() for name, number in Parameters.numbers_of(finger).items()}
    single = {name: number for name, number in numbers.items() if name not in (*_VECTORS, "element_lengths")}
    found = {name: (number.unit, _place(number.key)) for name, number in single.items()}
    found |= {name: (unit or "m", "") for name, unit in _OWN.items() if name not in found}
    return {name: (unit, WORDS.get(name, place)) for name, (unit, place) in sorted(found.items())}


def _place(keys: str) -> str:
    return ", ".join(f"finger.{key.replace('*', '')}" for key in keys.split())


def text() -> str:
    """One line for each part of the finger, between the marks."""
    parts: dict[str, list[str]] = {}
    for name, (unit, place) in rows().items():
        part, _, key = place.rpartition(".")
        if " " in place:
            part, key = place, ""
        parts.setdefault(part, []).append(f"`{name}` [{unit}]" + (f" (`{key}`)" if key not in ("", name) else ""))
    marked = {part: part if " " in part else f"`{part}`" for part in parts}
    lines = [f"- {marked[part]}: {', '.join(names)}" for part, names in sorted(parts.items())]
    return BEGIN + "\n" + "\n".join(lines) + "\n\n" + END


if __name__ == "__main__":
    page = PAGE.read_text(encoding="utf-8")
    before, rest = page.split(BEGIN)
    PAGE.write_text(before + text() + rest.split(END)[1], encoding="utf-8")
