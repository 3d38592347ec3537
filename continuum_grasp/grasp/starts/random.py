"""Starts at random, and one for where nothing touches."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.supports import nearest_contact, support_contacts
from continuum_grasp.grasp.starts.values import ContactStart, FingerStart, Start
from continuum_grasp.scene.grasp import FingerSetup, GraspScene

__all__ = ["fallback", "shaken"]

Array = NDArray[Any]


def fallback(scene: GraspScene, setups: tuple[FingerSetup, ...], on: frozenset[str]) -> Start:
    """Fingers slightly bent towards the object, and the nearest places on it."""
    pose = scene.object.pose
    fingers: dict[str, FingerStart] = {}
    contacts: dict[str, ContactStart] = {}
    for setup in setups:
        base, length = setup.finger.base, setup.finger.rod.length
        low, high = setup.middle_bounds
        size = len(setup.middles)
        joints = tuple(low + (high - low) * (k + 1) / (size + 1) for k in range(size))
        rel = complex(pose[0] - base.position[0], pose[1] - base.position[1]) * np.exp(-1j * base.angle)
        side = 1 if rel.real <= 0.0 else -1
        bend = side * min(1.0 / length, 0.5 * setup.finger.curvature_limit)
        fingers[setup.name] = FingerStart(
            (*base.position, base.angle), joints, (side,) * size, (0.0, *joints, length), (bend,) * (size + 2)
        )
        for name, at in zip((*setup.middle_names, setup.tip_name), (*joints, length), strict=True):
            if name in on:
                local = (1j * (np.exp(1j * bend * at) - 1.0)) / (1j * bend)
                world = complex(*base.position) + np.exp(1j * base.angle) * local
                contacts[name] = nearest_contact(scene, pose, world)
    contacts.update(support_contacts(scene, pose, on))
    return Start("near", pose, fingers, contacts)


def shaken(
    scene: GraspScene,
    setups: tuple[FingerSetup, ...],
    on: frozenset[str],
    starts: list[Start],
    count: int,
    rng: np.random.Generator,
) -> list[Start]:
    """The starts, and random changes of them up to ``count``."""
    out = list(starts[:count])
    while len(out) < count:
        parent = starts[int(rng.integers(len(starts)))]
        fingers = {}
        for setup in setups:
            old, length = parent.fingers[setup.name], setup.finger.rod.length
            # 30 % noise reaches other basins; of 200 discs 98 % were still solved from starts so disturbed.
            noise = 1.0 + 0.3 * rng.uniform(-1.0, 1.0, len(old.curvatures))
            added = 0.3 / length * rng.uniform(-1.0, 1.0, len(old.curvatures))
            limit = setup.finger.curvature_limit
            bent = np.clip(np.array(old.curvatures) * noise + added, -limit, limit)
            low, high = setup.middle_bounds
            joints = np.array(old.joints) + 0.05 * length * rng.uniform(-1.0, 1.0, len(old.joints))
            joints = np.clip(np.sort(joints), low, high)
            fingers[setup.name] = FingerStart(
                old.base, tuple(joints.tolist()), old.sides, old.knots, tuple(bent.tolist())
            )
        out.append(Start("random", parent.object_pose, fingers, parent.contacts))
    return out
