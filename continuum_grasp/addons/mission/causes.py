"""Why an object was dropped, or not turned as asked: when which contact gave way, at which limit, and what the
certificate says there; how far a turn came; which controller gave up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from continuum_grasp.addons.mission.budget import CertifiedContact, Lowered, bodies, certified_contact, lowered_by_pulls
from continuum_grasp.addons.mission.plant import Span
from continuum_grasp.addons.mission.record import MissionRecord
from continuum_grasp.base import Array, amount_text

CLEAR = 0.003
"""Distance from the object at which the approach ends, and to which fingers open again [m]."""
FALLEN = 0.005
"""Height that an object loses before it counts as dropped [m]."""
ON_CONE = 0.99
"""Share of the friction cone from which a contact slips: friction is smooth, and reaches the cone in the limit only."""


@dataclass(frozen=True)
class SlippedContact:
    """A contact that gave way before the object fell, with the forces at this instant [N]."""

    contact: str  # name on the plant, as of ``Shortfall``, or that of a support, whose corners count together
    how: Literal["slipped", "parted", "absent"]  # at its friction cone, without normal force, or so before the lift
    time: float  # from when on, until the object had fallen [s]; of what was absent, when the lift began
    friction: float  # coefficient [1]
    normal_force: float
    shear: float
    certified: CertifiedContact | None  # the same of the grasp, before anything pulls; None: it has no such contact

    @property
    def text(self) -> str:
        """The contact that gave way, and the certificate's numbers beside the plant's."""
        way = {"slipped": "slipped at", "parted": "parted from", "absent": "not held at"}[self.how]
        head = f"{way} {self.contact} at {self.time:.2f} s: "
        if (certified := self.certified) is None:
            return f"{head}friction {self.friction:.2f}, pressed by {_force(self.normal_force)}; not in the certificate"
        cone = f"friction {self.friction:.2f}, certificate needs {certified.friction:.2f}; "
        pressed = f"pressed by {_force(self.normal_force)}, certificate {_force(certified.normal_force)}; "
        return f"{head}{cone}{pressed}bears {_force(self.shear)} across, certificate {_force(certified.shear)}"


@dataclass(frozen=True)
class Drop:
    """An object that was dropped."""

    time: float  # when it had lost 5 mm of height [s]
    phase: str  # in which the first contact gave way
    slips: tuple[SlippedContact, ...]  # contacts that gave way and stayed so until then, the first one first
    lowered: Lowered | None = None  # by a pull in the plane at which none gave way: how far it lowers what is held

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


def find_drop(record: MissionRecord, sunk: Array) -> Drop | None:
    """Why an object fell; None where it did not.

    ``sunk`` (K + 1,) is the height that it lost since the lift began; zero before, and where it does not count [m].
    """
    fallen = np.flatnonzero(sunk >= FALLEN)
    if not fallen.size:
        return None
    end = int(fallen[0])
    t = record.t
    contacts = record.contacts
    friction = record.friction
    lift = record.timetable.span("lift").start
    slips = []
    for name, rows in bodies(contacts.names, [assignment.name for assignment in record.assignments]).items():
        normal = contacts.normal_force[:, rows]
        shear = contacts.shear[:, rows]
        gone = np.all(shear >= ON_CONE * friction[:, rows] * normal, axis=1)  # also where nothing presses
        gone[1:-1] |= gone[:-2] & gone[2:]  # friction that turns is within the cone for an instant
        firm = np.flatnonzero(~gone[: end + 1])
        begin = int(firm[-1]) + 1 if firm.size else 0
        certified = certified_contact(record.assignments, name)
        if begin > end or (certified is None and t[begin] < lift):
            continue  # firm until the end, or nothing that had to hold
        at = max(begin, int(np.searchsorted(t, lift)))
        pressed = float(normal[at].sum())
        how: Literal["slipped", "parted", "absent"] = "slipped" if pressed > 0.0 else "parted"
        if at > begin:
            how = "absent"
        slips.append(
            SlippedContact(
                contact=name,
                how=how,
                time=float(t[at]),
                friction=float(friction[at, rows[0]]),
                normal_force=pressed,
                shear=float(shear[at].sum()),
                certified=certified,
            )
        )
    slips.sort(key=lambda slip: slip.time)
    began = slips[0].time if slips else float(t[end])
    phase = next(span.name for span in record.timetable.spans if began <= span.end)
    pulled = not slips and phase.startswith("pull ")
    lowered = lowered_by_pulls(record.assignments, record.variation) if pulled else ()
    sinks = next((lowering for lowering in lowered if phase == f"pull {lowering.pull}"), None)
    return Drop(float(t[end]), phase, tuple(slips), sinks)


@dataclass(frozen=True)
class Tripped:
    """A controller that sent its command to the safe input and left it there, within the limits of the phases."""

    time: float  # when it did, the first of all fingers [s]
    finger: str  # whose it is
    reason: str  # what contradicted its model, and the likely cause

    @property
    def text(self) -> str:
        """Finger, time and reason."""
        return f"{self.finger} at {self.time:.2f} s: {self.reason}"


def find_tripped(record: MissionRecord) -> Tripped | None:
    """The first controller that tripped; None where none did."""
    fingers = zip(record.assignments, record.runs, strict=True)
    trips = [
        Tripped(t, assignment.name, text)
        for assignment, run in fingers
        for t, health, text in run.incidents
        if health == "tripped"
    ]
    return min(trips, key=lambda trip: trip.time, default=None)


@dataclass(frozen=True)
class Touching:
    """Contacts of fingers that still touch the object in the end."""

    forces: tuple[tuple[str, float], ...]  # their names on the plant, and what they bear [N]
    away: float  # distance of the object from where the grasp has it [m]

    @property
    def text(self) -> str:
        """Contacts, forces, where the object stands, and advice."""
        each = ", ".join(f"{name} presses with {amount_text(force, 'N', '.2g')}" for name, force in self.forces)
        where = f"{each} in the end; the object stands {1e3 * self.away:.2g} mm from where the grasp has it"
        if self.away < CLEAR:
            return f"{where}: try more time (phases.release)"
        return f"{where}, in the way of fingers that open to {1e3 * CLEAR:g} mm from there"


def find_touching(record: MissionRecord) -> Touching | None:
    """Contacts of fingers that touch at the end of a mission; None where none does."""
    contacts = record.contacts
    grasp = np.array(record.assignments[0].object_pose[:2])
    last = zip(contacts.names, contacts.normal_force[-1].tolist(), strict=True)
    forces = tuple((name, force) for name, force in last if contacts.on_finger(name) and force > 0.0)
    away = float(np.linalg.norm(record.object_pose[-1, :2] - grasp))
    return Touching(forces, away) if forces else None


_TIP = ".tip"


@dataclass(frozen=True)
class Turned:
    """Outcome of a turn; NaN for angles and times that were not reached."""

    angle: float  # by which the object was turned when the finger had left it, counter-clockwise [rad]
    error: float  # of the object's angle then, against that in the grasp [rad]
    end_error: float  # the same at the end of the mission, after it was held and let go [rad]
    shift: float  # distance of the object from where the grasp has it when the finger had left it [m]
    strokes: tuple[float, ...]  # by how much it was turned from its first angle when each stroke had ended [rad]
    tolerance: float  # of both errors [rad]
    reason: str = ""  # why an error exceeds it; empty where none does

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


def find_turned(record: MissionRecord) -> Turned | None:
    """Turn of the object; None where none was asked for."""
    of = record.assignments[0]
    turn = record.mission.turn
    timetable = record.timetable
    if turn is None:
        return None
    t, pose = record.t, record.object_pose
    angle = pose[:, 2] - (of.object_pose[2] - turn.angle)
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
    why = "the mission was stopped before" if math.isfinite(left) else "the finger let go before"
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
        why = f"{_short(record, span, short)} (turn {timetable.strokes[late[0]]})"
    elif not math.isnan(outcome.end_error):
        lift = _at(t, angle, timetable.span("lift").start) - turn.angle
        when = "squeezed" if abs(lift) > turn.tolerance else "held and let go"
        why = f"it turned away by {_degrees(outcome.end_error - outcome.error)} while it was {when}"
    return replace(outcome, reason=why)


def _short(record: MissionRecord, span: Span, short: float) -> str:
    """Why a stroke ended elsewhere than asked, ``short`` of its angle where negative [rad]."""
    run = record.runs[0]
    contacts = record.contacts
    if "tripped" in run.health and run.t[run.health.index("tripped")] < span.end:
        return f"the controller tripped at {run.t[run.health.index('tripped')]:.2f} s"
    during = (run.t >= span.start) & (run.t <= span.end)
    tip = next(k for k, name in enumerate(contacts.names) if contacts.on_finger(name) and name.endswith(_TIP))
    name = contacts.names[tip]
    normal = contacts.normal_force[during, tip]
    pushing = np.flatnonzero(normal > 0.0)
    if short > 0.0:
        return f"{name} pushed it {_degrees(short)} too far"
    if not pushing.size:
        return f"{name} did not touch it"
    last = float(run.t[during][pushing[-1]])
    if last < 0.5 * (span.start + span.end):
        return f"{name} lost it at {last:.2f} s"
    pressed = f"{name} presses with {_force(normal[pushing[-1]])}"
    # 0.98: share of the drive's limit from which on it has no more to give: an estimate of the tension ripples by as
    # much
    if np.any(run.u[during[:-1]][-1] >= 0.98 * run.u_max):
        return f"the drive is at its limit: {pressed}"
    friction = float(record.friction[0, tip])
    use = contacts.shear[during, tip][pushing] / (friction * normal[pushing])
    # 0.5: share of the time that it pushes in which the fingertip slides, where sliding is called the reason
    if float(np.mean(use >= ON_CONE)) > 0.5:
        return f"{name} slides on it with friction of {friction:.2f}: {pressed}"
    groups = bodies(contacts.names, [record.assignments[0].name]).items()
    forces = {body: contacts.normal_force[during][:, rows] for body, rows in groups}
    held = {body: float(force.max(initial=0.0)) for body, force in forces.items() if not contacts.on_finger(body)}
    bears = "".join(f", {body} bears {_force(force)}" for body, force in held.items() if force > 0.0)
    return f"it stood still, or needs more time: {pressed}{bears}"


def _force(size: float) -> str:
    return amount_text(size, "N", ".2f")


def _at(t: Array, values: Array, instant: float) -> float:
    """A value at an instant, to a period; NaN where the mission was stopped before."""
    k = int(np.searchsorted(t, instant - 1e-6))
    near = k == len(t) and k > 1 and instant < 2.0 * t[-1] - t[-2]  # the end of a phase between two periods
    if near:
        return float(values[-1])
    if k < len(t):
        return float(values[k])
    return math.nan


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.2g} deg"
