"""Turn of an object before its grasp, and causes why it was not turned as asked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.closed_loop.result import ControlRun
from continuum_grasp.mission.assignment import Assignment
from continuum_grasp.mission.budget import bodies, plant_friction
from continuum_grasp.mission.drop import ON_CONE
from continuum_grasp.mission.plant import Span, Timetable, Variation
from continuum_grasp.simulation.contacts import ContactForces

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
