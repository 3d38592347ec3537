"""Contact forces of a grasp on the compliant pads of its mission: fingers close on an object that gives way."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from continuum_grasp.addons.mission.assignment import Assignment
from continuum_grasp.addons.mission.lift import Shortfall, shortfalls
from continuum_grasp.addons.mission.plan import NOTICES
from continuum_grasp.addons.mission.plant import MOVES, mission_plant_model, reserve
from continuum_grasp.base import Array, SolverError, amount_text
from continuum_grasp.closed_loop import PlantModel, SharedModel
from continuum_grasp.scene import PlantDifferences

_STEP = 0.004
"""Step of the linearly implicit Euler method [s]. It has the equilibria of the equations; the forces that
configs/mission/mug.yaml ends with differ by 2 % from those with a quarter of the step."""
_STIFFER = 10.0
"""Stiffness of the pads, per the mission's, with which a refusal is compared [1]: they give way by a tenth."""


@dataclass(frozen=True)
class Closed:
    """Fingers that are closed on an object that gives way, with the tensions of the grasp or more."""

    tension: float  # greatest one [N]
    names: tuple[str, ...]  # (C,) contacts of the fingers
    normal_force: Array  # (C,) [N]
    gap: Array  # (C,) distances from the surface, negative where pressed [m]
    away: Array  # (C,) distances from where the grasp has the fingers' sections [m]
    moved: Array  # (3,) motion of the object from its pose in the grasp: x, y [m] and angle [rad]


class _Hand:
    """Fingers that close on an object that stands in the grasp: on a table, free, on pads with friction.

    Equations come from the plant, with fingers as their controllers know them: rods, and pads ``stiffer`` times
    as stiff as the mission's.
    """

    def __init__(self, assignments: Sequence[Assignment], stiffer: float = 1.0) -> None:
        self.known = [_as_known(assignment, stiffer) for assignment in assignments]
        self.models = [mission_plant_model(assignment) for assignment in self.known]
        self.whole = SharedModel(self.models)
        starts = [model.start.copy() for model in self.models]
        for start, model, task in zip(starts, self.models, self.known, strict=True):
            start[model.system.object_states][:3] = task.object_pose
        symbols = [ca.SX.sym(name, self.whole.forward_dynamics.size1_in(k)) for k, name in enumerate("xuwp")]
        rate = self.whole.forward_dynamics(*symbols)
        self.slope = ca.Function("slope", symbols, [rate, ca.densify(ca.jacobian(rate, symbols[0]))])
        self.start, self.forces = self.whole.joined(starts), self.whole.forces(0.0)[0]

    def motion(self) -> Iterator[tuple[bool, Array, Array]]:
        """States and inputs as the fingers close: whether they have the tensions of the grasp or more by then."""
        phases = self.known[0].mission.phases
        x = self.start
        unit = np.eye(len(self.start)) / _STEP
        ways = (
            (phases.approach, "rest", "before"),
            (phases.squeeze, "before", "held"),
            (phases.squeeze, "held", "tight"),
        )
        for duration, begin, end in ways:
            low = np.concatenate([getattr(assignment, begin) for assignment in self.known])
            high = np.concatenate([getattr(assignment, end) for assignment in self.known])
            count = math.ceil(duration / _STEP)
            for k in range(1, count + 1):
                u = low + min(k / (MOVES * count), 1.0) * (high - low)
                f, a = self.slope(x, u, self.forces, self.whole.p)
                x = x + np.linalg.solve(unit - np.array(a), np.array(f).ravel())
                yield end == "tight" or (end == "held" and k == count), x, u


def closed(assignments: Sequence[Assignment], stiffer: float = 1.0) -> Iterator[Closed]:
    """Close the fingers as the squeeze does, and on to their greatest tensions; the first state has the grasp's."""
    hand = _Hand(assignments, stiffer)
    views = [_view(assignment, model) for assignment, model in zip(hand.known, hand.models, strict=True)]
    for done, x, _ in hand.motion():
        if done:
            parts = zip(views, hand.whole.parts(x), strict=True)
            yield _seen(hand.known, [view(state) for view, state in parts])


def pushed_out(assignments: Sequence[Assignment]) -> float:
    """Rate [1/s] at which an object whose contacts slide leaves the hand: the motion of the closed hand without
    friction grows by exp(rate t). Zero where the hand holds it in the plane all the same.
    """
    hand = _Hand(assignments)
    x, u = next((x, u) for done, x, u in hand.motion() if done)
    for model in hand.models:
        model.p = model.p.copy()
        model.p[-1] = 0.0  # friction, the last of the object's numbers
    _, a = hand.slope(x, u, hand.forces, hand.whole.p)
    return max(0.0, float(np.linalg.eigvals(np.array(a)).real.max()))


