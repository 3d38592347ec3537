"""The parts that a package may have, by the name that ``--what`` gives them."""

from __future__ import annotations

from collections.abc import Callable

from continuum_grasp.export.part import Part
from continuum_grasp.export.parts.dynamics import dynamics
from continuum_grasp.export.parts.kinematics import kinematics
from continuum_grasp.export.parts.statics import statics
from continuum_grasp.export.parts.step import step
from continuum_grasp.export.subject import Subject

__all__ = ["PARTS"]

PARTS: dict[str, Callable[[Subject], Part]] = {
    "dynamics": dynamics,
    "step": step,
    "kinematics": kinematics,
    "statics": statics,
}
"""What makes each part of a subject."""
