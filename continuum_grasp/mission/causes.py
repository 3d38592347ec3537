"""Why an object was dropped, or not turned as asked: when which contact gave way, at which limit, and what the
certificate says there; and how far a turn came.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.closed_loop.result import ControlRun
from continuum_grasp.mission.assignment import Assignment
from continuum_grasp.mission.budget import (
    CertifiedContact,
    Lowered,
    bodies,
    certified_contact,
    lowered_by_pulls,
    plant_friction,
)
from continuum_grasp.mission.plant import Span, Timetable, Variation
from continuum_grasp.simulation.contacts import ContactForces

FALLEN = 0.005
"""Height that an object loses before it counts as dropped [m]."""
ON_CONE = 0.99
"""Share of the friction cone from which a contact slips: friction is smooth, and reaches the cone in the limit only."""


@dataclass(frozen=True)
class Slip:
    """A contact that gave way before the object fell.

    Attributes
    ----------
    contact : str
        Name on the plant: ``finger.1``, ``finger.tip``, of several fingers with each one's name in place of ``finger``,
        or that of a support, whose corners count together.
    how : {"slipped", "parted", "absent"}
        At its friction cone, at a normal force of zero, or so before the lift began.
    time : float
        From when on, until the object had fallen [s]; of what was absent, when the lift began.
    friction, normal_force, shear : float
        Friction coefficient [1], and forces at that instant [N].
    certified : CertifiedContact or None
        The same of the certified grasp, before anything pulls; None at a contact that the grasp does not have.
    """

    contact: str
    how: Literal["slipped", "parted", "absent"]
    time: float
    friction: float
    normal_force: float
    shear: float
    certified: CertifiedContact | None

    @property
    def text(self) -> str:
        """The contact that gave way, and the certificate's numbers beside those of the plant."""
        way = {"slipped": "slipped at", "parted": "parted from", "absent": "not held at"}[self.how]
        head = f"{way} {self.contact} at {self.time:.2f} s: "
        if (certified := self.certified) is None:
            return f"{head}friction {self.friction:.2f}, pressed by {self.normal_force:.2f} N; not in the certificate"
        cone = f"friction {self.friction:.2f}, certificate needs {certified.friction:.2f}; "
        pressed = f"pressed by {self.normal_force:.2f} N, certificate {certified.normal_force:.2f} N; "
        return f"{head}{cone}{pressed}bears {self.shear:.2f} N across, certificate {certified.shear:.2f} N"


@dataclass(frozen=True)
class Drop:
    """An object that was dropped.

    Attributes
    ----------
    time : float
        When it had lost 5 mm of height [s].
    phase : str
        In which the first contact gave way.
    slips : tuple of Slip
        Contacts that gave way and stayed so until then, the first one first.
    lowered : Lowered, optional
        Where none gave way while something pulled at an object that weighs in the plane: how far the pull lowers it
        with the fingers that hold it.
    """

    time: float
    phase: str
    slips: tuple[Slip, ...]
    lowered: Lowered | None = None

    @property
    def text(self) -> str:
        """Time of the fall, and the contact at which it began."""
        if not self.slips:
            until = f"until {self.time:.2f} s ({self.phase})"
            head = f"fell by {1e3 * FALLEN:g} mm {until}, with all contacts in their cones"
            return head if self.lowered is None else f"{head}; {self.lowered.text}"
        first, *others = self.slips
        then = "".join(f"; {slip.contact} {slip.how} at {slip.time:.2f} s" for slip in others)
        return f"{first.text} ({self.phase}){then}; 5 mm lower at {self.time:.2f} s"


