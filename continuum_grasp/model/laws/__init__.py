"""Laws of the moment that a section exerts beyond linear elasticity and damping: a file each, and a line here."""

from __future__ import annotations

from continuum_grasp.model.family import Family
from continuum_grasp.model.laws.drag import Drag
from continuum_grasp.model.laws.dry_friction import DryFriction
from continuum_grasp.model.laws.limits import Softening, Stops
from continuum_grasp.model.laws.relaxation import Relaxation
from continuum_grasp.model.laws.section import Number, Numbers, SectionLaw
from continuum_grasp.scene.finger import Finger

LAWS: tuple[type[SectionLaw], ...] = (Stops, Softening, Drag, DryFriction, Relaxation)


def laws_of(finger: Finger, family: Family, numbers: Numbers) -> tuple[SectionLaw, ...]:
    """Those that a finger has, in the order in which their states follow one another."""
    return tuple(law(finger, family, numbers) for law in LAWS if law.applies(finger, numbers))


def numbers_of(finger: Finger) -> dict[str, Number]:
    """Each number of theirs that may be a run-time argument, by name."""
    return {name: number for law in LAWS for name, number in law.numbers(finger).items()}
