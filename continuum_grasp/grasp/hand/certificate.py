"""Verification of a hand's grasp by numpy alone, from its stored numbers; nothing is shared with the optimizer.

Each finger is integrated anew in its plane, and tested there as planar grasps are; its displacement out of the plane
under the contact forces is a quadrature. Places and normals on the object are found anew from the displaced fingers.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from continuum_grasp.base import Array, Summarized, amount_text
from continuum_grasp.grasp.certificate.certificate import (
    as_numbers,
    equilibrium_checks,
    length_check,
    limit_checks,
    storage_checks,
)
from continuum_grasp.grasp.certificate.check import CURLED, EXACT, GUARDED, Check, self_overlap, worst
from continuum_grasp.grasp.certificate.push import push_check
from continuum_grasp.grasp.certificate.recomputed import OF_FINGER
from continuum_grasp.grasp.certificate.space import ASIDE, SpatialStability
from continuum_grasp.grasp.certificate.stability import held_by
from continuum_grasp.grasp.hand.recomputed import (
    HandTouch,
    ObjectTouch,
    RecomputedHand,
    SpatialFinger,
    SupportTouch,
    known_touches,
    of_contacts,
)
from continuum_grasp.grasp.hand.stability import HandResponse, hand_response, hand_stability, points_response
from continuum_grasp.grasp.hand.weights import TurnedContact, borne_push, promised_wrench, turned_contacts
from continuum_grasp.scene import FAMILIES, HandScene

TURNED = ", weight in any direction"
"""Ending of the names of checks that are about a weight of any direction."""
RESTS = 2e-6
"""Limit of the gap between object and palm or table, and of what the object reaches into them, per size of the object
[1]: scenes take it to lie against them up to 1e-6."""


@dataclass(frozen=True)
class HandContact:
    """A contact as it was recomputed.

    Attributes
    ----------
    name : str
        The finger's and ``middle`` or ``tip``.
    normal_force, friction_force : float
        Force on the object along its inward normal, and across it [N].
    margin : float
        1 - |friction force| / (friction coefficient * normal force); positive: it is not about to slip.
    deflection : float
        Displacement of the finger out of its plane there, per length of the finger [1].
    """

    name: str
    normal_force: float
    friction_force: float
    margin: float
    deflection: float


@dataclass(frozen=True)
class HandCertificate(Summarized):
    """The result of recomputing a hand's grasp independently.

    Attributes
    ----------
    checks : tuple of Check
        Every property that must hold.
    contacts : tuple of HandContact
        Forces and displacement of each contact.
    hand : RecomputedHand or None
        What was recomputed; None where the stored numbers are no grasp.
    """

    checks: tuple[Check, ...]
    contacts: tuple[HandContact, ...] = ()
    hand: RecomputedHand | None = field(default=None, repr=False, compare=False)

    @cached_property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)

    @cached_property
    def passed_at_rest(self) -> bool:
        """Whether every check passed; checks of a weight in any direction do not count."""
        return all(check.passed for check in self.checks if not check.name.endswith(TURNED))

    @cached_property
    def turned(self) -> tuple[TurnedContact, ...]:
        """Needs of each contact while the weight takes every direction; empty where it has one."""
        if self.hand is None or not self.hand.scene.turned:
            return ()
        each = [turned_contacts(self.hand, response, self.hand.scene.turned) for response in self._bounds]
        return min(each, key=lambda needs: max((c.friction / c.held for c in needs), default=0.0), default=())

    @cached_property
    def turned_motion(self) -> tuple[float, float]:
        """Greatest displacement [m] and turn [rad] of the object while its weight takes every direction, to first
        order; NaN where it has one direction, or nothing holds.
        """
        if self.hand is None or self.response is None or not self.hand.scene.turned:
            return float("nan"), float("nan")
        motion = self.hand.scene.turned * self.response.pose_by_gravity
        return float(np.linalg.norm(motion[:3], 2)), float(np.linalg.norm(motion[3:], 2))

    def promised(self, along: Sequence[float] | Array) -> float:
        """Greatest multiple of a wrench on the object that no contact slips or gives way under, to first order.

        Parameters
        ----------
        along : sequence of float
            Force [N] and moment about the center of mass [N m] as the hand sees them (6,).
        """
        if self.hand is None or not self._bounds:
            return float("nan")
        return max(promised_wrench(self.hand, response, np.array(along, dtype=float)) for response in self._bounds)

    @cached_property
    def push(self) -> float:
        """Greatest push that the grasp bears in every direction, to first order [N]. Zero without a grasp, or for an
        unstable one unless the scene ignores stability.
        """
        if self.hand is None or not (self.hand.scene.stability == "ignore" or self.stability.eigenvalue > 0.0):
            return 0.0
        return max((borne_push(self.hand, response) for response in self._bounds), default=0.0)

    @cached_property
    def promise(self) -> dict[str, float]:
        """Force [N] and moment [N m] promised along each axis, the less of both senses."""
        axes = zip((f"{kind} {axis}" for kind in ("force", "moment") for axis in "xyz"), np.eye(6), strict=True)
        return {name: min(self.promised(axis), self.promised(-axis)) for name, axis in axes}

    @property
    def acceptable(self) -> bool:
        """Whether the grasp is as the scene asks: every check passed, and stable where that is required."""
        if self.hand is None or not self.passed:
            return False
        return self.hand.scene.stability == "ignore" or self.stability.stable

    @property
    def failed(self) -> tuple[Check, ...]:
        """The checks that did not pass."""
        return tuple(check for check in self.checks if not check.passed)

    @cached_property
    def stability(self) -> SpatialStability:
        """Second-order test in space; computed when first asked for."""
        return SpatialStability(float("nan"), float("nan"), "") if self.hand is None else hand_stability(self.hand)

    @property
    def held_by(self) -> str:
        """Tensions or drives that stay while the object moves, in words."""
        return held_by(() if self.hand is None else [finger.plane for finger in self.hand.fingers])

    @cached_property
    def response(self) -> HandResponse | None:
        """Linear response to wrenches and tensions, computed when first asked for; None where nothing holds."""
        return None if self.hand is None else hand_response(self.hand)

    @cached_property
    def _bounds(self) -> tuple[HandResponse, ...]:
        """Responses; the best one counts, since contacts with torsional friction hold no less than points."""
        points = None if self.hand is None else points_response(self.hand)
        return tuple(response for response in (self.response, points) if response is not None)

    @property
    def friction_margin(self) -> float:
        """Least of the friction margins; NaN where nothing is known."""
        if self.hand is None:
            return float("nan")
        return min((contact.margin for contact in self.contacts), default=0.0)

    def data(self) -> dict[str, Any]:
        """The certificate as plain data."""
        return {
            "passed": self.passed,
            "checks": [{**asdict(check), "passed": check.passed} for check in self.checks],
            "contacts": [asdict(contact) for contact in self.contacts],
            "friction_margin": self.friction_margin,
            "promise": dict(self.promise),
            "push": self.push,
            "stability": self.stability.data(),
        }

    def headline(self) -> str:
        """Number of checks that passed."""
        return f"{len(self.checks) - len(self.failed)} of {len(self.checks)} checks passed"

    def pairs(self) -> dict[str, str]:
        """Failed checks, least margin, greatest displacement and stability."""
        failed = {"failed": ", ".join(check.name for check in self.failed)} if self.failed else {}
        aside = max((abs(contact.deflection) for contact in self.contacts), default=0.0)
        return {
            **failed,
            "least margin": f"{self.friction_margin:.1%} of the friction cone",
            "lateral deflection": f"{aside:.1%} of the length",
            "promised push": f"{amount_text(least_push(self.promise), 'N', '.3g')} along any axis, to first order",
            "push in any direction": amount_text(self.push, "N", ".3g"),
            "second-order test": str(self.stability),
        }

    def __getitem__(self, name: str) -> Check:
        for check in self.checks:
            if check.name == name:
                return check
        raise KeyError(name)


def least_push(promise: Mapping[str, float]) -> float:
    """Least of the forces promised along the axes [N]."""
    return min((value for name, value in promise.items() if name.startswith("force")), default=float("nan"))


def certify_hand(scene: HandScene, arrays: Mapping[str, Any]) -> HandCertificate:
    """Verify a hand's grasp from its stored numbers.

    Parameters
    ----------
    scene : HandScene
    arrays : mapping
        For each finger F, in its own plane: ``F.family``, ``F.q``, ``F.lengths``, ``F.curvature_shapes``,
        ``F.tip_curvature``, ``F.tensions``, ``F.base``, ``F.backbone``. For the contacts, as the hand sees them:
        ``contact_names``, ``contact_positions`` on the object [m], ``contact_normals`` of the object (outward),
        ``contact_forces`` on the fingers [N], ``contact_stations`` along them [m], and ``contact_deflections`` of their
        backbones out of their planes [m]; of palm and table, such as ``palm_1``, both are zero. With torsional
        friction also ``contact_moments`` about the normals, on the fingers [N m].

    Returns
    -------
    HandCertificate
    """
    with np.errstate(all="ignore"):
        checks = [
            Check("non-finite numbers", float(_not_finite(scene, arrays)), 0.0),
            Check("missing or misshapen arrays", float(_misfits(scene, arrays)), 0.0),
        ]
        if not all(check.passed for check in checks):  # a fault here stops the rest
            return HandCertificate(tuple(checks))
        lengths = [length_check(setup.name, setup.finger.rod.length, arrays) for setup in scene.setups]
        if not all(check.passed for check in lengths):
            return HandCertificate((*checks, *lengths))
        hand = RecomputedHand(scene, arrays)
        checks += [touches_check(hand), *lengths]
        for finger in hand.fingers:
            checks += [*equilibrium_checks(finger.plane), *storage_checks(finger.plane), *limit_checks(finger.plane)]
            for contact in finger.contacts:
                checks += [*_forces(hand, contact), *_contact(hand, finger, contact)]
        for carried in hand.carried:
            checks += [*_forces(hand, carried), *_support_contact(hand, carried)]
        checks += [*_object(hand), *_clearances(hand), *_support_clearances(hand)]
        aside = {c.name: c.deflection / finger.length for finger in hand.fingers for c in finger.contacts}
        contacts = tuple(
            HandContact(c.name, c.normal_force, c.friction_force, c.friction_margin, aside.get(c.name, 0.0))
            for c in (*(c for finger in hand.fingers for c in finger.contacts), *hand.carried)
        )
        certificate = HandCertificate(tuple(checks), contacts, hand)
        more = [check for contact in certificate.turned for check in _turned(hand, contact)]
        more += _turned_motion(scene, certificate.turned_motion)
        if scene.contacts.push:
            more.append(push_check(certificate.push, scene.contacts.push))
        return replace(certificate, checks=(*checks, *more)) if more else certificate


def _not_finite(scene: HandScene, arrays: Mapping[str, Any]) -> int:
    """Number of entries that are NaN or infinite."""
    names = [f"{setup.name}.{name}" for setup in scene.setups for name in OF_FINGER]
    names += [f"contact_{key}" for key in of_contacts(scene)]
    stored = [as_numbers(arrays.get(name, 0.0)) for name in names]
    return sum(int((~np.isfinite(values)).sum()) for values in stored if values is not None)


def _misfits(scene: HandScene, arrays: Mapping[str, Any]) -> int:
    """Number of arrays that are missing, misshapen or of another family than the scene's."""

    def shape(name: str) -> tuple[int, ...] | None:
        values = as_numbers(arrays[name]) if name in arrays else None
        return None if values is None else tuple(values.shape)

    names = np.asarray(arrays.get("contact_names", 0.0))
    wrong = ["contact_names" not in arrays or names.shape != (names.size,)]
    expected = {f"contact_{key}": (names.size, *of) for key, of in of_contacts(scene).items()}
    for setup in scene.setups:
        prefix, n = f"{setup.name}.", setup.elements
        shapes = shape(f"{prefix}curvature_shapes") or ()
        backbone = shape(f"{prefix}backbone")
        coordinates = (shapes[-1] if shapes else 0) - FAMILIES[setup.family].matches_tip
        expected |= {f"{prefix}q": (coordinates,), f"{prefix}lengths": (n,), f"{prefix}tip_curvature": ()}
        expected |= {f"{prefix}tensions": (2,), f"{prefix}base": (3,)}
        wrong += [str(arrays.get(f"{prefix}family")) != setup.family]
        wrong += [len(shapes) != 3 or shapes[0] != n or 0 in shapes]
        wrong += [backbone is None or len(backbone) != 2 or backbone[0] < 2 or backbone[1] != 4]
    return sum(wrong) + sum(shape(name) != wanted for name, wanted in expected.items())


