"""Verification of a grasp by numpy alone, from its stored numbers; nothing is shared with the optimiser.

The backbone is integrated anew from the curvature profile. The finger's equilibrium is tested by virtual
work: the potential of bending, weight, tendons and contact forces must be stationary in the bending
coordinates, its gradient taken by complex steps. Normals, contact points and gaps are recomputed, never taken
from the result on trust.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.model_error import ModelError, model_error
from continuum_grasp.grasp.recomputed import RecomputedGrasp, across
from continuum_grasp.grasp.stability import Stability, contact_stability
from continuum_grasp.scene.grasp import GraspScene, OutOfPlaneGravity, PlanarGravity

__all__ = ["Certificate", "Check", "certify"]

Array = NDArray[Any]

EQUILIBRIUM = 1e-6
"""Limit of moment and force residuals, as a part of the greatest moment or force in play."""
GAP = 1e-6
"""Limit of contact gaps, stored positions and slopes, as a part of the finger's length (slopes: rad)."""
PENETRATION = 1e-4
"""Limit of the dense backbone's penetration, as a part of the finger's length."""
LIMIT = 1e-6
"""By what part of it a limit may be exceeded."""

WORDS = ("family", "contact_names")
"""Stored arrays that hold no numbers."""


@dataclass(frozen=True)
class Check:
    """One verified property.

    Attributes
    ----------
    name : str
        What is checked.
    value, limit : float
        What was found and the most that passes; both in ``unit``.
    unit : str
        ``1`` where the value is relative to ``relative_to``.
    relative_to : str
        What the value was divided by.
    """

    name: str
    value: float
    limit: float
    unit: str = "1"
    relative_to: str = ""

    @property
    def passed(self) -> bool:
        """Whether the value is within the limit; NaN is not."""
        return bool(self.value <= self.limit)


@dataclass(frozen=True)
class Certificate:
    """What an independent recomputation says about a grasp.

    Attributes
    ----------
    checks : tuple of Check
        Every property that must hold.
    friction_margin : float
        Least of 1 - |friction force| / (friction coefficient * normal force) over the contacts; positive: no
        contact is about to slip.
    model_error : ModelError
        What the curvature family leaves out. Not an error of the solution, and no check: it falls with the
        number of elements.
    stability : Stability
        Second-order test.
    """

    checks: tuple[Check, ...]
    friction_margin: float
    model_error: ModelError
    stability: Stability

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)

    @property
    def failed(self) -> tuple[Check, ...]:
        """The checks that did not pass."""
        return tuple(check for check in self.checks if not check.passed)

    def __getitem__(self, name: str) -> Check:
        for check in self.checks:
            if check.name == name:
                return check
        raise KeyError(name)


def certify(scene: GraspScene, arrays: Mapping[str, Any]) -> Certificate:
    """Verify a grasp from its stored numbers.

    Parameters
    ----------
    scene : GraspScene
    arrays : mapping
        As `continuum_grasp.grasp.GraspResult.arrays` gives and a run folder stores: ``family``, ``q``,
        ``lengths``, ``tip_curvature``, ``tensions``, ``contact_names``, ``contact_positions``,
        ``contact_normals``, ``contact_forces`` (normal, friction, lift), ``backbone``.

    Returns
    -------
    Certificate
    """
    numbers = [np.asarray(value, dtype=float) for name, value in arrays.items() if name not in WORDS]
    bad = sum(int((~np.isfinite(value)).sum()) for value in numbers)
    finite = Check("numbers that are not finite", float(bad), 0.0)
    if bad:
        length = scene.finger.rod.length
        unknown = Stability(False, float("nan"), 0)
        return Certificate((finite,), float("nan"), ModelError({}, length, float("nan")), unknown)
    return _Verification(scene, arrays).certificate(finite)


