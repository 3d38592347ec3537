"""The parts that a package may have, by the name that ``--what`` gives them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from continuum_grasp.export.part import PackagePart
from continuum_grasp.export.parts.control import estimator, mission, mpc
from continuum_grasp.export.parts.implicit import implicit_step
from continuum_grasp.export.parts.model import dynamics, kinematics, linearization, statics, step
from continuum_grasp.export.parts.seen import contact, sections
from continuum_grasp.export.subject import Subject

__all__ = ["ASKED_FOR", "OF_LOOPS", "PARTS"]

PARTS: dict[str, Callable[[Subject], PackagePart]] = {
    "dynamics": dynamics,
    "step": step,
    "implicit_step": implicit_step,
    "kinematics": kinematics,
    "statics": statics,
    "linearization": linearization,
    "shape": partial(sections, "shape"),
    "velocities": partial(sections, "velocities"),
    "contact": contact,
    "estimator": estimator,
    "mpc": mpc,
    "mission": mission,
}
"""Makers of the parts of a subject."""
ASKED_FOR = ("implicit_step", "linearization", "shape", "velocities", "contact")
"""Parts that no package has by default."""
OF_LOOPS = ("estimator", "mpc", "mission")
"""Parts that need a closed loop."""
