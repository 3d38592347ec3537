"""Whether a grasp holds with other friction states: postures of their own, each with all checks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.check import CONES, LIMIT, Check, worst
from continuum_grasp.grasp.certificate.friction import pulled_states
from continuum_grasp.grasp.certificate.postures import YIELDS
from continuum_grasp.grasp.certificate.recomputed import OF_CONTACTS, OF_FINGER, RecomputedFinger, RecomputedGrasp
from continuum_grasp.grasp.certificate.state_search import StateSearch, search_states

Array = NDArray[Any]
Recompute = Callable[[Mapping[str, Any]], tuple[list[Check], RecomputedGrasp | None]]


def held_checks(grasp: RecomputedGrasp, arrays: Mapping[str, Any], recompute: Recompute) -> Iterator[Check]:
    """The checks of what is stored with ``held.`` before its name, one for each set of friction states."""
    given, frictional = _given(grasp, arrays), _frictional(grasp)
    if not given and not grasp.scene.state_columns:
        return
    wrong = _misfits(grasp, given)
    yield Check("arrays of friction states that are missing or do not fit", float(wrong), 0.0)
    if wrong:
        return
    states = np.concatenate([given[f"{finger.name}.friction_states"] for finger in frictional], axis=1)
    yield Check("friction states within their range", float(np.abs(states).max() - 1.0), LIMIT)
    pulled = [np.where(pulled_states(f.setup, f.shape) < 0.0, -1.0, 1.0) for f in frictional]
    ways = (
        np.concatenate([w * own for w, own in zip(way, pulled, strict=True)])
        for way in product((1.0, -1.0), repeat=len(pulled))
    )
    missing = sum(not (states == way).all(axis=1).any() for way in ways)
    yield Check("pulled and released fingers that are not among the friction states", float(missing), 0.0)
    for k, (_, own) in enumerate(held_postures(grasp, arrays)):
        value = worst(*_parts(grasp, own, recompute).values())
        yield Check(f"held with friction states, {k + 1}", value, 1.0, "1", "limits")


def held_postures(grasp: RecomputedGrasp, arrays: Mapping[str, Any]) -> Iterator[tuple[Array, Mapping[str, Any]]]:
    """Sets of friction states (K,) that are stored, and the arrays of their postures."""
    given = _given(grasp, arrays)
    for k in range(len(given["object.pose"]) if given else 0):
        own = {**arrays, **{key: value[k] for key, value in given.items()}}
        # Contacts without a name are clear here, as the penetrations show.
        on = own["contact_names"] != ""
        own |= {key: own[key][on] for key in OF_CONTACTS}
        yield np.concatenate([own[f"{finger.name}.friction_states"] for finger in _frictional(grasp)]), own


def _given(grasp: RecomputedGrasp, arrays: Mapping[str, Any]) -> dict[str, Array]:
    """Arrays stored under ``held.``, by their names without it; a finger may be called ``held``."""
    reached = {f"held.{key}" for key in (*OF_FINGER, "family") if "held" in grasp.scene.named_fingers}
    held = (key for key in arrays if key.startswith("held.") and key not in reached)
    return {key.removeprefix("held."): np.asarray(arrays[key]) for key in held}


def _frictional(grasp: RecomputedGrasp) -> list[RecomputedFinger]:
    return [finger for finger in grasp.fingers if finger.setup.friction_states]


def _misfits(grasp: RecomputedGrasp, given: Mapping[str, Array]) -> int:
    """Count arrays of postures that are missing, unknown, or of another number of postures, contacts or states."""
    names = given.get("contact_names", np.zeros(0))
    count = {f"{finger.name}.friction_states": finger.setup.friction_states for finger in _frictional(grasp)}
    expected = {"object.pose", *OF_CONTACTS, *count, *(f"{f.name}.{key}" for f in grasp.fingers for key in OF_FINGER)}
    wrong = len(expected ^ given.keys()) + (names.ndim != 2 or 0 in names.shape or not count)
    for key, value in given.items():
        shared = names.shape if key in OF_CONTACTS else (*names.shape[:1], *([count[key]] if key in count else ()))
        wrong += value.shape[: len(shared)] != shared or (key != "contact_names" and value.dtype.kind not in "fiub")
    return wrong


def searched(grasp: RecomputedGrasp, arrays: Mapping[str, Any], recompute: Recompute) -> StateSearch | None:
    """The certificate's own search for worse friction states than those that are stored; None where none are."""
    held = list(held_postures(grasp, arrays))
    return search_states(grasp, held, lambda own: _parts(grasp, own, recompute)) if held else None


def _parts(grasp: RecomputedGrasp, own: Mapping[str, Any], recompute: Recompute) -> dict[str, float]:
    """The parts of its limits that a posture takes, by name."""
    checks, posture = recompute(own)
    if posture is None:
        return {check.name: float("inf") for check in checks if not check.passed}
    parts = {check.name: _part(check) for check in checks}
    # Where the object may be is another limit here.
    moved = np.abs(posture.pose - grasp.pose) / [grasp.size, grasp.size, 1.0]
    fixed = any(contact.finger is None for contact in grasp.contacts) and grasp.scene.object.free is None
    parts["object pose"] = float(moved.max()) / (LIMIT if fixed else YIELDS)
    for finger, other in zip(grasp.fingers, posture.fingers, strict=True):
        # Bases are those of the grasp, and tensions, or what drives hold in their place.
        off = float(np.abs(other.tensions - finger.tensions).max())
        if finger.wound is not None and other.wound is not None:
            off = other.wound.misfit(finger.wound.held)
        parts[f"tensions that stay, {finger.name}"] = off / finger.setup.tendons.max_tension / LIMIT
        moved_base = float(np.abs(other.base - finger.base).max() / finger.length)
        parts[f"base that stays, {finger.name}"] = moved_base / LIMIT
    return parts


def _part(check: Check) -> float:
    """The part of its limit that a check takes."""
    limit = CONES if check.name.startswith("friction cone") else check.limit
    return check.value / limit if limit > 0.0 else 0.0 if check.passed else float("inf")
