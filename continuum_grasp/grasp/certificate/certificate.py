"""Verification of a grasp by numpy alone, from its stored numbers; nothing is shared with the optimizer.

The backbones are integrated anew from their curvature profiles. The fingers' equilibrium is tested by virtual
work: the potential of bending, weight, tendons and contact forces must be stationary in the bending
coordinates, its gradient taken by complex steps. Normals, contact points and gaps are recomputed, never taken
from the result on trust. Whether fingers overlap in the plane is checked unless the scene has them at different
heights, and that none passes through itself in any case.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from itertools import combinations
from typing import Any

import numpy as np

from continuum_grasp.base import Array, Summarized, amount_text, check_arguments
from continuum_grasp.grasp.certificate.check import (
    CROSSED,
    CURLED,
    EXACT,
    Check,
    clearance_checks,
    contact_checks,
    mode_check,
    overlap,
    worst,
)
from continuum_grasp.grasp.certificate.held import held_checks
from continuum_grasp.grasp.certificate.model_error import ModelError, model_error
from continuum_grasp.grasp.certificate.out_of_plane import stability_out_of_plane
from continuum_grasp.grasp.certificate.push import push_check
from continuum_grasp.grasp.certificate.recomputed import OF_CONTACTS, OF_FINGER, RecomputedFinger, RecomputedGrasp
from continuum_grasp.grasp.certificate.stability import Stability, contact_stability
from continuum_grasp.scene import FAMILIES, GraspScene


@dataclass(frozen=True)
class Certificate(Summarized):
    """The result of recomputing a grasp independently.

    Attributes
    ----------
    checks : tuple of Check
        Every property that must hold.
    friction_margins : dict of str to float
        1 - |friction force| / (friction coefficient * normal force) of each contact that has friction; positive:
        it is not about to slip; 0 where nothing presses.
    grasp : RecomputedGrasp or None
        The recomputed grasp; None where the stored numbers are no grasp.
    states : int
        Number of sets of friction states with which it was verified.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> certificate = cg.optimize_grasp("configs/grasp/mug_arcs.yaml").certificate
    >>> certificate.passed, certificate.stability.stable, certificate.model_error.small
    (True, True, False)
    >>> certificate["object force balance"].value < certificate["object force balance"].limit
    True
    """

    checks: tuple[Check, ...]
    friction_margins: dict[str, float] = field(default_factory=dict)
    grasp: RecomputedGrasp | None = field(default=None, repr=False, compare=False)
    states: int = 0

    @cached_property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)

    @property
    def acceptable(self) -> bool:
        """Whether it is what the scene asks for: every check passed, and stable where that is required."""
        if self.grasp is None or not self.passed:
            return False
        return self.grasp.scene.stability == "ignore" or self.stability.stable

    @property
    def failed(self) -> tuple[Check, ...]:
        """The checks that did not pass."""
        return tuple(check for check in self.checks if not check.passed)

    @property
    def crossed(self) -> frozenset[tuple[str, str]]:
        """Names of the fingers that pass through each other; of one twice, through itself."""
        names = (check.name.split(", ") for check in self.failed)
        return frozenset((fingers[0], fingers[-1]) for name, *fingers in names if name in (CURLED, CROSSED))

    def data(self, *, error: bool = True) -> dict[str, Any]:
        """The certificate as plain data, with the model's ``error``, for which exact rods are solved, or without."""
        numbers = {
            "passed": self.passed,
            "checks": [{**asdict(check), "passed": check.passed} for check in self.checks],
            "friction_margin": self.friction_margin,
            "friction_states": self.states,
            "stability": self.stability.data(),
            "overlap_of_fingers": self.overlap,
            "push": self.push if self._asked else None,
        }
        if error:
            bound = self.model_error
            numbers["model_error"] = asdict(bound) | {"found": bound.found, "small": bound.small, "limit": bound.limit}
        return numbers

    @property
    def friction_margin(self) -> float:
        """Least of the friction margins; NaN where nothing is known."""
        if self.grasp is None:
            return float("nan")
        return min(self.friction_margins.values(), default=0.0)

    @cached_property
    def stability(self) -> Stability:
        """Second-order test, in space where the fingers have sections; computed when first asked for."""
        if self.grasp is None:
            return Stability(False, float("nan"), 0)
        return contact_stability(self.grasp).with_space(stability_out_of_plane(self.grasp))

    @cached_property
    def push(self) -> float:
        """Greatest push on the object that the grasp bears in every direction, to first order [N]: at constant
        tensions, or with locked tendons if ``disturbances.tendons`` is ``locked``. Zero for an unstable grasp, unless
        the scene ignores stability.
        """
        from continuum_grasp.grasp.quality.response import GraspResponse

        return 0.0 if self.grasp is None else GraspResponse(self.grasp.scene, self.grasp.arrays).push

    @property
    def _asked(self) -> float:
        """Push that the scene requires [N]; zero without one."""
        return 0.0 if self.grasp is None else self.grasp.scene.contacts.push or 0.0

    @cached_property
    def model_error(self) -> ModelError:
        """Error of the curvature family; computed when first asked for.

        Not an error of the solution, and no check: it falls with the number of elements.
        """
        return ModelError({}, float("nan"), float("nan")) if self.grasp is None else model_error(self.grasp)

    @cached_property
    def overlap(self) -> float:
        """Greatest overlap of the bodies of two fingers in the plane [m]; zero where none touch."""
        if self.grasp is None:
            return float("nan")
        return max(0.0, *(overlap(*pair) for pair in combinations(self.grasp.fingers, 2)), 0.0)

    @property
    def summary(self) -> dict[str, Any]:
        """Number of checks, and those that failed."""
        return {"checks": len(self.checks), "failed": [check.name for check in self.failed]}

    def headline(self) -> str:
        """Number of checks that passed."""
        return f"{len(self.checks) - len(self.failed)} of {len(self.checks)} checks passed"

    def pairs(self) -> dict[str, str]:
        """Failed checks, least margin, stability and model error."""
        failed = {"failed": ", ".join(check.name for check in self.failed)} if self.failed else {}
        margin = f"{self.friction_margin:.1%} of the friction cone"
        stable = self.stability.word
        pushed = {"push in any direction": amount_text(self.push, "N", ".3g")} if self._asked else {}
        model = str(self.model_error)
        return {**failed, "least margin": margin, **pushed, "second-order test": stable, "model": model}

    def __getitem__(self, name: str) -> Check:
        for check in self.checks:
            if check.name == name:
                return check
        raise KeyError(name)


