"""Whether the contacts of a grasp bear enough of what its certificate has, so that the object may be lifted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from continuum_grasp.addons.mission.assignment import Assignment
from continuum_grasp.addons.mission.budget import certified_contact
from continuum_grasp.addons.mission.plan import (
    NOTICED,
    Bearing,
    Grip,
    LiftDecision,
    PhasePlan,
    certified_forces,
)
from continuum_grasp.addons.mission.plant import Timetable, reserve
from continuum_grasp.base import Array, amount_text
from continuum_grasp.control import Stages


@dataclass(frozen=True)
class Shortfall:
    """A contact that bears too little of its normal force in the certificate to lift the object.

    Attributes
    ----------
    contact : str
        Name on the plant: ``finger.1``, ``finger.tip``, of several fingers with each one's name in place of ``finger``.
    normal_force : float
        Force that it bears [N].
    std : float
        Standard deviation of an estimated force [N]; zero where it is computed.
    certified : float
        Normal force of the certified grasp [N].
    needed : float
        Least force that it has to bear: ``phases.lift_share`` of it [N].
    """

    contact: str
    normal_force: float
    std: float
    certified: float
    needed: float

    @property
    def text(self) -> str:
        """Normal force of the contact, and those certified and needed, in words."""
        borne, std, certified, needed = (
            amount_text(force, "N", ".2f", like=self.certified)
            for force in (self.normal_force, self.std, self.certified, self.needed)
        )
        if self.std:
            borne = f"{borne.partition(' ')[0]} +- {std}"
        return f"{self.contact} bears {borne} of {certified} certified ({needed} needed)"


def shortfalls(
    assignments: Sequence[Assignment], names: Sequence[str], forces: Array, stds: Array | None = None
) -> tuple[Shortfall, ...]:
    """Contacts of fingers, by their names on the plant, whose normal forces (C,) [N] are too small to lift."""
    share = assignments[0].mission.phases.lift_share
    lacking = []
    for k, name in enumerate(names):
        certified = certified_contact(assignments, name)
        if share > 0.0 and certified is not None and not forces[k] >= share * certified.normal_force:
            std = 0.0 if stds is None else float(stds[k])
            lacking.append(
                Shortfall(name, float(forces[k]), std, certified.normal_force, share * certified.normal_force)
            )
    return tuple(lacking)


@dataclass(frozen=True)
class NotLifted:
    """Reason for which an object was released without a lift.

    Attributes
    ----------
    time : float
        Time of the decision [s].
    shortfalls : tuple of Shortfall
        Contacts that bear too little, by their estimated forces.
    cause : str
        Cause that keeps the fingers from squeezing harder.
    known : bool
        Whether sensors show the contacts' forces; not where one is silent or contradicts the model.
    """

    time: float
    shortfalls: tuple[Shortfall, ...]
    cause: str
    known: bool = True

    @property
    def text(self) -> str:
        """Time, contacts with both forces, cause, and advice."""
        advice = (
            "See that the object stands where the grasp has it; else try stiffer pads (contact_law.stiffness), more "
            "tension (drive_tension), more time (phases.settle), or a grasp with its object, base or contacts elsewhere"
        )
        if not self.known:
            advice = "Look at the sensors, at the controller's health, and whether the object stands as in the grasp"
        why = "; ".join([*(shortfall.text for shortfall in self.shortfalls), self.cause])
        return f"not lifted at {self.time:.2f} s: {why}. {advice}"


@dataclass(frozen=True)
class Doubted:
    """A lift by forces that sensors contradict all the time."""

    time: float  # when the lift began [s]
    reasons: tuple[str, ...]  # what contradicted which finger's model, with the mismatch

    @property
    def text(self) -> str:
        """Time, and what contradicted the models."""
        return f"lifted at {self.time:.2f} s by estimated forces although {'; '.join(self.reasons)}"


SOFT = 0.010
"""Height lost in the hand up to which an object that is set down does not fall [m]: a fall of as much ends at 0.4
m/s.
"""


@dataclass(frozen=True)
class Slipped:
    """Slip that was noticed while the object was held, and the answer to it."""

    time: float  # when it was noticed, and the fingers squeezed harder [s]
    noticed: str  # sinks: the object lost height in the hand; parts: a contact bore hardly anything, by its estimate
    lost: float  # height lost by then, by what was measured [m]; zero where it is not measured
    firmer: float  # share by which the fingers press harder from then on [1]
    down: float = math.inf  # when the hand began to set it down, because it went on [s]; infinite where it held
    slid: float = 0.0  # height lost in the hand by when it stood [m]: what falls meets the table hard

    @property
    def text(self) -> str:
        """Sign of slip, its time, and the answer."""
        what = f"it sank by {1e3 * self.lost:.2g} mm" if self.noticed == "sinks" else "a contact parted"
        slid = f"it {'fell' if self.slid > SOFT else 'slid'} by {1e3 * self.slid:.2g} mm until it stood"
        if not self.firmer:
            return f"{what} at {self.time:.2f} s: set down, since the fingers have no more force; {slid}"
        end = f", and set down at {self.down:.2f} s, since it went on; {slid}"
        end = ", which held it" if math.isinf(self.down) else end
        return f"{what} at {self.time:.2f} s: squeezed {100.0 * self.firmer:.0f} % harder{end}"


class LiftCheck:
    """Decides before the lift, for all fingers at once, whether the object is lifted or let go.

    Where a contact bears too little by the estimate, or sensors contradict a finger's model, the fingers squeeze on,
    following their held forces, for as long as the squeeze took at most; then they let go, or lift in doubt by forces
    that are enough. Where a finger is blind, all let go at once. What one finger notices while the object is held,
    all answer.

    What follows the decision is moved in the ``timetable``; ``refused`` says why the object was not lifted, ``doubted``
    what contradicted a lift, ``slipped`` what was noticed of slip while it was held.
    """

    def __init__(self, assignments: Sequence[Assignment]) -> None:
        self._of = tuple(assignments)
        self.timetable = Timetable(assignments[0])
        self._plans: list[PhasePlan] = []
        self._seen: dict[int, Any] = {}
        self._over = False
        self.refused: NotLifted | None = None
        self.doubted: Doubted | None = None
        self.slipped: Slipped | None = None

    def schedule(self, finger: int, stages: Stages) -> PhasePlan:
        """The phases of a finger, by number, which ask before the lift."""
        table = Timetable(self._of[finger])
        certified = certified_forces(self._of, self._of[finger])
        leads = finger == 0
        reported = self._others if leads else lambda: self._plans[0].decision
        waits = partial(self._waited, finger)
        plan = PhasePlan(table, stages, certified, leads=leads, reported=reported, waits=waits, grips=self._firmest)
        self._plans.append(plan)
        return plan

    def _firmest(self, t: float) -> int:
        """The firmest grip of all fingers, which each takes over; notes what made it so."""
        plan = max(self._plans, key=lambda candidate: candidate.grip)
        if plan.grip != Grip.USUAL and self.slipped is None:
            more = 0.0 if self._of[0].standing else min(reserve(assignment) for assignment in self._of)
            self.slipped = Slipped(t, NOTICED[plan.noticed], max(plan.lost, 0.0), more)
        if plan.grip == Grip.SETS_DOWN and self.slipped is not None and math.isinf(self.slipped.down):
            self.slipped = replace(self.slipped, down=t)
            self.timetable.set_down(t)
        return plan.grip

    def _others(self) -> int:
        """Report of the others to the first finger, which decides for all: what they estimated a period before."""
        others = [plan.bears for plan in self._plans[1:]]
        first_of = (Bearing.BLIND, Bearing.UNKNOWN, Bearing.LACKS, Bearing.DOUBTS)
        return next((word for word in first_of if word in others), Bearing.BEARS)

    def _waited(self, finger: int, t: float, command: Any) -> None:
        """Note what was decided, and for which forces."""
        if self._over:
            return
        self._seen[finger] = command
        decision = self._plans[0].decision
        self._over = decision != LiftDecision.WAITS and finger == 0
        if self._over and decision == LiftDecision.LETS_GO:
            lacking = () if Bearing.BLIND in [plan.bears for plan in self._plans] else self._lacking()
            self.refused = NotLifted(t, lacking, self._cause(), known=not self._doubts())
        elif self._over and Bearing.DOUBTS in [plan.bears for plan in self._plans]:
            self.doubted = Doubted(t, self._doubts())
        following = "release" if decision == LiftDecision.LETS_GO else "lift"
        self.timetable.resume(t if self._over else self.timetable.latest, following)

    def _lacking(self) -> tuple[Shortfall, ...]:
        lacking = list[Shortfall]()
        for k, assignment in enumerate(self._of):
            forces = self._seen[k].contact_forces
            names = assignment.control.contact_names
            lacking += shortfalls(self._of, [assignment.own_name(name) for name in names], forces.force, forces.std)
        return tuple(lacking)

    def _doubts(self) -> tuple[str, ...]:
        fingers = [(self._of[k].name, self._seen[k]) for k in sorted(self._seen)]
        reasons = ((name, command.doubt, command.mismatch) for name, command in fingers)
        return tuple(f"{why} of {name} (mismatch {mismatch:.3g})" for name, why, mismatch in reasons if why)

    def _cause(self) -> str:
        """Cause that keeps the fingers from squeezing harder."""
        worst = max(sorted(self._seen), key=lambda finger: self._seen[finger].sight)
        if why := self._seen[worst].doubt:
            return f"{why}, and what {self._of[worst].name} bears is not known"
        reached = []
        for k, assignment in enumerate(self._of):
            command = self._seen[k]
            names = assignment.control.contact_names
            if "tensions" in assignment.control.finger.input_keys:
                limits = np.array([tendon.max_tension for tendon in assignment.control.finger.tendon_list])
                # 0.999: share of the greatest tension from which on a drive is at its limit: commands reach it to
                # solver accuracy
                if (command.u >= 0.999 * limits).any():
                    return f"the drive of {assignment.name} is at its limit of {amount_text(limits.max(), 'N')}"
            normal = command.contact_forces.force[names.index(assignment.contact)]
            force, followed = (
                amount_text(newtons, "N", ".2f", like=assignment.force) for newtons in (normal, assignment.force)
            )
            reached.append(f"{force} of {followed} at {assignment.own_name(assignment.contact)}")
        return (
            f"the forces that are followed are {', '.join(reached)}: the object stands elsewhere, or gave way on its "
            "contacts, or a finger lies elsewhere than in the grasp"
        )