def touches_check(hand: RecomputedHand) -> Check:
    """Number of contacts that are missing, unknown, there twice, or there although they are off."""
    present = Counter(hand.names)
    carried = {contact.name: contact.support for contact in hand.carried}
    known = set(known_touches(hand.scene)) | set(carried)
    wrong = sum(count - 1 for count in present.values()) + len(set(present) - known)
    wrong += sum(support.touch == "off" for support in carried.values())
    for setup in hand.scene.setups:
        for name, switch in setup.switches.items():
            wrong += switch == ("off" if name in present else "on")
    return Check("contacts match the scene", float(wrong), 0.0)


def _forces(hand: RecomputedHand, c: ObjectTouch) -> Iterator[Check]:
    """Friction cone and normal force of a contact."""
    scale, normal_force = hand.force_scale, c.normal_force
    yield Check.part(f"friction cone, {c.name}", c.across - c.held_friction * normal_force, scale, "N")
    limit = c.normal_force_max
    over = worst(-normal_force / scale, normal_force / limit - 1)
    yield Check(f"normal force, {c.name}", over, EXACT, amount_text(limit, "N", ".4g"))


def _support_contact(hand: RecomputedHand, c: SupportTouch) -> Iterator[Check]:
    """Place of a contact with palm or table: on the surface of the object, and on the plane within the disc."""
    off = [*np.abs(c.stored_position - c.point) / hand.size, *np.abs(c.stored_normal - c.normal)]
    off += [abs(value) / hand.size for value in (c.stored_station, c.stored_deflection)]
    yield Check(f"stored contact, {c.name}", worst(*off), EXACT, f"{hand.size:.4g} m")
    yield Check.part(f"contact gap, {c.name}", math.hypot(c.height, c.beyond), hand.size, "m", RESTS)


