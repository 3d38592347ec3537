"""Why an object was dropped: when which contact gave way, at which limit, and what the certificate says there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from continuum_grasp.arrays import Array
from continuum_grasp.mission.assignment import Assignment
from continuum_grasp.mission.budget import Lowered, bodies, certified_contact, lowered_by_pulls, plant_friction
from continuum_grasp.mission.plant import Timetable, Variation
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
    certified_friction, certified_normal_force, certified_shear : float or None
        The same of the certified grasp, before anything pulls; None at a contact that the grasp does not have.
    """

    contact: str
    how: Literal["slipped", "parted", "absent"]
    time: float
    friction: float
    normal_force: float
    shear: float
    certified_friction: float | None
    certified_normal_force: float | None
    certified_shear: float | None

    @property
    def text(self) -> str:
        """The contact that gave way, and the certificate's numbers beside those of the plant."""
        way = {"slipped": "slipped at", "parted": "parted from", "absent": "not held at"}[self.how]
        head = f"{way} {self.contact} at {self.time:.2f} s: "
        if self.certified_friction is None:
            return f"{head}friction {self.friction:.2f}, pressed by {self.normal_force:.2f} N; not in the certificate"
        cone = f"friction {self.friction:.2f}, certificate needs {self.certified_friction:.2f}; "
        pressed = f"pressed by {self.normal_force:.2f} N, certificate {self.certified_normal_force:.2f} N; "
        return f"{head}{cone}{pressed}bears {self.shear:.2f} N across, certificate {self.certified_shear:.2f} N"


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
                certified_friction=None if certified is None else certified.friction,
                certified_normal_force=None if certified is None else certified.normal_force,
                certified_shear=None if certified is None else certified.shear,
            )
        )
    slips.sort(key=lambda slip: slip.time)
    began = slips[0].time if slips else float(t[end])
    phase = next(span.name for span in timetable.spans if began <= span.end)
    lowered = lowered_by_pulls(assignments, variation) if not slips and phase.startswith("pull ") else ()
    sinks = next((lowering for lowering in lowered if phase == f"pull {lowering.pull}"), None)
    return Drop(float(t[end]), phase, tuple(slips), sinks)
