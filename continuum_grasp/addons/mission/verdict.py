"""The verdict on a mission: held or dropped, and how well."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.mission.assignment import Assignment, present
from continuum_grasp.addons.mission.budget import is_table
from continuum_grasp.addons.mission.causes import (
    FALLEN,
    Drop,
    Touching,
    Tripped,
    Turned,
    find_drop,
    find_touching,
    find_tripped,
    find_turned,
)
from continuum_grasp.addons.mission.lift import SOFT, Doubted, NotLifted, Slipped
from continuum_grasp.addons.mission.record import MissionRecord
from continuum_grasp.base import Array
from continuum_grasp.closed_loop import ControlRun

_SETTLED = 0.5
"""Last share of the hold over which forces are judged."""
_FALLBACKS = ("previous_plan", "safe_ramp")
"""Statuses of commands that are not of a new plan."""

_WORDS = {
    "tripped": "tripped",
    "refused": "not lifted",
    "doubted": "lifted in doubt",
    "slipped": "slipped",
    "drop": "dropped",
    "touching": "not released",
    "turned": "turned",
}
"""Attributes of a verdict that explain something, and what that is called."""


@dataclass(frozen=True)
class MissionVerdict:
    """A mission in numbers, as ``TrialsResult`` stores them; NaN for what was not reached.

    Forces are smoothed over 0.1 s, and looked at in the second half of the hold.
    """

    held: bool
    sunk: float
    moved: float
    force_error: float
    force_mean_error: float
    force_estimate_error: float
    force_estimate_std: float
    slip_margin: float
    pulled_margin: float
    released: bool
    fallbacks: int
    drop: Drop | None = None
    """Why the object was dropped; None where it was not."""
    refused: NotLifted | None = None
    """Why it was let go without a lift; None where it was lifted."""
    slipped: Slipped | None = None
    """Slip that was noticed, and the answer; None where none was, or where it is not watched."""
    turned: Turned | None = None
    """Turn of the object before it was grasped; None where that was not asked for."""
    tripped: Tripped | None = None
    """The first controller that gave up; None where none did."""
    touching: Touching | None = None
    """Contacts that were not released; None where all were, or the mission did not come to that."""
    doubted: Doubted | None = None
    """A lift by forces that sensors contradicted; None where they agreed."""

    @property
    def status(self) -> str:
        """``finished`` where it succeeded, or ``lifted_in_doubt``; else what prevented that: the first of
        ``tripped``, ``not_lifted``, ``dropped``, ``stopped``, ``set_down``, ``not_released`` and ``not_turned``.
        """
        prevents = {
            "tripped": self.tripped is not None,
            "not_lifted": self.refused is not None,
            "dropped": self.drop is not None,
            "stopped": not self.held,
            "set_down": self.set_down,
            "not_released": not self.released,
            "not_turned": self.turned is not None and not self.turned.achieved,
            "lifted_in_doubt": self.doubted is not None,
        }
        return next((status for status, applies in prevents.items() if applies), "finished")

    @property
    def succeeded(self) -> bool:
        """Turned if asked for, held from lift to lowering, and let go, by controllers that did not trip."""
        return self.status in ("finished", "lifted_in_doubt")

    @property
    def set_down(self) -> bool:
        """Whether the object was set down before the planned lowering, because it slipped."""
        return self.held and self.slipped is not None and self.slipped.down < np.inf

    @property
    def word(self) -> str:
        """Outcome for the object, in a word, with whether a controller tripped and whether the lift was in doubt."""
        if self.refused is not None:
            ending = "not lifted, released" if self.released else "not lifted, not released"
        else:
            end = "set down" if self.set_down else "held"
            ending = f"{end} and released" if self.released else f"{end}, not released"
            if not self.held:
                ending = "stopped" if self.drop is None else "dropped"
        if self.turned is not None:
            ending = f"{'turned' if self.turned.achieved else 'not turned'}, {ending}"
        if self.doubted is not None:
            ending = f"{ending}, lifted in doubt"
        return ending if self.tripped is None else f"tripped, {ending}"

    @property
    def explained(self) -> dict[str, str]:
        """Sentences on a trip, a refused or doubted lift, slip, a drop and a turn, by attribute, where there is one."""
        return {name: getattr(self, name).text for name in _WORDS if getattr(self, name) is not None}

    @property
    def texts(self) -> dict[str, str]:
        """Sentences by what happened, and why it was not turned as asked."""
        why = "" if self.turned is None else self.turned.reason
        return {_WORDS[name]: text for name, text in self.explained.items()} | ({"not turned": why} if why else {})

    def pairs(self) -> dict[str, str]:
        """Values with their units, by name."""
        return {
            "object": self.word,
            **self.texts,
            "sunk": f"{1e3 * self.sunk:.3g} mm from lift to lowering (dropped: {1e3 * FALLEN:g} mm)",
            "moved": f"{1e3 * self.moved:.3g} mm in the plane, pulls included",
            "held force": f"{_percent(self.force_error)} off its setpoint at most, "
            f"{_percent(self.force_mean_error)} in the mean (second half of the hold)",
            "its estimate": f"{_percent(self.force_estimate_error)} off the plant's in the mean, "
            f"standard deviation {_percent(self.force_estimate_std)}",
            "slip margin": f"{self.slip_margin:.2f} of the friction cone, {self.pulled_margin:.2f} while pulled",
            "fallbacks": f"{self.fallbacks}",
        }


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"


def judge(
    record: MissionRecord,
    refused: NotLifted | None = None,
    slipped: Slipped | None = None,
    doubted: Doubted | None = None,
) -> MissionVerdict:
    """The verdict on a mission, read off the plant; ``refused`` is why nothing was lifted, ``slipped`` what was noticed
    of slip, ``doubted`` what contradicted the lift.
    """
    pose, t = record.object_pose, record.t
    lift, hold, lower = (record.timetable.span(name) for name in ("lift", "hold", "lower"))
    carried = (t >= lift.start) & (t <= lower.start)
    whole = bool(t[-1] >= lower.start)  # a mission that was stopped before counts as not held
    # Of what was lifted, until it stands: heights before the lift do not count.
    lost = np.zeros(len(t))
    height = record.mission.object_height(pose)
    until = (t >= lift.start) & (t <= lower.end)
    lost[until] = height[until][:1] - height[until]
    sunk = float(np.max(lost[carried], initial=0.0))
    slid = float(np.max(lost[until], initial=0.0))
    if slipped is not None and slipped.down < np.inf:
        slipped = replace(slipped, slid=slid)
    if slid <= SOFT:
        lost[~carried] = 0.0
    drop = find_drop(record, lost)
    ended = whole or refused is not None
    touching = find_touching(record) if ended else None
    margins = _margins(record)
    return MissionVerdict(
        held=whole and drop is None,
        sunk=sunk,
        moved=float(np.linalg.norm(pose[carried, :2] - pose[carried][:1, :2], axis=1).max(initial=0.0)),
        **_force_errors(record, (t >= hold.end - _SETTLED * (hold.end - hold.start)) & (t <= hold.end)),
        slip_margin=_over(np.min, margins[(t >= hold.start) & (t <= hold.end)]),
        pulled_margin=_over(np.min, margins[(t > hold.end) & (t < lower.start)]),
        released=ended and touching is None,
        fallbacks=sum(word in _FALLBACKS for run in record.runs for word in run.status),
        drop=drop,
        refused=refused,
        slipped=slipped,
        turned=find_turned(record),
        tripped=find_tripped(record),
        touching=touching,
        doubted=doubted,
    )


def _force_errors(record: MissionRecord, still: NDArray[np.bool_]) -> dict[str, float]:
    """Errors of held forces and of their estimates over some instants (K + 1,), per setpoint: the worst of all."""
    # 0.1: time over which forces are averaged before their greatest error is taken [s]
    window = max(1, round(0.1 / record.runs[0].period))
    errors = list[Array]()
    means = list[float]()
    estimates = list[tuple[float, float]]()
    for assignment, run in zip(record.assignments, record.runs, strict=True):
        for name, wanted in assignment.forces.items():
            force, setpoint = (each[:, run.r_names.index(f"contact_force_{name} [N]")] for each in (run.tracked, run.r))
            share = force / np.where(setpoint > 0.0, setpoint, wanted)
            errors.append(np.abs(_smoothed(share, window)[still] - 1.0))
            means.append(_over(np.mean, share[still] - 1.0))
            if name == assignment.contact:
                believed, std = force_estimate(assignment, run)
                off = _over(np.mean, ((believed - force[:-1]) / wanted)[still[:-1]])
                estimates.append((off, float(np.sqrt(_over(np.mean, std[still[:-1]] ** 2))) / wanted))
    worst = int(np.argmax(np.abs([off for off, _ in estimates])))
    return {
        "force_error": _over(np.max, np.concatenate(errors)),
        "force_mean_error": max(means, key=abs),
        **dict(zip(("force_estimate_error", "force_estimate_std"), estimates[worst], strict=True)),
    }


def _margins(record: MissionRecord) -> Array:
    """Share of the friction cone (K + 1, contacts) that is left at each contact but the table's."""
    bearing = [k for k, name in enumerate(record.contacts.names) if not is_table(name)]
    normal = record.contacts.normal_force[:, bearing]
    limits = record.friction[:, bearing] * normal
    margins = 1.0 - record.contacts.shear[:, bearing] / np.maximum(limits, 1e-9)
    # Where hardly anything presses, the cone is too small for its share to mean something.
    # 0.05: share of the held force below which a contact's friction is not judged
    margins[normal < 0.05 * min(assignment.force for assignment in record.assignments)] = 1.0
    return np.asarray(margins)


def force_estimate(assignment: Assignment, run: ControlRun) -> tuple[Array, Array]:
    """Normal force (K,) of a finger's held contact as its controller estimated it, and its standard deviation [N]."""
    held = run.touch_names.index(assignment.contact)
    return present(run.contact_force_estimate)[:, held], present(run.contact_force_std)[:, held]


def _smoothed(values: Array, window: int) -> Array:
    """Moving average over a window, shorter at both ends: sums divided by the number of values in them."""
    kernel = np.ones(min(window, len(values)))
    smoothed: Array = np.convolve(values, kernel, "same") / np.convolve(np.ones_like(values), kernel, "same")
    return smoothed


def _over(reduce: Callable[[Array], Any], values: Array) -> float:
    return float(reduce(values)) if values.size else np.nan