def find_drop(
    assignments: Sequence[Assignment],
    timetable: Timetable,
    variation: Variation,
    t: Array,
    contacts: ContactForces,
    sunk: Array,
) -> Drop | None:
    """Why an object fell; None where it did not.

    ``sunk`` (K + 1,) is the height that it lost since the lift began, zero before and from the lowering on [m], at
    instants ``t`` (K + 1,) [s]; ``contacts`` are those of all fingers.
    """
    fallen = np.flatnonzero(sunk >= FALLEN)
    if not fallen.size:
        return None
    end = int(fallen[0])
    friction = plant_friction(assignments[0].mission, variation, contacts.names, timetable.fallen(variation, t))
    lift, slips = timetable.span("lift").start, []
    for name, rows in bodies(contacts.names, [assignment.name for assignment in assignments]).items():
        normal, shear = contacts.normal_force[:, rows], contacts.shear[:, rows]
        gone = np.all(shear >= ON_CONE * friction[:, rows] * normal, axis=1)  # also where nothing presses
        gone[1:-1] |= gone[:-2] & gone[2:]  # friction that turns is within the cone for an instant
        firm = np.flatnonzero(~gone[: end + 1])
        begin = int(firm[-1]) + 1 if firm.size else 0
        certified = certified_contact(assignments, name)
        if begin > end or (certified is None and t[begin] < lift):
            continue  # firm until the end, or nothing that had to hold
        at = max(begin, int(np.searchsorted(t, lift)))
        pressed = float(normal[at].sum())
        slips.append(
            Slip(
                contact=name,
                how="absent" if at > begin else "slipped" if pressed > 0.0 else "parted",
                time=float(t[at]),
                friction=float(friction[at, rows[0]]),
                normal_force=pressed,
                shear=float(shear[at].sum()),
                certified=certified,
            )
        )
    slips.sort(key=lambda slip: slip.time)
    began = slips[0].time if slips else float(t[end])
    phase = next(span.name for span in timetable.spans if began <= span.end)
    lowered = lowered_by_pulls(assignments, variation) if not slips and phase.startswith("pull ") else ()
    sinks = next((lowering for lowering in lowered if phase == f"pull {lowering.pull}"), None)
    return Drop(float(t[end]), phase, tuple(slips), sinks)


_TIP = ".tip"


@dataclass(frozen=True)
class Turned:
    """Outcome of a turn; NaN for angles and times that were not reached.

    Attributes
    ----------
    angle : float
        By which the object was turned when the finger had left it for the last time, counter-clockwise [rad].
    error : float
        Of the object's angle then, against that in the grasp [rad].
    end_error : float
        The same at the end of the mission, after it was held and let go [rad].
    shift : float
        Distance of the object from where the grasp has it when the finger had left it [m].
    strokes : tuple of float
        By how much it was turned from its first angle when each stroke had ended [rad].
    tolerance : float
        Of both errors [rad].
    reason : str
        Why an error exceeds it; empty where none does.
    """

    angle: float
    error: float
    end_error: float
    shift: float
    strokes: tuple[float, ...]
    tolerance: float
    reason: str = ""

    @property
    def achieved(self) -> bool:
        """Whether the object was turned, and stood so in the end, within the tolerance."""
        return abs(self.error) <= self.tolerance and abs(self.end_error) <= self.tolerance

    @property
    def text(self) -> str:
        """Angle and errors in degrees."""
        after = ", ".join(f"{math.degrees(angle):.1f}" for angle in self.strokes)
        return (
            f"{math.degrees(self.angle):.1f} deg, {_degrees(self.error)} off, {_degrees(self.end_error)} in the end; "
            f"after its strokes {after} deg; {1e3 * self.shift:.2g} mm from where the grasp has it"
        )


