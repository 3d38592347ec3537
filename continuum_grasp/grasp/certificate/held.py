"""Whether a grasp holds with other friction states: postures of their own, each with all checks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.check import EXACT, GUARDED, Check, worst
from continuum_grasp.grasp.certificate.friction import extreme_states, state_cells
from continuum_grasp.grasp.certificate.recomputed import OF_CONTACTS, OF_FINGER, RecomputedFinger, RecomputedGrasp
from continuum_grasp.grasp.values import YIELDS

Recompute = Callable[[Mapping[str, Any]], tuple[list[Check], RecomputedGrasp | None]]


def held_checks(grasp: RecomputedGrasp, arrays: Mapping[str, Any], recompute: Recompute) -> Iterator[Check]:
    """The checks of arrays stored with ``held.`` before their name, one for each set of friction states."""
    stored = _given(grasp, arrays)
    frictional = _frictional(grasp)
    if not stored and not grasp.scene.state_columns:
        return
    wrong = _misfits(grasp, stored)
    yield Check("missing or misshapen arrays of friction states", float(wrong), 0.0)
    if wrong:
        return
    states = np.concatenate([stored[f"{finger.name}.friction_states"] for finger in frictional], axis=1)
    yield Check("friction states within their range", float(np.abs(states).max() - 1.0), EXACT)
    missing = _missing(states, extreme_states((finger.setup, finger.shape) for finger in frictional))
    yield Check("pulled and released fingers missing from the friction states", float(missing), 0.0)
    postures = held_postures(grasp, arrays)
    yield Check("untested neighbors of the worst friction state", float(_untried(grasp, states, postures)), 0.0)
    for k, posture in enumerate(postures):
        value = worst(*_parts(grasp, posture, recompute).values())
        yield Check(f"held with friction states, {k + 1}", value, 1.0, "limits")


def _untried(grasp: RecomputedGrasp, states: Array, postures: Sequence[Mapping[str, Any]]) -> int:
    """Count the missing sets of states that differ in one cell from the one whose cones have the least reserve.

    To first order the reserve is concave in the states, so that it is least where turning no cell makes it less: that
    these were tried, whoever sought them, the stored arrays show. Of several with the least the best counts.
    """
    # Forces that are no numbers are the worst.
    reserves = np.nan_to_num([_reserve(grasp, posture) for posture in postures], nan=-np.inf)
    worst = states[reserves <= reserves.min() + GUARDED * grasp.force_scale]
    turned = [[np.where(cell, -row, row) for cell in state_cells(grasp.scene)] for row in worst]
    return min(_missing(states, each) for each in turned)


def _missing(states: Array, wanted: Iterable[Array]) -> int:
    """Number of wanted sets of states (K,) that are not among others (S, K)."""
    return sum(not (states == row).all(axis=1).any() for row in wanted)


def _reserve(grasp: RecomputedGrasp, posture: Mapping[str, Any]) -> float:
    """By how much all friction cones of a posture could be narrower [N]."""
    normal, *sideways = np.asarray(posture["contact_forces"], dtype=float).T
    friction = np.array([grasp.scene.held_friction(str(name)) for name in posture["contact_names"]])
    return float((friction * normal - np.hypot(*sideways)).min(initial=np.inf))


def held_postures(grasp: RecomputedGrasp, arrays: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Arrays of the postures that are stored, one for each set of friction states."""
    stored = _given(grasp, arrays)
    postures = []
    for k in range(len(stored["object.pose"]) if stored else 0):
        posture = {**arrays, **{key: value[k] for key, value in stored.items()}}
        # Contacts without a name are clear here, as the penetrations show.
        on = posture["contact_names"] != ""
        postures.append(posture | {key: posture[key][on] for key in OF_CONTACTS})
    return postures


def _given(grasp: RecomputedGrasp, arrays: Mapping[str, Any]) -> dict[str, Array]:
    """Arrays stored under ``held.``, by their names without it; a finger may be called ``held``."""
    reached = {f"held.{key}" for key in (*OF_FINGER, "family") if "held" in grasp.scene.named_fingers}
    held = (key for key in arrays if key.startswith("held.") and key not in reached)
    return {key.removeprefix("held."): np.asarray(arrays[key]) for key in held}


def _frictional(grasp: RecomputedGrasp) -> list[RecomputedFinger]:
    return [finger for finger in grasp.fingers if finger.setup.friction_states]


def _misfits(grasp: RecomputedGrasp, stored: Mapping[str, Array]) -> int:
    """Count arrays of postures that are missing, unknown, or of another number of postures, contacts or states."""
    names = stored.get("contact_names", np.zeros(0))
    count = {f"{finger.name}.friction_states": finger.setup.friction_states for finger in _frictional(grasp)}
    expected = {"object.pose", *OF_CONTACTS, *count, *(f"{f.name}.{key}" for f in grasp.fingers for key in OF_FINGER)}
    wrong = len(expected ^ stored.keys()) + (names.ndim != 2 or 0 in names.shape or not count)
    for key, value in stored.items():
        shared = names.shape if key in OF_CONTACTS else (*names.shape[:1], *([count[key]] if key in count else ()))
        wrong += value.shape[: len(shared)] != shared or (key != "contact_names" and value.dtype.kind not in "fiub")
    return wrong


def _parts(grasp: RecomputedGrasp, arrays: Mapping[str, Any], recompute: Recompute) -> dict[str, float]:
    """The parts of its limits that a posture takes, by name."""
    checks, posture = recompute(arrays)
    if posture is None:
        return {check.name: float("inf") for check in checks if not check.passed}
    parts = {check.name: _part(check) for check in checks}
    # Where the object may be is another limit here.
    moved = np.abs(posture.pose - grasp.pose) / [grasp.size, grasp.size, 1.0]
    fixed = any(contact.finger is None for contact in grasp.contacts) and grasp.scene.object.free is None
    parts["object pose"] = float(moved.max()) / (EXACT if fixed else YIELDS)
    for finger, other in zip(grasp.fingers, posture.fingers, strict=True):
        # Bases are as in the grasp, and so are tensions, or the positions that drives hold.
        off = float(np.abs(other.tensions - finger.tensions).max())
        if finger.wound is not None and other.wound is not None:
            off = other.wound.misfit(finger.wound.held)
        parts[f"tensions that stay, {finger.name}"] = off / finger.setup.tendons.max_tension / EXACT
        moved_base = float(np.abs(other.base - finger.base).max() / finger.length)
        parts[f"base that stays, {finger.name}"] = moved_base / EXACT
    return parts


def _part(check: Check) -> float:
    """The part of its limit that a check takes."""
    limit = GUARDED if check.name.startswith("friction cone") else check.limit
    return check.value / limit if limit > 0.0 else 0.0 if check.passed else float("inf")
