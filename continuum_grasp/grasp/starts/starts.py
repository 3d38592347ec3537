"""Starting points for the search: postures that touch, from geometry alone (numpy only).

For each pose of the object that is tried, the postures of every finger are found on their own, combined, and ranked by
how nearly contact forces and tensions within their limits could balance them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.basins import Basins, Scored, is_scanned
from continuum_grasp.grasp.starts.force import contact_forces
from continuum_grasp.grasp.starts.spread import spread_order
from continuum_grasp.grasp.starts.supports import object_poses, support_contacts
from continuum_grasp.grasp.starts.values import ContactStart, FingerStart, Start
from continuum_grasp.grasp.starts.weighing import NEARLY_BALANCED, Weighed, Weighing
from continuum_grasp.scene.grasp import GraspScene

Array = NDArray[Any]

_STEP = 1e-9
"""Part of the length within which a curvature that steps changes: interpolation needs increasing knots."""


def make_starts(scene: GraspScene, on: frozenset[str], count: int) -> list[Start]:
    """Starting points with the contacts wanted, ``on`` by name: those of fingers, and walls and pegs.

    There are ``count`` of them at most, the most promising first, then such that differ from those before; where all
    fingers touch with their tips alone, so many of sets that are bent into balance, and so many of others; none where a
    finger reaches nothing. Those labeled "scan" touch everywhere they should without penetration; "near" ones do so
    as nearly as was found.
    """
    weighing = Weighing(scene, on)
    kinds = zip(
        *(at for k, pose in enumerate(object_poses(scene, on)) if (at := weighing.at_pose(pose, k))), strict=True
    )
    chosen = []
    for found in kinds:
        rows = [(at, row) for at in found for row in range(len(at.score))]
        score, features = (
            np.concatenate(part) for part in zip(*((at.score, at.features) for at in found), strict=True)
        )
        chosen.append([_as_start(weighing, *rows[k]) for k in spread_order(score, features, count)])
    return [start for rank in zip_longest(*chosen) for start in rank if start is not None]


def basin_starts(scene: GraspScene, on: frozenset[str]) -> tuple[list[Start], Basins] | None:
    """Starts with the contacts ``on`` by name that stand for the basins of an exhaustive scan, the most
    promising first; None where postures are not of one parameter (see `is_scanned`).
    """
    if not is_scanned(scene, on):
        return None
    basins = Basins(scene, on)
    return _starts_of(basins, basins.found()), basins


def held_still(scene: GraspScene, on: frozenset[str]) -> GraspScene | None:
    """The scene of one finger with object and base held where it has them, or as near to that as the contacts ``on`` by
    name allow, where its postures are scanned; None where nothing may move, or nothing is scanned.
    """
    (x, y, angle), bases = object_poses(scene, on)[0], dict(scene.named_fingers)
    free = scene.object.free is not None or any(finger.base_free is not None for finger in bases.values())
    held = scene.object.replaced(position=(x, y), angle=angle, free=None)
    still = scene.with_fingers({name: finger.replaced(base_free=None) for name, finger in bases.items()})
    still = still.model_copy(update={"object": held})
    return still if free and is_scanned(still, on) else None


def rebalanced_starts(basins: Basins, scene: GraspScene) -> list[Start]:
    """Starts from the postures of a scan for a scene that differs in mass or in limits of forces alone."""
    return _starts_of(*basins.with_forces(scene))


def _starts_of(basins: Basins, found: Scored | None) -> list[Start]:
    if found is None:
        return []
    weighing = Weighing(basins.scene, basins.on)
    weighing.loads = basins.loads
    none, rows = np.zeros(len(found.score)), np.arange(len(found.score))
    at = Weighed(basins.pose, [found.candidates], [rows], found.left, found.score, none, none, found.forces)
    return [
        replace(_as_start(weighing, at, row), estimate=float(found.estimate[row]), imbalance=float(found.left[row]))
        for row in rows.tolist()
    ]


def _as_start(weighing: Weighing, at: Weighed, row: int) -> Start:
    scene, on = weighing.scene, weighing.on
    fingers: dict[str, FingerStart] = {}
    contacts: dict[str, ContactStart] = {}
    forces: dict[str, tuple[float, float, float]] = {}
    tensions: dict[str, tuple[float, float]] = {}
    loads, place, balanced = weighing.loads, 0, at.forces[row]
    for setup, candidates, index in zip(weighing.setups, at.candidates, at.index, strict=True):
        posture = int(index[row])
        length = setup.finger.rod.length
        knots, bent = candidates.knots[posture], candidates.curvatures[posture]
        # Knots at one place with one curvature are padding; where the curvature steps, the first is moved back.
        retained = np.concatenate([[True], (np.diff(knots) > 1e-9) | (np.abs(np.diff(bent)) > 1e-12)])
        knots, bent = knots[retained], bent[retained]
        knots[:-1] -= _STEP * (np.diff(knots) <= 0.0)
        x, y, angle = candidates.bases[posture].tolist()
        fingers[setup.name] = FingerStart(
            (x, y, angle),
            tuple((candidates.joints[posture] * length).tolist()),
            (int(candidates.sides[posture]),) * len(setup.middles),
            tuple((knots * length).tolist()),
            tuple((bent / length).tolist()),
        )
        names = [n for n in setup.switches if n in on]
        size = len(names) * loads.edges
        forces |= contact_forces(scene, loads, names, balanced[place : place + size])
        tensions[setup.name] = tuple(balanced[place + size : place + size + 2].tolist())
        place += size + 2
        for column, name in enumerate(names):
            point = complex(candidates.points[posture, column])
            contacts[name] = ContactStart(
                int(candidates.parts[posture, column]),
                (point.real, point.imag),
                math.remainder(candidates.angles[posture, column], math.tau),
            )
    touched = support_contacts(scene, at.pose, on)
    forces |= contact_forces(scene, loads, list(touched), balanced[place:])
    contacts |= touched
    estimate = sum(map(sum, tensions.values())) if at.left[row] < NEARLY_BALANCED else math.nan
    label = "near" if at.wrong[row] > 0.0 else "scan"
    return Start(label, at.pose, fingers, contacts, forces, tensions, estimate, doubt=float(at.score[row]))
