"""Why a scene has no grasp: each limit is given way to alone, and what it then takes is the reason."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate import certify
from continuum_grasp.grasp.ipopt import GraspSolverRun
from continuum_grasp.grasp.points import starting_point
from continuum_grasp.grasp.relaxations import RELAXATIONS, Relaxation
from continuum_grasp.grasp.result import Reason
from continuum_grasp.grasp.seeds import Seed
from continuum_grasp.scene.grasp import GraspScene, NoGravity, OutOfPlaneGravity

__all__ = ["FoundReason", "find_reasons", "out_of_reach"]

STARTS = 2
"""Starts per limit."""
SHORT = 1e-3
"""By what part of it an amount must stay short of the most that makes sense."""


@dataclass(frozen=True)
class FoundReason:
    """A reason, and the point that the solver found with that limit relaxed.

    Attributes
    ----------
    reason : Reason
    x : ndarray
        Scaled unknowns.
    """

    reason: Reason
    x: NDArray[Any]


def out_of_reach(scene: GraspScene) -> Reason | None:
    """The exact test of distance: no shape at all can touch."""
    length = scene.finger.rod.length
    reach = length if scene.contacts.middle == "off" else scene.middle_bounds[1]
    reach += scene.object.radius + scene.finger.thickness_radius
    distance = math.dist(scene.finger.base.position, scene.object.position)
    if distance <= reach:
        return None
    text = f"the object is out of reach: its centre is {distance:.4g} m from the base, {reach:.4g} m can be reached"
    repair = f"bring object and base nearer to each other, by {distance - reach:.4g} m at least"
    return Reason("reach", "object.position", "m", distance, reach, text, repair)


def find_reasons(scene: GraspScene, solver: GraspSolverRun, seeds: list[Seed], until: float) -> list[FoundReason]:
    """The limits each of which, given way to alone, makes a grasp that the certificate confirms.

    Parameters
    ----------
    scene : GraspScene
    solver : GraspSolverRun
    seeds : list of Seed
        Starts; the first two are used.
    until : float
        ``time.monotonic()`` at which to stop.

    Returns
    -------
    list of FoundReason
        Sorted by how small a part of the limit is missing.
    """
    found = []
    for relaxation in _sensible(scene):
        amount, point = math.inf, np.empty(0)
        for seed in seeds[:STARTS]:
            if time.monotonic() > until:
                break
            variable = solver.problem.parts.variables[f"relaxed {relaxation.name}"]
            x0 = starting_point(solver.problem, seed)
            x0[variable.start : variable.stop] = relaxation.start(scene) / variable.scale
            attempt = solver.run(seed.label, x0, until, {relaxation.name: relaxation.most})
            if attempt.violations:
                continue
            given = float(np.linalg.norm(attempt.x[variable.start : variable.stop])) * variable.scale
            if given < min(amount, relaxation.most * (1.0 - SHORT)):
                relaxed = relaxation.relaxed(scene, given)
                certificate = certify(relaxed, solver.reader.arrays(attempt.x))
                if all(c.name == relaxation.excuses for c in certificate.failed):
                    amount, point = given, attempt.x
        if math.isfinite(amount):
            limit, needed = relaxation.limit(scene), relaxation.value(scene, amount)
            text, repair = relaxation.sentence(scene, amount), relaxation.advice(scene, amount)
            reason = Reason(relaxation.name, relaxation.key, relaxation.unit, limit, needed, text, repair)
            found.append(FoundReason(reason, point))
    return sorted(found, key=lambda f: _share(scene, f.reason))


def _share(scene: GraspScene, reason: Reason) -> float:
    """How far the limit is off, as a part of itself, or of what is usual where the limit is zero."""
    usual = next(r.start(scene) for r in RELAXATIONS if r.name == reason.name)
    return abs(reason.needed - reason.limit) / (abs(reason.limit) or usual)


def _sensible(scene: GraspScene) -> Iterator[Relaxation]:
    for relaxation in RELAXATIONS:
        if relaxation.name == "mass" and (isinstance(scene.gravity, NoGravity) or scene.object.mass == 0):
            continue
        if relaxation.name == "tilt balance" and not _balances_tilt(scene):
            continue
        if relaxation.name == "room at the palm" and scene.palm is None:
            continue
        if relaxation.name == "strain" and scene.finger.strain_limit is None:
            continue
        yield relaxation


def _balances_tilt(scene: GraspScene) -> bool:
    gravity = scene.gravity
    return isinstance(gravity, OutOfPlaneGravity) and gravity.tilt == "balance" and scene.object.mass > 0