def _contact(hand: RecomputedHand, finger: SpatialFinger, c: HandTouch) -> Iterator[Check]:
    """Geometry of a contact of a finger."""
    length = finger.length
    off = [*np.abs(c.stored_position - c.point) / length, *np.abs(c.stored_normal - c.normal)]
    off.append(abs(c.stored_station - c.station) / length)
    yield Check(f"stored contact, {c.name}", worst(*off), EXACT, f"{length:.4g} m")
    yield Check.part(f"contact gap, {c.name}", abs(c.distance - c.radius), length, "m")
    # A finger is as thick as discs along it: where these grow, its skin leans by the slope of the radius.
    aside = float(c.normal @ c.tangent - finger.plane.skin.slope(c.station))
    if c.kind == "middle":
        yield Check(f"contact tangency, {c.name}", abs(aside), EXACT, "rad")
    else:  # a rounded end touches with what lies ahead of it; the search leaves the root of its tolerance
        slack = float(np.sqrt(hand.scene.solver.penetration_tolerance))
        yield Check(f"contact direction, {c.name}", aside, slack + EXACT, "rad")
    yield Check.part(f"shift to the side, {c.name}", abs(c.stored_deflection - c.deflection), length, "m")
    yield Check.part(f"lateral deflection, {c.name}", abs(c.deflection), length, "m", ASIDE)


