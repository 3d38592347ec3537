"""The numbers of reasons, found once more by linear programming at the posture that the optimizer ended at.

Where shapes and places are given, every equation of a grasp is linear in tensions and contact forces. So the least
tension, friction coefficient or normal force limit, the greatest mass, and the least moment that tilts, are optima of
linear problems (LP; SOCP out of the plane), which need no start and know no local optima. Nothing is
shared with the optimizer: the equations are the certificate's, virtual work of one tension or contact force at a time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.check import EQUILIBRIUM
from continuum_grasp.grasp.certificate.recomputed import (
    FingerLoad,
    RecomputedFinger,
    RecomputedGrasp,
    across,
    gravity_vector,
)
from continuum_grasp.grasp.quality.lp import Cones, LPOutcome, solve_socp
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity

Array = NDArray[Any]

OFF = 0.2 * EQUILIBRIUM
"""By what part equations may be off: a given posture is never exact, and with many elements there are more equations
than forces. Well below what the certificate lets pass."""
PRECISION = 1e-6
"""Precision of a friction coefficient, relative."""


@dataclass(frozen=True)
class Confirmed:
    """The numbers of a reason, by LP."""

    amount: float  # least amount by which the limit must be relaxed at the posture
    arrays: dict[str, Array]  # the posture with the tensions and contact forces of that amount


def least_amount(name: str, scene: GraspScene, arrays: Mapping[str, Any], amount: float) -> Confirmed | None:
    """By how much the limit of a relaxation must be relaxed at least at a posture, and the forces that then hold.

    The scene has its limit as it is; the ``arrays``, as `continuum_grasp.grasp.certify` takes them, are those of the
    grasp that there is with the limit relaxed by ``amount``. None where no LP applies, for limits of the shape, and
    where it fails.
    """
    if name not in ("tension", "friction", "normal force", "mass", "tilt balance"):
        return None
    statics = PostureStatics(scene, arrays)
    if name == "friction":
        found, least = statics.least_friction(amount)
    else:
        found = statics.least(name)
        unit = {"mass": 1.0, "tilt balance": statics.moment}.get(name, statics.force)
        least = max(0.0, float(found.x[-1])) * unit
    if not found.optimal:
        return None
    tensions, forces = np.split(found.x[:-1] * statics.force, [statics.tensions])
    changed = {key: np.asarray(value) for key, value in arrays.items()} | {"contact_forces": forces.reshape(-1, 3)}
    for setup, pair in zip(scene.setups, tensions.reshape(-1, 2), strict=True):
        changed[f"{setup.name}.tensions"] = pair
    return Confirmed(least, changed)


class PostureStatics:
    """Equilibrium of fingers and object at a posture: rows @ x + (1 - share) * weight = right, for the mass
    (1 - share) times the scene's, and the LPs or SOCPs over x and an amount z, which comes last.

    x (n,) holds the tensions of finger after finger, left and right, then N, f and lift of contact after contact, all
    in units of ``force``. Every row is a part of the greatest moment or force in play, as in the certificate.
    """

    def __init__(self, scene: GraspScene, arrays: Mapping[str, Any]) -> None:
        grasp = RecomputedGrasp(scene, arrays)
        force = float(np.abs(grasp.forces).max(initial=0.0)) or grasp.force_scale  # what holds, not what was too heavy
        self.force, self.moment = force, force * grasp.size  # [N], [N m]
        self.tensions = 2 * len(grasp.fingers)
        size = self.tensions + 3 * len(grasp.contacts)
        columns = {contact.name: self.tensions + 3 * k for k, contact in enumerate(grasp.contacts)}
        blocks = [_finger_rows(grasp, f, k, columns, size, force) for k, f in enumerate(grasp.fingers)]
        # The moment that the lifts leave (2, n), as a part of `moment`; zero where the scene ignores the tilt.
        in_plane, out_of_plane, self.tilt = _object_rows(grasp, columns, size)
        gravity = scene.gravity
        lifted = scene.object.mass * gravity.magnitude / force if isinstance(gravity, OutOfPlaneGravity) else 0.0
        weight = [*(scene.object.mass * gravity_vector(gravity) / force), 0.0, -lifted]
        count = sum(len(block[0]) for block in blocks)
        self.rows = np.concatenate([*(block[0] for block in blocks), in_plane, out_of_plane])  # (m, n)
        self.weight = np.concatenate([np.zeros(count), weight])  # (m,)
        self.right = np.concatenate([*(block[1] for block in blocks), np.zeros(4)])  # (m,)
        self.low, self.high = _bounds(grasp, size, force)  # (n,), without those of friction cones
        own = [*(f.tensions for f in grasp.fingers), *(grasp.forces[c.index] for c in grasp.contacts)]
        self.own = np.concatenate(own) / force  # (n,) the stored tensions and forces
        self.friction = np.array([contact.friction for contact in grasp.contacts], dtype=float)
        self.share = 1.0 - scene.contacts.reserve  # of each cone that may be used
        self.normals = np.arange(self.tensions, size, 3)
        self._cuts: list[tuple[int, Array]] | None = None

    def least(self, relaxed: str = "", added: float = 0.0) -> LPOutcome:
        """Least amount z of a ``relaxed`` limit for which x satisfies everything, with ``added`` to all friction
        coefficients: z is added to upper limits of tensions or normal forces, is the part of the mass that is too
        much, or the norm of the tilting moment.
        """
        tilted, size = relaxed == "tilt balance", self.own.size
        pulling = np.flatnonzero(self.high[: self.tensions] > 0.0)
        raised = {"tension": pulling, "normal force": self.normals}.get(relaxed, pulling[:0])
        lighter = -self.weight if relaxed == "mass" else np.zeros(len(self.rows))
        spare = np.zeros((raised.size, size + 1))
        spare[np.arange(raised.size), raised], spare[:, -1] = 1.0, -1.0
        rows = np.concatenate([np.column_stack([self.rows, lighter]), np.column_stack([self.tilt, np.zeros(2)]), spare])
        # Equations hold to a tolerance, as ranges: a stored posture solves them to rounding only.
        middle = np.append(self.right - self.weight, [0.0, 0.0])
        off = np.append(np.full(len(self.rows), OFF), [np.inf if tilted else OFF] * 2)
        lower, upper = (
            np.append(middle - off, np.full(raised.size, -np.inf)),
            np.append(middle + off, self.high[raised]),
        )
        highest = np.append(self.high, 1.0 if relaxed == "mass" else np.inf)
        highest[raised] = np.inf
        cost, cones = np.append(np.zeros(size), 1.0), self._cones(self.share * (self.friction + added), tilted)
        return solve_socp(cost, rows, lower, upper, np.append(self.low, 0.0), highest, cones)

    def least_friction(self, amount: float) -> tuple[LPOutcome, float]:
        """The least friction coefficient that is to be added, and the forces, next to an ``amount`` that is enough, by
        bisection: force and coefficient multiply, so that only with a given coefficient it is an LP.
        """
        # The amount found may be rounding too small for its own posture.
        for more in (1e-5, 1e-3, 1e-1):
            high = amount * (1.0 + more)
            best = self.least(added=high)
            if best.optimal:
                break
        low, guess = 0.0, amount * (1.0 - 1e-5)
        while best.optimal and high - low > PRECISION * (high + float(self.friction.max(initial=0.0))):
            found = self.least(added=guess)
            if found.optimal:
                high, best = guess, found
            elif found.status == "infeasible":
                low = guess
            else:
                return found, high
            guess = 0.5 * (low + high)
        return best, high

    def _cones(self, friction: Array, tilted: bool) -> Cones:
        count, size = self.normals.size, self.own.size
        matrix, width = np.zeros((count + tilted, 2, size + 1)), np.zeros((count + tilted, size + 1))
        for k, n in enumerate(self.normals):
            # |(friction, lift)| <= mu N; a lift that must be zero takes no part.
            matrix[k, 0, n + 1] = 1.0
            matrix[k, 1, n + 2] = float(self.high[n + 2] > 0.0)
            width[k, n] = friction[k]
        if tilted:
            matrix[-1, :, :-1] = self.tilt
            width[-1, -1] = 1.0
        cones = Cones.made(matrix, np.zeros((count + tilted, 2)), width, np.zeros(count + tilted))
        if self._cuts is not None:  # tangent planes that were found hold for every coefficient
            cones.cuts = self._cuts
        self._cuts = cones.cuts
        return cones


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