@check_arguments
def certify(scene: GraspScene, arrays: Mapping[str, Any]) -> Certificate:
    """Verify a grasp from its stored numbers.

    Parameters
    ----------
    scene : GraspScene
    arrays : mapping
        As `continuum_grasp.grasp.GraspResult.arrays` gives and a run folder stores. For each finger F: ``F.family``,
        ``F.q``, ``F.lengths``, ``F.curvature_shapes``, ``F.tip_curvature``, ``F.tensions``, ``F.base``,
        ``F.backbone``; ``object.pose``; and for the contacts ``contact_names``, ``contact_positions``,
        ``contact_normals``, ``contact_forces`` (normal, friction, lift), ``contact_stations``, ``contact_parts``.

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
    >>> [check.name for check in changed.failed]
    ['finger equilibrium, finger']
    """
    reached = certify_reached(scene, arrays)
    grasp = reached.grasp
    if grasp is None:
        return reached
    with np.errstate(all="ignore"):
        states = tuple(held_checks(grasp, arrays, partial(_recomputed, scene, reached=False)))
    # The first four are of all states together.
    return replace(reached, checks=(*reached.checks, *states), states=max(len(states) - 4, 0))


def certify_reached(scene: GraspScene, arrays: Mapping[str, Any]) -> Certificate:
    """Verify a grasp as it is reached alone: what a search has before postures of other friction states are sought."""
    with np.errstate(all="ignore"):
        checks, grasp = _recomputed(scene, arrays)
        contacts = () if grasp is None else grasp.contacts
        margins = {c.name: c.friction_margin for c in contacts if c.friction > 0.0}
        reached = Certificate(tuple(checks), margins, grasp)
        asked = reached._asked
        return replace(reached, checks=(*checks, push_check(reached.push, asked))) if asked else reached


def _recomputed(
    scene: GraspScene, arrays: Mapping[str, Any], *, reached: bool = True
) -> tuple[list[Check], RecomputedGrasp | None]:
    """All checks of one posture, and what they are made of; None where that cannot be computed. ``reached``: fingers
    were pulled, so that no friction states are stored.
    """
    checks = [
        Check("non-finite numbers", float(_not_finite(scene, arrays)), 0.0),
        Check("missing or misshapen arrays", float(_misfits(scene, arrays, reached=reached)), 0.0),
    ]
    # A fault here stops the rest.
    if not all(check.passed for check in checks):
        return checks, None
    lengths = [length_check(setup.name, setup.finger.rod.length, arrays) for setup in scene.setups]
    if not all(check.passed for check in lengths):
        return [*checks, *lengths], None
    grasp = RecomputedGrasp(scene, arrays)
    checks += [mode_check(grasp), *lengths]
    for finger in grasp.fingers:
        checks += [*equilibrium_checks(finger), *storage_checks(finger), *limit_checks(finger)]
    return [*checks, *_object(grasp), *contact_checks(grasp), *clearance_checks(grasp)], grasp


