"""All statics of a grasp at one posture, as rows that are linear in its tensions and contact forces.

The fingers' rows are the certificate's own: virtual work of one tension or contact force at a time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.recomputed import (
    FingerLoad,
    RecomputedFinger,
    RecomputedGrasp,
    across,
    gravity_vector,
)
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity

Array = NDArray[Any]


@dataclass(frozen=True)
class PostureStatics:
    """Equilibrium of fingers and object at a posture: rows @ x + (1 - share) * weight = right, for the mass
    (1 - share) times the scene's.

    x holds the tensions of finger after finger, left and right, then N, f and lift of contact after contact, all in
    units of ``force``. Every row is a part of the greatest moment or force in play, as in the certificate.
    """

    rows: Array  # (m, n)
    weight: Array  # (m,)
    right: Array  # (m,)
    tilt: Array  # (2, n) moment that the lifts leave, as a part of `moment`; zero where the scene ignores the tilt
    least: Array  # (n,) bounds without those of friction cones
    most: Array  # (n,)
    tensions: int  # number of tensions
    friction: Array  # (C,) coefficients
    share: float  # of each cone, which the reserve leaves
    force: float  # [N]
    moment: float  # [N m]
    own: Array  # (n,) the stored tensions and forces

    @classmethod
    def of(cls, scene: GraspScene, arrays: Mapping[str, Any]) -> PostureStatics:
        """The statics of a scene at the posture of a grasp's stored numbers."""
        grasp = RecomputedGrasp(scene, arrays)
        force = float(np.abs(grasp.forces).max(initial=0.0)) or grasp.force_scale  # what holds, not what was too heavy
        moment = force * grasp.size
        first, size = 2 * len(grasp.fingers), 2 * len(grasp.fingers) + 3 * len(grasp.contacts)
        columns = {contact.name: first + 3 * k for k, contact in enumerate(grasp.contacts)}
        blocks = [_finger_rows(grasp, f, k, columns, size, force) for k, f in enumerate(grasp.fingers)]
        in_plane, out_of_plane, tilt = _object_rows(grasp, columns, size)
        weight_of = np.concatenate([scene.object.mass * gravity_vector(scene.gravity) / force, [0.0]])
        gravity = scene.gravity
        lifted = scene.object.mass * gravity.magnitude / force if isinstance(gravity, OutOfPlaneGravity) else 0.0
        count = sum(len(block[0]) for block in blocks)
        rows = np.concatenate([*(block[0] for block in blocks), in_plane, out_of_plane])
        weight = np.concatenate([np.zeros(count), weight_of, [-lifted]])
        right = np.concatenate([*(block[1] for block in blocks), np.zeros(4)])
        least, most = _bounds(grasp, size, force)
        own = np.concatenate([*(f.tensions for f in grasp.fingers), *(grasp.forces[c.index] for c in grasp.contacts)])
        friction = np.array([contact.friction for contact in grasp.contacts], dtype=float)
        share = 1.0 - scene.contacts.reserve
        return cls(rows, weight, right, tilt, least, most, first, friction, share, force, moment, own / force)

    @property
    def balances_tilt(self) -> bool:
        """Whether the moment that the lifts leave has to be zero."""
        return bool(self.tilt.any())


def _finger_rows(
    grasp: RecomputedGrasp, finger: RecomputedFinger, index: int, columns: Mapping[str, int], size: int, force: float
) -> tuple[Array, Array]:
    """Rows and right-hand side of a finger's equilibrium: the virtual work of each cause alone."""
    loads, tensions = finger.loads, finger.tensions
    scale = finger.moment_scale(max((float(np.hypot(*load.force)) for load in loads), default=0.0))

    def work(pulls: tuple[float, float] = (0.0, 0.0), load: FingerLoad | None = None) -> Array:
        finger.loads, finger.tensions = [] if load is None else [load], np.asarray(pulls)
        slopes = finger.virtual_work()
        if not finger.matches_tip:
            return slopes
        # The tip's curvature is no free coordinate: it is set by the balance of moments there.
        bent = float(finger.shape.moment(np.array(finger.length)))
        return np.append(slopes, bent - finger.tip_moment - finger.tip_couple)

    try:
        alone = work()
        rows = np.zeros((alone.size, size))
        for side, pulls in enumerate(((force, 0.0), (0.0, force))):
            rows[:, 2 * index + side] = work(pulls) - alone
        for contact in grasp.of(finger):
            at = columns[contact.name]
            # Friction acts on the skin: a couple by its arm, half the thickness.
            for k, direction, couple in (
                (0, contact.normal, 0.0),
                (1, across(contact.normal), -contact.radius * force),
            ):
                load = FingerLoad(contact.name, contact.joint, force * direction, couple)
                rows[:, at + k] = work(load=load) - alone
    finally:
        finger.loads, finger.tensions = loads, tensions
    return rows / scale, -alone / scale


def _object_rows(grasp: RecomputedGrasp, columns: Mapping[str, int], size: int) -> tuple[Array, Array, Array]:
    """Force and moment, lift, and tilt of the object, as parts of the unit of force and of that times the size."""
    in_plane, lift, tilt = np.zeros((3, size)), np.zeros((1, size)), np.zeros((2, size))
    gravity = grasp.scene.gravity
    balances = isinstance(gravity, OutOfPlaneGravity) and gravity.tilt == "balance"
    for contact in grasp.contacts:
        at, arm = columns[contact.name], (contact.point - grasp.object.com) / grasp.size
        for k, direction in enumerate((contact.normal, across(contact.normal))):
            in_plane[:2, at + k] = -direction
            in_plane[2, at + k] = -(arm[0] * direction[1] - arm[1] * direction[0])
        lift[0, at + 2] = 1.0
        if balances:
            tilt[:, at + 2] = arm
    return in_plane, lift, tilt


def _bounds(grasp: RecomputedGrasp, size: int, force: float) -> tuple[Array, Array]:
    """Least and most of tensions and forces; friction forces have none of their own."""
    least, most = np.zeros(size), np.zeros(size)
    # A tendon that is not there keeps zero as both bounds, and so does a lift in the plane.
    for k, finger in enumerate(grasp.fingers):
        tendons, used = finger.setup.tendons, finger.finger.tendons_used
        for side, name in enumerate(("left", "right")):
            if used in ("both", name):
                least[2 * k + side], most[2 * k + side] = tendons.min_tension / force, finger.setup.max_tension / force
    first = 2 * len(grasp.fingers)
    lifted = isinstance(grasp.scene.gravity, OutOfPlaneGravity)
    for k, contact in enumerate(grasp.contacts):
        at = first + 3 * k
        most[at] = contact.normal_force_max / force
        least[at + 1], most[at + 1] = -np.inf, np.inf
        if lifted:
            least[at + 2], most[at + 2] = -np.inf, np.inf
    return least, most
