"""Starting points for the search: postures that touch, from geometry alone (numpy only).

For each pose of the object that is tried, the postures of every finger are found on their own, combined, and ranked by
how nearly contact forces and tensions within their limits could balance them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts_candidates import Candidates, find_candidates
from continuum_grasp.grasp.starts_combine import combine
from continuum_grasp.grasp.starts_force import (
    Block,
    Loads,
    contact_forces,
    finger_block,
    loads_of,
    support_block,
)
from continuum_grasp.grasp.starts_order import spread_order
from continuum_grasp.grasp.starts_poses import base_poses, object_poses
from continuum_grasp.grasp.starts_random import fallback, shaken
from continuum_grasp.grasp.starts_supports import support_contacts, touching_supports
from continuum_grasp.grasp.starts_values import ContactStart, FingerStart, Start
from continuum_grasp.scene.grasp import FingerSetup, GraspScene

__all__ = ["ContactStart", "FingerStart", "Start", "make_starts", "support_contacts", "touching_supports"]

Array = NDArray[Any]
Pose = tuple[float, float, float]

_STEP = 1e-9
"""Part of the length within which a curvature that steps changes."""


@dataclass(frozen=True)
class _Ranked:
    score: float
    features: Array
    pose: Pose
    rows: tuple[tuple[FingerSetup, Candidates, int], ...]
    near: bool
    forces: Array


def make_starts(scene: GraspScene, on: frozenset[str], count: int, rng: np.random.Generator) -> list[Start]:
    """Starting points with given contacts.

    Parameters
    ----------
    scene : GraspScene
    on : frozenset of str
        Names of the contacts wanted: those of fingers, and walls and pegs.
    count : int
        How many starts.
    rng : numpy.random.Generator
        For poses and starts at random; an equal one gives equal starts.

    Returns
    -------
    list of Start
        ``count`` starts, the most promising first, then such that differ from those before. Their labels: "scan"
        touches everywhere it should and keeps clear; "near" does so as nearly as was found; "random" is one of these,
        changed at random.
    """
    setups = scene.setups
    loads = loads_of(scene)
    ranked: list[_Ranked] = []
    for number, pose in enumerate(object_poses(scene, on)):
        ranked += _at_pose(scene, setups, on, loads, pose, number)
    starts: list[Start] = []
    if ranked:
        order = spread_order(np.array([r.score for r in ranked]), np.stack([r.features for r in ranked]), count)
        starts = [_as_start(scene, on, ranked[k]) for k in order]
    if not starts:
        starts = [fallback(scene, setups, on)]
    return shaken(scene, setups, on, starts, count, rng)


def _at_pose(
    scene: GraspScene, setups: tuple[FingerSetup, ...], on: frozenset[str], loads: Loads, pose: Pose, number: int
) -> list[_Ranked]:
    touched = support_contacts(scene, pose, on)
    supports = support_block(scene, loads, touched, pose)
    found: list[Candidates] = []
    blocks: list[Block] = []
    for setup in setups:
        middles = tuple(name in on for name in setup.middle_names)
        candidates = find_candidates(scene, setup, base_poses(setup, number), pose, middles, setup.tip_name in on)
        if candidates is None:
            return []
        candidates = candidates.take(_least_violation(candidates))
        block = finger_block(scene, loads, setup, candidates, pose)
        found.append(candidates)
        blocks.append(block)
    index, left, cost, forces = combine(loads, blocks, supports, [c.features for c in found])
    wrong = np.stack([c.violation[i] for c, i in zip(found, index, strict=True)]).sum(axis=0)
    score = 10.0 * left + cost + 5.0 * np.minimum(wrong, 1.0) + np.where(wrong > 0.0, 1.0, 0.0)
    features = np.concatenate([c.features[i] for c, i in zip(found, index, strict=True)], axis=1)
    place = np.array([pose[0] / scene.object.size, pose[1] / scene.object.size, pose[2]])
    return [
        _Ranked(
            float(score[k]),
            np.concatenate([features[k], place]),
            pose,
            tuple((s, c, int(i[k])) for s, c, i in zip(setups, found, index, strict=True)),
            bool(wrong[k] > 0.0),
            forces[k],
        )
        for k in range(len(score))
    ]


def _least_violation(candidates: Candidates) -> Array:
    """Those with nothing in the way, or the few with the least."""
    good = np.flatnonzero(candidates.violation <= 0.0)
    return good if len(good) else np.argsort(candidates.violation, kind="stable")[:4]


def _as_start(scene: GraspScene, on: frozenset[str], ranked: _Ranked) -> Start:
    fingers: dict[str, FingerStart] = {}
    contacts: dict[str, ContactStart] = {}
    forces: dict[str, tuple[float, float, float]] = {}
    tensions: dict[str, tuple[float, float]] = {}
    loads, place = loads_of(scene), 0
    for setup, candidates, row in ranked.rows:
        length = setup.finger.rod.length
        knots, bent = candidates.knots[row], candidates.curvatures[row]
        kept = np.concatenate([[True], (np.diff(knots) > 1e-9) | (np.abs(np.diff(bent)) > 1e-12)])
        knots, bent = knots[kept], bent[kept]
        knots[:-1] -= _STEP * (np.diff(knots) <= 0.0)
        x, y, angle = (float(v) for v in candidates.bases[row])
        fingers[setup.name] = FingerStart(
            (x, y, angle),
            tuple(float(s) * length for s in candidates.joints[row]),
            (int(candidates.sides[row]),) * len(setup.middles),
            tuple(float(s) * length for s in knots),
            tuple(float(k) / length for k in bent),
        )
        names = [n for n in (*setup.middle_names, setup.tip_name) if n in on]
        size = len(names) * loads.edges
        forces |= contact_forces(scene, loads, names, ranked.forces[place : place + size])
        one, two = (float(t) for t in ranked.forces[place + size : place + size + 2])
        tensions[setup.name] = one, two
        place += size + 2
        for column, name in enumerate(names):
            point = complex(candidates.points[row, column])
            contacts[name] = ContactStart(
                int(candidates.parts[row, column]),
                (point.real, point.imag),
                float(np.remainder(candidates.angles[row, column] + np.pi, 2 * np.pi) - np.pi),
            )
    touched = support_contacts(scene, ranked.pose, on)
    forces |= contact_forces(scene, loads, list(touched), ranked.forces[place:])
    contacts |= touched
    return Start("near" if ranked.near else "scan", ranked.pose, fingers, contacts, forces, tensions)
