"""Postures of one finger that touch an object where they should, by scans over curvatures and contact positions."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.scan.joint import first_joint, moved_joint, next_joint
from continuum_grasp.grasp.starts.scan.task import FingerTask, Postures, violation
from continuum_grasp.grasp.starts.scan.tip import bent_by_tip, moved_tip, tip_only, with_tip

__all__ = ["neighbors", "postures"]

Array = NDArray[Any]

_SHIFTS = 0.01 * np.array([-1.5, -0.5, 0.5, 1.5])
"""Shifts of the first contact along the finger [L] in a refinement of size one: a sixth of the spacing of the scan."""
_CHANGE = 0.4
"""Change of a knot's curvature [1/L] in a refinement of size one: the spacing of the scans of tips, about."""


def postures(task: FingerTask, middles: tuple[bool, ...], tip: bool) -> Postures | None:
    """All postures found with the middle contacts that are on and, if ``tip``, the tip touching.

    Parameters
    ----------
    task : FingerTask
    middles : tuple of bool
        Which middle contacts are on, from the base.
    tip : bool

    Returns
    -------
    Postures or None
        None where there is none, however much it penetrates.
    """
    if any(middles):
        family = first_joint(task, middles)
        for k in range(middles.index(True) + 1, len(middles)):
            if middles[k] and family is not None:
                family = next_joint(task, family, middles, k)
        if family is None:
            return None
        family = with_tip(task, family) if tip else _free_end(family)
    else:
        joint = task.counts[0] / 2.0 if task.arcs and task.counts == (1, 1) else None
        family = _untouched(task) if not tip else tip_only(task, joint) if task.arcs else bent_by_tip(task)
    if family is None:
        return None
    return _finished(task, family, middles)


def neighbors(
    task: FingerTask, family: Postures, middles: tuple[bool, ...], tip: bool, scale: float
) -> Postures | None:
    """Postures next to those of a family, with the same contacts, at changes of a relative size ``scale``.

    None where there are none or the family has no free parameter.
    """
    found: Postures | None = None
    if sum(middles) == 1 and not (task.arcs and sum(task.counts[: middles.index(True) + 1]) == 1):
        found = moved_joint(task, family, scale * _SHIFTS)
        if found is not None:
            found = with_tip(task, found) if tip else _free_end(found)
    elif not any(middles) and tip:
        found = moved_tip(task, family, scale * _CHANGE)
    return None if found is None else _finished(task, found, middles)


def _finished(task: FingerTask, family: Postures, middles: tuple[bool, ...]) -> Postures:
    joints = _all_joints(task, family.joints, middles)
    wrong = violation(task, family.knots, family.curvatures, joints)
    return replace(family, joints=joints, violation=wrong)


def _free_end(family: Postures) -> Postures:
    """The postures on to a free tip: constant curvature, which no force bends."""
    return replace(
        family,
        knots=np.concatenate([family.knots, np.ones((len(family), 1))], axis=1),
        curvatures=np.concatenate([family.curvatures, family.curvatures[:, -1:]], axis=1),
    )


def _untouched(task: FingerTask) -> Postures:
    """A finger that touches nothing: at rest."""
    none = np.zeros((1, 0))
    bent = np.full((1, 2), task.rest)
    return Postures(np.array([[0.0, 1.0]]), bent, none, none.astype(int), none.astype(complex), none, np.zeros(1))


def _all_joints(task: FingerTask, on: Array, middles: tuple[bool, ...]) -> Array:
    """Positions of all middle contacts: those that are off spread evenly between those that are on."""
    low, high = task.bounds
    count, size = len(on), len(middles)
    if not any(middles):
        shares = np.cumsum(task.counts)[:-1] / sum(task.counts)
        return np.broadcast_to(shares, (count, size)).copy()
    out = np.zeros((count, size))
    places = [k for k in range(size) if middles[k]]
    for column, k in enumerate(places):
        out[:, k] = on[:, column]
    for a, b in pairwise([-1, *places, size]):
        left = out[:, a] if a >= 0 else np.zeros(count)
        right = out[:, b] if b < size else np.ones(count)
        for k in range(a + 1, b):
            out[:, k] = np.clip(left + (right - left) * (k - a) / (b - a), low, high)
    return out
