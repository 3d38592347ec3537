"""Contacts that pass on to the next face or corner of the object: each problem retains those of its start."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from numpy.typing import NDArray

from continuum_grasp.grasp.problem.solver_run import Attempt, GraspSolverRun
from continuum_grasp.model.surfaces.surface import Feature
from continuum_grasp.scene.grasp import GraspScene

Array = NDArray[Any]

EDGE = 1e-4
"""Part of a face or corner, from its end, within which a contact counts as at its end: the barrier of IPOPT leaves a
gap to bounds."""


def neighbors(
    scene: GraspScene, solver: GraspSolverRun, attempt: Attempt
) -> Iterator[tuple[dict[str, Feature], Array]]:
    """Features and unknowns with one contact passed on to the face or corner that it is at the end of."""
    parts = scene.object.parts
    for contact in solver.problem.spec.contacts:
        if contact.surface.is_smooth or contact.finger < 0:
            continue
        place = solver.problem.x.at[f"place, {contact.name}"]
        part = parts[attempt.start.contacts[contact.name].part]
        ring, now = contact.surface.features(part), attempt.features[contact.name]
        if len(ring) < 2:
            continue
        # A contact's place is its position along a face and the angle of its normal, of which on a face the first is
        # free, on a corner the second.
        at, index = attempt.x[place], ring.index(now)
        face = now.upper[0] > now.lower[0]
        share = at[0] if face else (at[1] - now.lower[1]) / (now.upper[1] - now.lower[1])
        for end, step in ((0.0, -1), (1.0, 1)):
            if abs(share - end) < EDGE:
                new = ring[(index + step) % len(ring)]
                x = attempt.x.copy()
                if face:  # on to a corner
                    x[place] = 0.0, new.upper[1] if step < 0 else new.lower[1]
                else:
                    x[place] = 1.0 - end, new.lower[1]
                yield {**attempt.features, contact.name: new}, x