def _object(hand: RecomputedHand) -> Iterator[Check]:
    """Balance of the object's forces, and of their moments about its center of mass."""
    force = hand.scene.object.weighed * hand.gravity
    moment = np.zeros(3)
    for contact in hand.touches:
        force = force - contact.load
        moment -= np.cross(contact.point - hand.com, contact.load) + contact.moment * contact.normal
    yield Check.part("object force balance", float(np.abs(force).max()), hand.force_scale, "N")
    yield Check.part("object moment balance", float(np.abs(moment).max()), hand.force_scale * hand.size, "N m")


def _turned(hand: RecomputedHand, c: TurnedContact) -> Iterator[Check]:
    """A contact while the weight takes every direction, to first order."""
    yield Check(f"friction cone, {c.name}{TURNED}", c.friction - c.held, EXACT)
    yield Check.part(f"normal force, {c.name}{TURNED}", c.greatest - c.limit, hand.force_scale, "N")


def _turned_motion(scene: HandScene, motion: tuple[float, float]) -> Iterator[Check]:
    """Limits of the object's motion while its weight takes every direction."""
    kinds = zip(("displacement", "turn"), motion, scene.most_motion, ("m", "rad"), strict=True)
    for name, moved, most, unit in kinds:
        if math.isfinite(most):
            yield Check.part(f"{name} of the object{TURNED}", moved - most, most, unit)