def find_turned(
    assignments: Sequence[Assignment],
    timetable: Timetable,
    variation: Variation,
    runs: Sequence[ControlRun],
    pose: Array,
    contacts: ContactForces,
) -> Turned | None:
    """Turn of the object from its poses (K + 1, 3 or 4) [m, rad]; None where no turn was asked for."""
    of, run = assignments[0], runs[0]
    turn = of.mission.turn
    if turn is None:
        return None
    t, angle = run.t, pose[:, 2] - (of.object_pose[2] - turn.angle)
    strokes = [(timetable.span(f"turn {k}"), timetable.span(f"leave {k}")) for k in timetable.strokes]
    turned = [_at(t, angle, leave.end) for _, leave in strokes]
    left = strokes[-1][1].end
    asked = turn.angle / turn.strokes * np.arange(1, turn.strokes + 1)
    place = np.hypot(*(pose[:, :2] - np.array(of.object_pose[:2])).T)
    outcome = Turned(
        angle=turned[-1],
        error=turned[-1] - turn.angle,
        end_error=_at(t, angle, timetable.duration) - turn.angle,
        shift=_at(t, place, left),
        strokes=tuple(turned),
        tolerance=turn.tolerance,
    )
    if outcome.achieved:
        return outcome
    why = "the mission was stopped before"
    if math.isnan(outcome.error):
        return replace(outcome, reason=why)
    if abs(outcome.error) > turn.tolerance:
        # What was short in one stroke and made up for in the next is no reason: the last stroke is.
        late = [
            k
            for k, error in enumerate(turned - asked)
            if abs(error) > turn.tolerance and np.all(np.abs((turned - asked)[k:]) > turn.tolerance)
        ]
        span = strokes[late[0]][0]
        short = (turned[late[0]] - asked[late[0]]) * math.copysign(1.0, turn.angle)
        why = f"{_short(of, variation, run, contacts, span, short)} (turn {timetable.strokes[late[0]]})"
    elif not math.isnan(outcome.end_error):
        lift = _at(t, angle, timetable.span("lift").start) - turn.angle
        when = "squeezed" if abs(lift) > turn.tolerance else "held and let go"
        why = f"it turned away by {_degrees(outcome.end_error - outcome.error)} while it was {when}"
    return replace(outcome, reason=why)


def _short(
    of: Assignment, variation: Variation, run: ControlRun, contacts: ContactForces, span: Span, short: float
) -> str:
    """Why a stroke ended elsewhere than asked, ``short`` of its angle where negative [rad]."""
    if "tripped" in run.health and run.t[run.health.index("tripped")] < span.end:
        return f"the controller tripped at {run.t[run.health.index('tripped')]:.2f} s"
    during = (run.t >= span.start) & (run.t <= span.end)
    tip = next(k for k, name in enumerate(contacts.names) if contacts.on_finger(name) and name.endswith(_TIP))
    name, normal = contacts.names[tip], contacts.normal_force[during, tip]
    pushing = np.flatnonzero(normal > 0.0)
    if short > 0.0:
        return f"{name} pushed it {_degrees(short)} too far"
    if not pushing.size:
        return f"{name} did not touch it"
    last = float(run.t[during][pushing[-1]])
    if last < 0.5 * (span.start + span.end):
        return f"{name} lost it at {last:.2f} s"
    pressed = f"{name} presses with {normal[pushing[-1]]:.2f} N"
    # 0.98: share of the drive's limit from which on it has no more to give: an estimate of the tension ripples by as
    # much
    if np.any(run.u[during[:-1]][-1] >= 0.98 * run.u_max):
        return f"the drive is at its limit: {pressed}"
    friction = float(plant_friction(of.mission, variation, [name])[0])
    use = contacts.shear[during, tip][pushing] / (friction * normal[pushing])
    # 0.5: share of the time that it pushes in which the fingertip slides, where sliding is called the reason
    if float(np.mean(use >= ON_CONE)) > 0.5:
        return f"{name} slides on it with friction of {friction:.2f}: {pressed}"
    forces = {body: contacts.normal_force[during][:, rows] for body, rows in bodies(contacts.names, [of.name]).items()}
    held = {body: float(force.max(initial=0.0)) for body, force in forces.items() if not contacts.on_finger(body)}
    bears = "".join(f", {body} bears {force:.2f} N" for body, force in held.items() if force > 0.0)
    return f"it stood still, or needs more time: {pressed}{bears}"


def _at(t: Array, values: Array, instant: float) -> float:
    """A value at an instant, to a period; NaN where the mission was stopped before."""
    k = int(np.searchsorted(t, instant - 1e-6))
    near = k == len(t) and k > 1 and instant < 2.0 * t[-1] - t[-2]  # the end of a phase between two periods
    return float(values[-1]) if near else float(values[k]) if k < len(t) else math.nan


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.2g} deg"
