"""Certificates of stored grasps, judged from their numbers alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from continuum_grasp.base import check_arguments
from continuum_grasp.grasp.judge.arrays import RodArrays
from continuum_grasp.grasp.judge.certificate import Certificate, certify_held, shapes_of
from continuum_grasp.grasp.judge.check import Check, Requirement
from continuum_grasp.grasp.judge.space_rod import SpaceRod
from continuum_grasp.scene import GraspScene, HandScene


@check_arguments
def certify(scene: GraspScene | HandScene, arrays: Mapping[str, Any]) -> Certificate:
    """Verify a grasp from its stored numbers.

    Parameters
    ----------
    scene : GraspScene or HandScene
    arrays : mapping
        As ``arrays`` of `continuum_grasp.grasp.GraspResult` and `continuum_grasp.grasp.HandResult` gives and a run
        folder stores. Shapes of fingers follow from tensions, places and forces of contacts, and the moment in the base
        (``base_moment``); other numbers must agree with them.

    Returns
    -------
    Certificate

    Examples
    --------
    A change of the stored numbers is seen:

    >>> import continuum_grasp as cg
    >>> from continuum_grasp.grasp import certify
    >>> grasp = cg.optimize_grasp("configs/grasp/mug_arcs.yaml")
    >>> certify(grasp.scene, grasp.arrays).passed
    True
    >>> less = grasp.arrays["finger.tensions"] * [0.999, 1.0]
    >>> changed = certify(grasp.scene, {**grasp.arrays, "finger.tensions": less})
    >>> changed["finger equilibrium, finger"].passed
    False
    """
    reader = RodArrays.of(scene)
    shapes = Check(Requirement.ARRAYS, "", float(reader.misshapen(arrays)), 0.0)
    if not shapes.passed:
        return Certificate((shapes,))
    numbers = Check(Requirement.NUMBERS, "", float(reader.not_finite(arrays)), 0.0)
    held = reader.held(arrays)
    found = certify_held(scene, held)
    rest = [check for check in found.checks if check.requirement is not Requirement.NUMBERS]
    stored = reader.differences(held, found.rods, arrays) if found.rods else ()
    return replace(found, checks=(shapes, numbers, *rest, *stored))


def stored_shapes(scene: GraspScene | HandScene, arrays: Mapping[str, Any]) -> tuple[SpaceRod, ...]:
    """Shapes of the fingers of a stored grasp or attempt, whatever its certificate says."""
    return shapes_of(scene, RodArrays.of(scene).held(arrays))