def standing(assignments: Sequence[Assignment]) -> float:
    """Share by which fingers press harder from the lift on [1], since what slides is gone before they could answer.

    Where the hand pushes it out, it is e times as far by the time that the drives press harder. Zero where slip can be
    answered.
    """
    of = assignments[0].mission
    rise = [
        float(np.abs(assignment.tight - assignment.held).max())
        / (assignment.control.controller.input.rate_max or math.inf)
        for assignment in assignments
    ]
    late = (of.estimator.delay or 0.0) + NOTICES * of.controller.period + max(rise)
    late += max(assignment.control.lag or 0.0 for assignment in assignments)
    return min(reserve(assignment) for assignment in assignments) if pushed_out(assignments) * late > 1.0 else 0.0


def _as_known(assignment: Assignment, stiffer: float) -> Assignment:
    """Replace the plant of a task by the finger that its controller knows, on pads that are stiffer."""
    law = assignment.mission.contact_law
    mission = assignment.mission.replaced(
        more_contacts=(), plant=PlantDifferences(), contact_law=law.replaced(stiffness=stiffer * law.stiffness)
    )
    return replace(assignment, mission=mission, control=assignment.control.replaced(plant=PlantDifferences()))


def _view(assignment: Assignment, model: PlantModel) -> Callable[[Array], list[Array]]:
    """Quantities of a finger's plant in a state (nx): tensions, normal forces, gaps, places, pose."""
    names = [k for k, name in enumerate(model.system.touch_names) if name.startswith("finger.")]
    at = (*model.scene.contacts, model.scene.finger.rod.length)
    values = {"force": model.touch["normal_force"][names], "gap": model.touch["gap"][names]}
    values |= {"tension": model.tensions, "place": model.sections(at)[0], "pose": model.object_pose[:3]}
    view = model.function("view", **values)
    line = assignment.grasp.fingers[assignment.name].backbone
    wanted = np.array([np.interp(at, line[:, 0], line[:, k]) for k in (1, 2)])

    def seen(x: Array) -> list[Array]:
        force, gap, tension, place, pose = (np.array(v) for v in view(x, model.rest_input, model.forces(0.0)[0]))
        return [tension.ravel(), force.ravel(), gap.ravel(), np.hypot(*(place - wanted)), pose.ravel()]

    return seen


def _seen(known: Sequence[Assignment], views: Sequence[list[Array]]) -> Closed:
    """The fingers together."""
    *parts, poses = zip(*views, strict=True)
    tension, force, gap, away = map(np.concatenate, parts)
    names = [assignment.own_name(name) for assignment in known for name in assignment.control.contact_names]
    return Closed(float(tension.max()), tuple(names), force, gap, away, poses[0] - np.array(known[0].object_pose))


def reserved(of: Assignment) -> tuple[str, ...]:
    """Warning, beforehand, of fingers that could not answer slip in time; none where they could."""
    if not of.standing:
        return ()
    return (
        "what slides leaves the hand before it could be squeezed, since without friction the fingers push it out: they "
        f"press {100.0 * of.standing:.0f} % harder from the lift on, and what slips all the same may fall (slip)",
    )


def check_pads(assignments: Sequence[Assignment]) -> None:
    """Refuse a mission whose contacts, closed on its compliant pads, bear too little to lift at any tension."""
    best, lacking = _best(assignments)
    if not lacking:
        return
    law = assignments[0].mission.contact_law
    firm, _ = _best(assignments, _STIFFER)
    x, y, angle = best.moved
    where = []
    for shortfall in lacking:
        k = best.names.index(shortfall.contact)
        touch = f"{1e3 * best.gap[k]:.3g} mm short of the object, " if best.gap[k] > 0.0 else ""
        where.append(
            f"{shortfall.text} with {amount_text(best.tension, 'N')} of tension: it comes to lie {touch}"
            f"{1e3 * best.away[k]:.3g} mm from its place in the grasp; on pads of "
            f"{_STIFFER * law.stiffness:g} N/m it bears {amount_text(firm.normal_force[k], 'N', '.2f')}"
        )
    raise SolverError(
        f"the fingers do not reach the grasp on pads of {law.stiffness:g} N/m, on which the object gives way by "
        f"({1e3 * x:+.2g}, {1e3 * y:+.2g}) mm and turns by {math.degrees(angle):+.2g} deg: "
        f"{', '.join(shortfall.contact for shortfall in lacking)} would carry no load at the lift",
        status="not_loaded",
        violated=where,
        advice="Take stiffer pads (contact_law.stiffness), more tension (drive_tension), or a grasp with less force on "
        "the contacts that press the object away, or with its object, base or contacts elsewhere (grasp); "
        "phases.lift_share is the share of the certificate's forces that is needed.",
    )


def _best(assignments: Sequence[Assignment], stiffer: float = 1.0) -> tuple[Closed, tuple[Shortfall, ...]]:
    """The first tensions with which no contact lacks force, or those with which the worst one lacks least."""
    attempts = list[tuple[float, Closed, tuple[Shortfall, ...]]]()
    for grip in closed(assignments, stiffer):
        lacking = shortfalls(assignments, grip.names, grip.normal_force)
        if not lacking:
            return grip, ()
        attempts.append((min(short.normal_force / short.needed for short in lacking), grip, lacking))
    _, best, lacking = max(attempts, key=lambda each: each[0])
    return best, lacking
