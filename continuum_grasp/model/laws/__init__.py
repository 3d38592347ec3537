"""Laws of the sections beyond linear elasticity and damping: a file each, and a word here."""

from __future__ import annotations

from continuum_grasp.model.laws import drag, dry_friction, limits, relaxation, shortening
from continuum_grasp.model.laws.section import Number, Numbers, SectionLaw
from continuum_grasp.scene import Finger

_LAWS = limits, drag, dry_friction, relaxation, shortening


def laws_of(finger: Finger, numbers: Numbers) -> tuple[SectionLaw, ...]:
    """Laws that a finger has, in the order of their states."""
    return tuple(law for each in _LAWS for law in each.laws_of(finger, numbers))


def numbers_of(finger: Finger) -> dict[str, Number]:
    """Numbers of the laws that may be run-time arguments, by name."""
    return {name: number for each in _LAWS for name, number in each.numbers_of(finger).items()}