def _clearances(hand: RecomputedHand) -> Iterator[Check]:
    """Displaced fingers against the object and each other, and each against itself within its plane."""
    for finger in hand.fingers:
        depth = float((finger.plane.thickness - hand.surface.distance(finger.points)).max())
        # A mesh is not where its object is by more than its deviation.
        limit = GUARDED + hand.scene.object.deviation / finger.length
        yield Check.part(f"penetration into the object, {finger.name}", depth, finger.length, "m", limit)
        yield Check.part(f"{CURLED}, {finger.name}", self_overlap(finger.plane), finger.length, "m", GUARDED)
    for first, other in combinations(hand.fingers, 2):
        thick = first.plane.thickness, other.plane.thickness
        depth = -backbone_gap((first.points, other.points), thick)
        length = min(first.length, other.length)
        yield Check.part(f"overlap of fingers, {first.name}, {other.name}", depth, length, "m", GUARDED)


def _support_clearances(hand: RecomputedHand) -> Iterator[Check]:
    """The object is not in palm or table, nor is a displaced finger beyond what its base needs."""
    bases = hand.scene.hand.named_bases
    for support in hand.scene.supports:
        point = np.array(support.point)
        normal = np.array(support.normal)
        depth = -hand.surface.height(point, normal)
        yield Check.part(f"penetration into the {support.name}", depth, hand.size, "m", RESTS)
        for finger in hand.fingers:
            base = bases[finger.name]
            free = finger.plane.rod.edges >= support.clear_from(base.position, base.direction, finger.radius)
            away = finger.points[free] - point
            heights = away @ normal
            # The part behind a disc stands on it: a pillar.
            beside = np.linalg.norm(away - heights[:, None] * normal, axis=1) - support.radius
            outside = np.hypot(np.maximum(heights, 0.0), np.maximum(beside, 0.0))
            distance = outside + np.minimum(np.maximum(heights, beside), 0.0)
            depth = float((finger.plane.thickness[free] - distance).max())
            yield Check.part(f"penetration into the {support.name}, {finger.name}", depth, finger.length, "m", GUARDED)


def backbone_gap(points: tuple[Array, Array], halves: tuple[Array, Array]) -> float:
    """Least gap of two chains of straight panels between points (A, 3), (B, 3) [m], by half their thickness there (A,),
    (B,) [m].
    """
    (a, b), (thick, other) = points, halves
    gaps = np.linalg.norm(a[:, None] - b, axis=2) - thick[:, None] - other
    # The nearest places lie on panels that end where the points are nearly nearest.
    reach = sum(
        float((np.linalg.norm(np.diff(line, axis=0), axis=1) + np.abs(np.diff(half))).max())
        for line, half in zip(points, halves, strict=True)
    )
    near = gaps <= gaps.min() + reach
    p, q = np.nonzero(near[:-1, :-1] | near[1:, :-1] | near[:-1, 1:] | near[1:, 1:])
    # As thick as the thicker of their ends.
    thick, other = (np.maximum(half[:-1], half[1:]) for half in halves)
    return float((_segments_apart(a[p], a[p + 1], b[q], b[q + 1]) - thick[p] - other[q]).min())


def _segments_apart(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Distances (m,) of segments a b and c d in space: inside of both where that is nearest, else from an end."""

    def dot(v: Array, w: Array) -> Array:
        return np.asarray((v * w).sum(axis=-1))

    def from_end(point: Array, start: Array, end: Array) -> Array:
        span = end - start
        share = np.clip(dot(point - start, span) / np.maximum(dot(span, span), 1e-300), 0.0, 1.0)
        return np.asarray(np.linalg.norm(point - start - share[..., None] * span, axis=-1))

    ends = [from_end(a, c, d), from_end(b, c, d), from_end(c, a, b), from_end(d, a, b)]
    u, v, w = b - a, d - c, a - c
    across = dot(u, u) * dot(v, v) - dot(u, v) ** 2
    # 1e-12: sine squared of the angle below which segments are parallel, whose ends are then nearest
    crossing = across > 1e-12 * dot(u, u) * dot(v, v)
    safe = np.where(crossing, across, 1.0)
    x = (dot(u, v) * dot(v, w) - dot(v, v) * dot(u, w)) / safe
    y = (dot(u, u) * dot(v, w) - dot(u, v) * dot(u, w)) / safe
    inside = crossing & (x >= 0.0) & (x <= 1.0) & (y >= 0.0) & (y <= 1.0)
    between = np.linalg.norm(w + x[:, None] * u - y[:, None] * v, axis=-1)
    return np.asarray(np.where(inside, between, np.min(ends, axis=0)))