class _Verification(RecomputedGrasp):
    """The checks."""

    def certificate(self, finite: Check) -> Certificate:
        checks = (
            finite,
            *self.finger_checks(),
            *self.object_checks(),
            *self.contact_checks(),
            *self.clearance_checks(),
            *self.limit_checks(),
        )
        pairs = {name: (self.normals[name], self.world_forces[name]) for name in self.names}
        stability = contact_stability(self.scene, self.rod, self.ends, pairs)
        return Certificate(checks, self.friction_margin(), model_error(self), stability)

    def finger_checks(self) -> Iterator[Check]:
        step = 1e-30
        worst = 0.0
        stiffness = self.finger.rod.stiffness
        bent = np.abs(self.rod.curvature(self.ends) - self.rod.rest).max()
        scale = max(abs(self.tip_moment()), stiffness * bent)
        for i in range(self.q.size):
            q = self.q.astype(complex)
            q[i] += 1j * step
            slope = self.potential(q).imag / step
            reach = np.abs(self.rod.edge_angle(self.curvature_ends(q)).imag).max() / step
            worst = float(np.maximum(worst, abs(slope) / reach))
        yield Check("finger equilibrium", worst / scale, EQUILIBRIUM, "1", f"{scale:.4g} N m")
        if self.family == "matched_clothoid":
            moment = self.tip_moment() + (self.couple("tip") if "tip" in self.names else 0.0)
            gap = stiffness * (self.tip_curvature - self.rod.rest[-1]) - moment
            yield Check("tip moment balance", abs(gap) / scale, EQUILIBRIUM, "1", f"{scale:.4g} N m")
        yield Check("element lengths", abs(self.lengths.sum() / self.total - 1), LIMIT, "1", f"{self.total:.4g} m")
        stored = self.stored_backbone
        x = np.interp(stored[:, 0], self.rod.edges, self.points[:, 0])
        y = np.interp(stored[:, 0], self.rod.edges, self.points[:, 1])
        off = np.hypot(stored[:, 1] - x, stored[:, 2] - y).max()
        yield Check("stored backbone", off / self.total, 1e-5, "1", f"{self.total:.4g} m")

    def object_checks(self) -> Iterator[Check]:
        thing, gravity = self.scene.object, self.scene.gravity
        force, turn = np.zeros(2), 0.0
        if isinstance(gravity, PlanarGravity):
            force = thing.mass * np.asarray(gravity.vector)
        for name, load in self.world_forces.items():
            arm = thing.radius * self.normals[name]
            force = force - load
            turn -= arm[0] * load[1] - arm[1] * load[0]
        scale = self.force_scale
        yield Check("object force balance", float(np.abs(force).max()) / scale, EQUILIBRIUM, "1", f"{scale:.4g} N")
        arm_scale = scale * thing.radius
        yield Check("object moment balance", abs(turn) / arm_scale, EQUILIBRIUM, "1", f"{arm_scale:.4g} N m")
        lift = self.forces[:, 2]
        weight = thing.mass * gravity.magnitude if isinstance(gravity, OutOfPlaneGravity) else 0.0
        yield Check("object lift balance", abs(lift.sum() - weight) / scale, EQUILIBRIUM, "1", f"{scale:.4g} N")
        if isinstance(gravity, OutOfPlaneGravity) and gravity.tilt == "balance":
            tilt = sum(f * self.normals[name] for f, name in zip(lift, self.names, strict=True))
            yield Check("object tilt balance", float(np.abs(tilt).max()) / scale, EQUILIBRIUM, "1", f"{scale:.4g} N")

    def contact_checks(self) -> Iterator[Check]:
        scale = self.force_scale
        limit = self.scene.contacts.normal_force_max
        for k, name in enumerate(self.names):
            n, f, lift = self.forces[k]
            over = float(np.hypot(f, lift) - self.friction(name) * n) / scale
            yield Check(f"friction cone, {name}", over, LIMIT, "1", f"{scale:.4g} N")
            yield Check(f"normal force, {name}", max(-n, n - limit) / limit, LIMIT, "1", f"{limit:.4g} N")
            where = self.centre + self.scene.object.radius * self.normals[name]
            off = [
                (self.stored_positions[k] - where) / self.total,
                self.stored_normals[k] - self.normals[name],
            ]
            yield Check(f"stored contact, {name}", float(np.abs(off).max()), GAP, "1", f"{self.total:.4g} m")
        for name, edge in (("middle", self.middle_edge), ("tip", -1)):
            if name in self.names:
                offset = self.points[edge] - self.centre
                gap = abs(float(np.linalg.norm(offset)) - self.reach) / self.total
                yield Check(f"contact gap, {name}", gap, GAP, "1", f"{self.total:.4g} m")
        if "middle" in self.names:
            offset = self.points[self.middle_edge] - self.centre
            slope = abs(float(across(self.normals["middle"]) @ offset)) / self.reach
            yield Check("contact tangency, middle", slope, GAP, "rad")
        if "palm" in self.names and self.scene.palm is not None:
            gap = abs(self.scene.palm.height(self.scene.object.position) - self.scene.object.radius) / self.total
            yield Check("contact gap, palm", gap, 2 * GAP, "1", f"{self.total:.4g} m")

    def clearance_checks(self) -> Iterator[Check]:
        distance = np.linalg.norm(self.points - self.centre, axis=1)
        depth = float((self.reach - distance).max()) / self.total
        yield Check("penetration into the object", depth, PENETRATION, "1", f"{self.total:.4g} m")
        if self.scene.palm is not None:
            height = (self.points - np.asarray(self.scene.palm.point)) @ np.asarray(self.scene.palm.normal)
            needed = np.where(
                np.arange(height.size) > self.middle_edge,
                self.finger.thickness_radius,
                min(0.0, float(height[0])),
            )
            yield Check(
                "penetration into the palm",
                float((needed - height).max()) / self.total,
                PENETRATION,
                "1",
                f"{self.total:.4g} m",
            )

    def limit_checks(self) -> Iterator[Check]:
        tendons = self.finger.tendons
        if tendons is not None:
            most, least = tendons.max_tension, tendons.min_tension
            over = max(float(self.tensions.max() - most), float(least - self.tensions.min())) / most
            yield Check("tendon tension", over, LIMIT, "1", f"{most:.4g} N")
        low, high = self.scene.middle_bounds
        at = float(self.rod.joints[self.scene.elements_before_middle])
        yield Check(
            "middle contact position",
            max(low - at, at - high) / self.total,
            LIMIT,
            "1",
            f"{self.total:.4g} m",
        )
        kappa = float(np.abs(self.ends).max())
        if np.isfinite(self.finger.curvature_limit):
            most = self.finger.curvature_limit
            yield Check("bending strain", kappa / most - 1, LIMIT, "1", f"{most:.4g} 1/m")
        bends = np.abs(0.5 * self.lengths * self.ends.sum(axis=1)).max()
        most = self.scene.bending_range
        yield Check("bending range", float(bends) / most - 1, LIMIT, "1", f"{most:.4g} rad")
