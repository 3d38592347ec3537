"""The certificate of a grasp of rods: every requirement, measured anew from the scene.

It takes tensions, places and forces of contacts from the grasp. The shape of each finger follows from them: it is
integrated as a nonlinear rod in space. Gaps, directions, depths and the balance of the object are then measured with
the exact body of the scene. Nothing is shared with the problem that found the grasp.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.base import Summarized, amount_text
from continuum_grasp.grasp.judge.check import CROSSING, EXACT, FOLLOWED, SHORT, Check, Requirement, greatest
from continuum_grasp.grasp.judge.clearance import Gap, SampledRod, apart, apart_from_itself
from continuum_grasp.grasp.judge.drives import drive_checks
from continuum_grasp.grasp.judge.held import HeldContact, HeldFinger, HeldRods, HeldSupport
from continuum_grasp.grasp.judge.obstacles import ExactObject, Obstacle
from continuum_grasp.grasp.judge.pushed import (
    GIVE,
    IDLE,
    PressedContact,
    PushedFinger,
    PushedGrasp,
    PushedPart,
    PushedSupport,
    rolls,
)
from continuum_grasp.grasp.judge.skin import skin_load
from continuum_grasp.grasp.judge.space_rod import TOLERANCE, SpaceRod
from continuum_grasp.grasp.judge.stage import GraspStage
from continuum_grasp.scene import GraspScene, HandScene


@dataclass(frozen=True, eq=False)
class Certificate(Summarized):
    """The result of measuring a grasp anew.

    Attributes
    ----------
    checks : tuple of Check
        Every requirement that must be met.
    friction_margins : dict of str to float
        1 - |friction| / (friction coefficient * normal force) of each contact that has friction; positive: it is not
        about to slip; 0 where nothing presses.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> certificate = cg.optimize_grasp("configs/grasp/mug_arcs.yaml").certificate
    >>> certificate.passed, certificate.stable
    (True, True)
    >>> certificate["object force balance"].value < certificate["object force balance"].limit
    True
    """

    checks: tuple[Check, ...]
    friction_margins: dict[str, float] = field(default_factory=dict)
    rods: tuple[SpaceRod, ...] = field(default=(), repr=False)
    pushed: PushedGrasp | None = field(default=None, repr=False)

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)

    @property
    def failed(self) -> tuple[Check, ...]:
        """The checks that did not pass."""
        return tuple(check for check in self.checks if not check.passed)

    @property
    def worst(self) -> Check:
        """The check that takes the greatest share of its limit."""
        return max(self.checks, key=lambda check: check.share)

    @property
    def friction_margin(self) -> float:
        """Least of the friction margins; NaN where nothing is known."""
        return min(self.friction_margins.values(), default=0.0) if self.rods else float("nan")

    @cached_property
    def stable(self) -> bool:
        """Whether every small motion of the object needs work at constant tensions: fingers follow it at rest."""
        return self.pushed is not None and self.pushed.stable

    @cached_property
    def pushes(self) -> dict[str, float]:
        """Push in every direction that each contact that presses bears [N], at constant tensions, to first order."""
        return {} if self.pushed is None else self.pushed.pushes

    @property
    def push(self) -> float:
        """Push on the object in the worst direction that the grasp bears [N]: then a contact slips, parts or is pressed
        too hard. Zero if nothing presses or the object moves away at constant tensions.
        """
        return min(self.pushes.values(), default=0.0)

    @property
    def compliance(self) -> Array:
        """Motion (m, m) of the object per wrench, at constant tensions: shifts [m] and turns [rad] by forces [N] and
        moments [N m]; NaN where nothing is known.
        """
        stiffness = np.full((6, 6), np.nan) if self.pushed is None else self.pushed.stiffness
        return np.asarray(np.linalg.inv(stiffness))

    def headline(self) -> str:
        """Number of checks that passed."""
        return f"{len(self.checks) - len(self.failed)} of {len(self.checks)} checks passed"

    def pairs(self) -> dict[str, str]:
        """Failed checks, least margin, push and stability."""
        failed = {"failed": ", ".join(check.name for check in self.failed)} if self.failed else {}
        if not self.rods:
            return failed
        margin = f"{self.friction_margin:.1%} of the friction cone"
        push = amount_text(self.push, "N", ".3g")
        return {**failed, "least margin": margin, "push in any direction": push, "stability": self.word}

    @property
    def word(self) -> str:
        """Stability in a word."""
        return "stable" if self.stable else "UNSTABLE"

    @property
    def summary(self) -> dict[str, Any]:
        """Number of checks, and those that failed."""
        return {"checks": len(self.checks), "failed": [str(check) for check in self.failed]}

    def data(self, *, push: bool = True) -> dict[str, Any]:
        """The certificate as plain data, without the ``push``, which takes a tenth of a second, where it is not asked
        for.
        """
        found: dict[str, Any] = {
            "passed": self.passed,
            "checks": [check.data() for check in self.checks],
            "friction_margin": self.friction_margin,
        }
        return found | ({"stable": self.stable, "push": self.push} if push else {})

    def of(self, wanted: Requirement, subject: str = "") -> Check:
        """The check of a requirement and a finger, contact or support; the object's without.

        Raises
        ------
        KeyError
            There is no such check.
        """
        for check in self.checks:
            if check.requirement is wanted and check.subject == subject:
                return check
        raise KeyError(wanted, subject)

    def __getitem__(self, name: str) -> Check:
        for check in self.checks:
            if check.name == name:
                return check
        raise KeyError(name)


def certify_held(scene: GraspScene | HandScene, held: HeldRods, *, tolerance: float = TOLERANCE) -> Certificate:
    """Verify a grasp of rods.

    Parameters
    ----------
    scene : GraspScene or HandScene
    held : HeldRods
        The grasp.
    tolerance : float
        Relative tolerance with which shapes are integrated [1].
    """
    stage = GraspStage.of(scene)
    checks = [
        Check(Requirement.NUMBERS, "", float(held.not_finite), 0.0),
        Check(Requirement.CONTACTS, "", float(_strangers(stage, held)), 0.0),
        Check(Requirement.LAWS, "", float(_not_certified(stage)), 0.0),
    ]
    # Without these there is nothing to integrate.
    if not all(check.passed for check in checks):
        return Certificate(tuple(checks))
    with np.errstate(all="ignore"):
        grasp = _Grasp(stage, held, tolerance)
        checks += grasp.checks()
        rods = tuple(line.rod for line in grasp.lines)
        certificate = Certificate(tuple(checks), grasp.friction_margins, rods, grasp.pushed)
        asked = scene.contacts.push or 0.0
        if not asked:
            return certificate
        missing = Check(Requirement.PUSH, "", asked - certificate.push, SHORT * asked, "N")
        return replace(certificate, checks=(*checks, missing))


def shapes_of(scene: GraspScene | HandScene, held: HeldRods, *, tolerance: float = TOLERANCE) -> tuple[SpaceRod, ...]:
    """Shapes of the fingers of a grasp, whatever its checks are.

    It takes the arguments of `certify_held`.
    """
    with np.errstate(all="ignore"):
        return tuple(line.rod for line in _Grasp(GraspStage.of(scene), held, tolerance).lines)


def _strangers(stage: GraspStage, held: HeldRods) -> int:
    """Count of fingers and contacts that are missing, unknown, there twice, or there although they are off."""
    wrong = abs(len(held.fingers) - len(stage.setups))
    wrong += sum(count - 1 for count in Counter(contact.name for contact in held.contacts).values())
    for finger in held.fingers:
        setup = stage.setups.get(finger.name)
        if setup is None or finger.tensions.shape != (len(setup.finger.tendon_list),):
            return wrong + 1
        on = {contact.name for contact in finger.contacts}
        wrong += len(on - setup.switches.keys())
        wrong += sum(switch == ("off" if name in on else "on") for name, switch in setup.switches.items())
        wrong += sum(not 0.0 <= contact.place <= setup.finger.rod.length for contact in finger.contacts)
    present = Counter(support_of(stage, contact.name) for contact in held.supports)
    wrong += present[""]
    wrong += sum(each.touch == ("off" if present[each.name] else "on") for each in stage.obstacles)
    return wrong


def _not_certified(stage: GraspStage) -> int:
    """Count of what a scene asks for that the certificate does not know: all histories of friction."""
    setups = stage.setups.values()
    return int(stage.scene.friction_states == "any" and any(setup.friction_states for setup in setups))


def support_of(stage: GraspStage, contact: str) -> str:
    """Name of the support of a contact such as ``palm``, ``palm.1`` or ``palm_1``; empty of strangers."""
    names = {obstacle.name for obstacle in stage.obstacles}
    return next((name for name in (contact, contact[:-2]) if name in names), "")


@dataclass(frozen=True, eq=False)
class _Touch:
    """A contact of the object with the geometry of the exact body."""

    contact: HeldContact | HeldSupport
    point: Array  # (3,) where the object is touched [m]
    normal: Array  # (3,) outward normal of the object
    friction: float  # coefficient, less the reserve [1]
    torsional: float  # greatest moment per normal force [m]
    most: float  # greatest normal force [N]
    gap: float  # [m]
    most_gap: float  # that passes [m]

    @property
    def pressing(self) -> float:
        """Force along the normal [N]; negative where it pulls."""
        return float(self.contact.force @ self.normal)

    @property
    def across(self) -> float:
        """Force across the normal, with the moment about it as the cone bears both [N]."""
        along = float(np.linalg.norm(self.contact.force - self.pressing * self.normal))
        if not self.contact.moment:
            return along
        # An ellipse: no moment where all friction is used, and the greatest where none is.
        return (
            float(np.hypot(along, self.contact.moment * self.friction / self.torsional)) if self.torsional else np.inf
        )


class _Grasp:
    """Shapes of all fingers of a grasp, with their measures."""

    def __init__(self, stage: GraspStage, held: HeldRods, tolerance: float) -> None:
        self.stage, self.held = stage, held
        self.body: ExactObject = stage.body(held)
        self.scale = stage.scale(held)
        self.lines = [SampledRod(self._rod(finger, tolerance)) for finger in held.fingers]

    def _rod(self, finger: HeldFinger, tolerance: float) -> SpaceRod:
        setup = self.stage.setups[finger.name]
        loads = [skin_load(setup, contact, self.body.normal) for contact in finger.contacts]
        base, gravity = (finger.position, finger.axes), self.stage.finger_gravity
        section = self.stage.section(setup)
        rod = SpaceRod(setup, base, finger.tensions, loads, gravity, section, tolerance=tolerance)
        if finger.moment is None:
            rod.solve(np.zeros(3))
        else:
            rod.integrate(finger.moment)
        return rod

    def checks(self) -> Iterator[Check]:
        """All checks that need the shapes."""
        yield from self.stage.poses(self.held)
        for finger, line in zip(self.held.fingers, self.lines, strict=True):
            yield from self._of_finger(finger, line)
            for contact in finger.contacts:
                if contact.name in self._middles(finger):
                    tangent = self._touch(finger, line, contact)[1]
                    yield Check(Requirement.TANGENT, contact.name, abs(tangent), FOLLOWED, "rad")
        for touch in self._touches:
            yield from self._of_contact(touch)
        yield from self._balance()
        yield from self._clear()

    @cached_property
    def _touches(self) -> list[_Touch]:
        """Contacts of fingers, then of supports."""
        lines = zip(self.held.fingers, self.lines, strict=True)
        found = [self._touch(finger, line, contact)[0] for finger, line in lines for contact in finger.contacts]
        return [*found, *map(self._support_touch, self.held.supports)]

    @property
    def friction_margins(self) -> dict[str, float]:
        """Unused share of the friction cone of each contact that has friction [1]; 0 where nothing presses."""
        reserve = 1.0 - self.stage.scene.contacts.reserve
        limits = {touch.contact.name: touch.friction / reserve * touch.pressing for touch in self._touches}
        rough = (touch for touch in self._touches if touch.friction > 0.0)
        return {
            touch.contact.name: 1.0 - touch.across / limit if (limit := limits[touch.contact.name]) > 0.0 else 0.0
            for touch in rough
        }

    # -- fingers -----------------------------------------------------------------------------------------------

    def _middles(self, finger: HeldFinger) -> dict[str, tuple[float, float]]:
        """Least and greatest position of middle contacts by name [m]."""
        setup = self.stage.setups[finger.name]
        return dict(zip(setup.middle_names, setup.contact_bounds, strict=True))

    def _of_finger(self, finger: HeldFinger, line: SampledRod) -> Iterator[Check]:
        setup, name, rod = self.stage.setups[finger.name], finger.name, line.rod
        scale = max(self.scale * rod.length, setup.stiffness / rod.length * 1e-3)
        yield Check(Requirement.SHAPE, name, float(np.abs(rod.missing).max()), FOLLOWED * scale, "N m")
        tendons, used = setup.tendons, setup.finger.tendons_used
        over = []
        for side, tension in zip(("left", "right"), finger.tensions, strict=True):
            # A tendon that is not there cannot pull.
            here = used in ("both", side)
            over += [tension - (setup.max_tension if here else 0.0), tendons.min_tension * here - tension]
        yield Check(Requirement.TENSION, name, greatest(over), EXACT * setup.max_tension, "N")
        yield from drive_checks(setup, rod, finger.tensions)
        strain = setup.finger.strain_limit
        depth = setup.finger.profile.half_depth
        if strain is not None and depth is not None:
            bent = float((np.abs(rod.curvature(line.s)) * depth(line.s)).max())
            yield Check(Requirement.STRAIN, name, bent - strain, EXACT * strain)
        for contact in finger.contacts:
            low, high = self._middles(finger).get(contact.name, (rod.length, rod.length))
            off = greatest([low - contact.place, contact.place - high])
            yield Check(Requirement.PLACE, contact.name, off, EXACT * rod.length, "m")

    def _clear(self) -> Iterator[Check]:
        """Checks of bodies in each other."""
        lines = dict(zip((finger.name for finger in self.held.fingers), self.lines, strict=True))
        for finger, line in zip(self.held.fingers, self.lines, strict=True):
            length = line.rod.length
            limit = FOLLOWED * length + self.stage.deviation
            yield Check(Requirement.DEPTH, finger.name, -line.least(self._above_object(line)), limit, "m")
            for obstacle in self.stage.obstacles:
                start, before = self.stage.clear_from(obstacle, finger)
                gap = line.least(_above(obstacle, line, start, before), start if np.isinf(before) else 0.0)
                yield Check(Requirement.SUPPORT_DEPTH, f"{finger.name}, {obstacle.name}", -gap, FOLLOWED * length, "m")
            yield Check(Requirement.CURLED, finger.name, -apart_from_itself(line), CROSSING * length, "m")
        for first, other in self.stage.pairs():
            a, b = lines[first], lines[other]
            limit = CROSSING * min(a.rod.length, b.rod.length)
            yield Check(Requirement.CROSSED, f"{first}, {other}", -apart(a, b), limit, "m")
        for obstacle in self.stage.obstacles:
            depth = obstacle.depth_of(self.body)
            yield Check(Requirement.OBJECT_DEPTH, obstacle.name, depth, 2.0 * EXACT * self.stage.size, "m")

    def _above_object(self, line: SampledRod) -> Gap:
        """Gap between a finger and the object along the finger."""
        return lambda s, points: self.body.distance(points) - line.rod.half(s)

    # -- pushes ------------------------------------------------------------------------------------------------

    @property
    def pushed(self) -> PushedGrasp:
        """The grasp with an object that is pushed."""
        stage, center = self.stage, self.stage.center(self.held)
        lengths = [line.rod.length for line in self.lines]
        stiffest = max(line.rod.setup.stiffness / line.rod.length**3 for line in self.lines)
        parts = list[PushedPart]()
        for finger, line in zip(self.held.fingers, self.lines, strict=True):
            touches = [self._touch(finger, line, contact)[0] for contact in finger.contacts]
            pressed = [self._pressed(touch, finger.axes[:, 2]) for touch in touches if self._presses(touch)]
            give = GIVE / stiffest
            parts.append(PushedFinger(stage, self.body, finger, line.rod, pressed, center, stage.axes, give))
        for contact in self.held.supports:
            touch = self._support_touch(contact)
            if self._presses(touch):
                parts.append(self._pushed_support(touch, center, GIVE / stiffest))
        units = np.array([*[min(lengths)] * 3, *[1.0] * 3])
        bending = min(line.rod.setup.stiffness / line.rod.length for line in self.lines)
        return PushedGrasp(parts, units, stage.moves, len(stage.axes), bending)

    def _presses(self, touch: _Touch) -> bool:
        return touch.pressing > IDLE * self.scale

    def _pressed(self, touch: _Touch, across: Array) -> PressedContact:
        """A contact with all of its friction: the reserve is there for what a push needs."""
        held, reserve = touch.contact, 1.0 - self.stage.scene.contacts.reserve
        return PressedContact(
            held.name,
            held.force,
            held.moment,
            touch.point,
            touch.normal,
            across,
            touch.friction / reserve,
            touch.torsional,
            touch.most,
        )

    def _pushed_support(self, touch: _Touch, center: Array, give: float) -> PushedSupport:
        """A support; a face that lies on it by several points does not roll."""
        planar = len(self.stage.axes) == 2
        # Any fixed direction will do that is not along the normal; in a plane, the one out of it.
        across = np.eye(3)[2 if planar else np.abs(touch.normal).argmin()]
        contact = self._pressed(touch, across)
        name = support_of(self.stage, contact.name)
        same = sum(support_of(self.stage, each.name) == name for each in self.held.supports)
        obstacle = next(each for each in self.stage.obstacles if each.name == name)
        way = rolls(self.body, contact, self.stage.size, obstacle.curvature, planar=planar)
        return PushedSupport(contact, center, way if same == 1 else np.zeros((3, 3)), self.stage.axes, give)

    # -- contacts ----------------------------------------------------------------------------------------------

    def _touch(self, finger: HeldFinger, line: SampledRod, contact: HeldContact) -> tuple[_Touch, float]:
        """Return a contact of a finger, and the angle between its skin and the surface there [rad]."""
        setup = self.stage.setups[finger.name]
        half = setup.finger.profile.half_thickness
        here = line.rod.at(np.array([contact.place]))
        (distance,), (normal,) = self.body.near(here.points)
        radius = float(half(contact.place))
        touch = _Touch(
            contact,
            here.points[0] - radius * normal,
            normal,
            setup.held_friction,
            self.stage.torsional,
            setup.normal_force_max,
            abs(float(distance) - radius),
            FOLLOWED * line.rod.length,
        )
        # A finger is as thick as balls along it: where these grow, its skin leans by the slope of their radius.
        return touch, float(normal @ here.axes[0, :, 1]) - half.slope(contact.place)

    def _support_touch(self, contact: HeldSupport) -> _Touch:
        name = support_of(self.stage, contact.name)
        obstacle = next(each for each in self.stage.obstacles if each.name == name)
        normal, off = obstacle.touched(contact, self.body)
        most = self.stage.scene.contacts.normal_force_max
        # 2.0: an object at rest may lie a limit off its support, and the contact as far off the object
        return _Touch(
            contact, contact.position, normal, obstacle.friction, 0.0, most, off, 2.0 * EXACT * self.stage.size
        )

    def _of_contact(self, touch: _Touch) -> Iterator[Check]:
        name, limit = touch.contact.name, EXACT * self.scale
        yield Check(Requirement.GAP, name, touch.gap, touch.most_gap, "m")
        over = greatest([-touch.pressing, touch.pressing - touch.most])
        yield Check(Requirement.PRESSING, name, over, limit, "N")
        yield Check(
            Requirement.FRICTION, name, touch.across - touch.friction * touch.pressing, FOLLOWED * self.scale, "N"
        )

    def _balance(self) -> Iterator[Check]:
        """Balance of the object's forces, and of their moments about its center of mass."""
        center = self.stage.center(self.held)
        force = self.stage.mass * self.stage.gravity
        moment = np.zeros(3)
        for touch in self._touches:
            force = force - touch.contact.force
            moment -= np.cross(touch.point - center, touch.contact.force) + touch.contact.moment * touch.normal
        if self.stage.upright:
            moment = moment[2:]
        yield Check(Requirement.FORCE, "", float(np.abs(force).max()), EXACT * self.scale, "N")
        size = self.scale * self.stage.size
        yield Check(Requirement.MOMENT, "", float(np.abs(moment).max()), FOLLOWED * size, "N m")


def _above(obstacle: Obstacle, line: SampledRod, start: float, before: float) -> Gap:
    """Gap between a finger and an obstacle: of its skin from a position on, and before of its center line."""
    return lambda s, points: obstacle.distance(points) - np.where(s < start, before, line.rod.half(s))