def _not_finite(scene: GraspScene, arrays: Mapping[str, Any]) -> int:
    """Number of entries of a grasp that are NaN or infinite; the stations of supports are NaN by right."""
    names = [f"{setup.name}.{name}" for setup in scene.setups for name in OF_FINGER]
    names += ["object.pose", *(key for key in OF_CONTACTS if key not in ("contact_names", "contact_stations"))]
    stored = [as_numbers(arrays.get(name, 0.0)) for name in names]
    return sum(int((~np.isfinite(values)).sum()) for values in stored if values is not None)


def _misfits(scene: GraspScene, arrays: Mapping[str, Any], *, reached: bool) -> int:
    """Number of arrays that are missing, misshapen or of another family than the scene's."""

    def shape(name: str) -> tuple[int, ...] | None:
        values = as_numbers(arrays[name]) if name in arrays else None
        return None if values is None else tuple(values.shape)

    names = np.asarray(arrays.get("contact_names", 0.0))
    count = names.size
    parts = as_numbers(arrays.get("contact_parts"))
    wrong = ["contact_names" not in arrays or names.shape != (count,)]
    wrong += [parts is None or not bool(np.isin(parts, np.arange(len(scene.object.parts))).all())]
    expected: dict[str, tuple[int, ...]] = {
        "object.pose": (3,),
        "contact_positions": (count, 2),
        "contact_normals": (count, 2),
        "contact_forces": (count, 3),
        "contact_stations": (count,),
        "contact_parts": (count,),
    }
    for setup in scene.setups:
        prefix, n = f"{setup.name}.", setup.elements
        # Of n elements, at D places each, by M coordinates: all of q, and the tip's curvature where that is none.
        shapes = shape(f"{prefix}curvature_shapes") or ()
        backbone = shape(f"{prefix}backbone")
        coordinates = (shapes[-1] if shapes else 0) - FAMILIES[setup.family].matches_tip
        expected |= {f"{prefix}q": (coordinates,), f"{prefix}lengths": (n,), f"{prefix}tip_curvature": ()}
        expected |= {f"{prefix}tensions": (2,), f"{prefix}base": (3,)}
        wrong += [str(arrays.get(f"{prefix}family")) != setup.family, reached and f"{prefix}friction_states" in arrays]
        wrong += [len(shapes) != 3 or shapes[0] != n or 0 in shapes]
        wrong += [backbone is None or len(backbone) != 2 or backbone[0] < 2 or backbone[1] != 4]
    return sum(wrong) + sum(shape(name) != wanted for name, wanted in expected.items())


def as_numbers(value: Any) -> Any:
    """Stored values as numbers; no value where they are none."""
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return None


def length_check(name: str, total: float, arrays: Mapping[str, Any]) -> Check:
    """Whether the lengths of a finger's elements add up to its own."""
    lengths = np.asarray(arrays[f"{name}.lengths"], dtype=float)
    # Each element without a length counts as an error of one: shapes cannot be integrated then.
    off = worst(abs(lengths.sum() / total - 1), *(1e-9 - lengths / total > 0.0))
    return Check(f"element lengths, {name}", off, EXACT, f"{total:.4g} m")


def equilibrium_checks(finger: RecomputedFinger) -> Iterator[Check]:
    """Equilibrium of a finger in its plane."""
    scale = finger.load_moment
    imbalance = float(np.max(np.abs(finger.virtual_work())))
    yield Check.part(f"finger equilibrium, {finger.name}", imbalance, scale, "N m")
    if finger.matches_tip:
        tip = np.array(finger.length)
        end = finger.lengths.size
        couples = sum(contact.couple for contact in finger.contacts if contact.joint == end)
        gap = float(finger.shape.moment(tip) - finger.shape.actuation(tip)) - couples
        yield Check.part(f"tip moment balance, {finger.name}", abs(gap), scale, "N m")


def storage_checks(finger: RecomputedFinger) -> Iterator[Check]:
    """Stored shape of a finger against the recomputed one."""
    yield Check(f"incomplete curvature shapes, {finger.name}", float(not finger.shape.complete), 0.0)
    stored, length = finger.stored_backbone, finger.length
    s = np.clip(stored[:, 0], 0.0, finger.rod.joints[-1])
    points, angles = finger.rod.at(finger.curvature, s)
    off = worst(
        abs(stored[0, 0]) / length,
        abs(stored[-1, 0] / length - 1.0),
        -float(np.diff(stored[:, 0]).min()) / length,  # stations must increase
        float(np.abs(stored[:, 1:3] - points).max()) / length,
        float(np.abs(stored[:, 3] - angles).max()),
    )
    yield Check(f"stored backbone, {finger.name}", off, EXACT, f"{length:.4g} m")
    off = abs(finger.stored_tip_curvature - float(finger.shape.elastic(np.array(length)))) * length
    yield Check(f"stored tip curvature, {finger.name}", off, EXACT, f"{1 / length:.4g} 1/m")
    off = _beyond(finger.finger.base_bounds, finger.base, length)
    yield Check(f"base, {finger.name}", off, EXACT, f"{length:.4g} m")


def limit_checks(finger: RecomputedFinger) -> Iterator[Check]:
    """Limits of tendons, drives, contacts along a finger, and bends."""
    setup, length = finger.setup, finger.length
    limit, used = setup.tendons.max_tension, finger.finger.tendons_used
    over = [(t - limit, setup.tendons.min_tension - t) for t in finger.tensions]
    if used != "both":  # the tendon that is not there cannot pull
        unused = 1 if used == "left" else 0
        over[unused] = abs(finger.tensions[unused]), 0.0
    yield Check.part(f"tendon tension, {finger.name}", worst(*(v for pair in over for v in pair)), limit, "N")
    if finger.wound is not None and finger.wound.over_torque is not None:
        over_torque, greatest = finger.wound.over_torque
        yield Check.part(f"torque, {finger.name}", over_torque, greatest, "N m")
    if finger.wound is not None and finger.wound.law.pulley:
        yield Check.part(f"tendons of one pulley, {finger.name}", finger.wound.misfit(), limit, "N")
    bounds = dict(zip(setup.middle_names, setup.contact_bounds, strict=True))
    for contact in finger.contacts:
        if contact.name in bounds:
            (low, high), at = bounds[contact.name], finger.joint_position(contact.joint)
            over_length = worst(low - at, at - high)
            yield Check.part(f"position along the finger, {contact.name}", over_length, length, "m")
    allowed = finger.finger.strain_limit
    depth = finger.profile.half_depth
    s = finger.rod.edges
    if allowed is not None and depth is not None:
        # Where the curvature may be greatest: densely, on both sides of every end of a panel.
        strains = [np.abs(finger.shape.curvature(s, tip_side=side)) * depth(s, tip_side=side) for side in (False, True)]
        value = float(np.max(np.concatenate(strains))) / allowed - 1
        yield Check(f"bending strain, {finger.name}", value, EXACT, f"{allowed:.4g}")
    bends = float(np.abs(finger.lengths[:, None] * finger.shape.curvatures).max())
    limit = setup.bending_range
    yield Check(f"bending range, {finger.name}", bends / limit - 1, EXACT, f"{limit:.4g} rad")


def _object(grasp: RecomputedGrasp) -> Iterator[Check]:
    scene = grasp.scene
    body = grasp.scene.object
    size = grasp.size
    yield Check("object pose", _beyond(body.pose_bounds, grasp.pose, size), EXACT, f"{size:.4g} m")
    scale = grasp.force_scale
    force = body.mass * np.asarray(scene.gravity)
    moment = np.zeros(3)
    for contact in grasp.contacts:  # their forces are on what touches the object, lifts on the object
        load = np.array([*contact.force, -contact.lift])
        force = force - load
        moment -= np.cross([*(contact.point - grasp.object.com), 0.0], load)
    yield Check.part("object force balance", float(np.abs(force).max()), scale, "N")
    if scene.upright:  # something else bears what tilts it
        moment = moment[2:]
    yield Check.part("object moment balance", float(np.abs(moment).max()), scale * size, "N m")


def _beyond(bounds: Sequence[tuple[float, float]], pose: Array, length: float) -> float:
    """Distance of a pose outside its bounds, as a part of a length and in radians."""
    over = []
    for value, (low, high), unit in zip(pose, bounds, (length, length, 1.0), strict=True):
        over += [(low - value) / unit, (value - high) / unit]
    return worst(*over)
