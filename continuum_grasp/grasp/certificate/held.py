"""Whether a grasp holds with other friction states: postures of their own, each with all checks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.check import CONES, LIMIT, Check, worst
from continuum_grasp.grasp.certificate.friction import pulled_states
from continuum_grasp.grasp.certificate.postures import YIELDS
from continuum_grasp.grasp.certificate.recomputed import RecomputedGrasp
from continuum_grasp.grasp.certificate.state_search import StateSearch, search_states

Array = NDArray[Any]
Recompute = Callable[[Mapping[str, Any]], tuple[list[Check], RecomputedGrasp | None]]


def held_checks(grasp: RecomputedGrasp, arrays: Mapping[str, Any], recompute: Recompute) -> Iterator[Check]:
    """The checks of what is stored with ``held.`` before its name, one for each set of friction states."""
    given = {key.removeprefix("held."): np.asarray(value) for key, value in arrays.items() if key.startswith("held.")}
    if not given:
        return
    frictional = [finger for finger in grasp.fingers if finger.setup.friction_states]
    states = np.concatenate([given[f"{finger.name}.friction_states"] for finger in frictional], axis=1)
    yield Check("friction states within their range", float(np.abs(states).max() - 1.0), LIMIT)
    slid = np.concatenate([pulled_states(finger.setup, finger.shape) for finger in frictional])
    pulled = np.where(slid < 0.0, -1.0, 1.0)
    missing = [not (states == way * pulled).all(axis=1).any() for way in (1.0, -1.0)]
    yield Check("pulled and released fingers that are not among the friction states", float(sum(missing)), 0.0)
    for k, (_, own) in enumerate(held_postures(grasp, arrays)):
        value = worst(*_parts(grasp, own, recompute).values())
        yield Check(f"held with friction states, {k + 1}", value, 1.0, "1", "limits")


def held_postures(grasp: RecomputedGrasp, arrays: Mapping[str, Any]) -> Iterator[tuple[Array, Mapping[str, Any]]]:
    """Sets of friction states (K,) that are stored, and the arrays of their postures."""
    given = {key.removeprefix("held."): np.asarray(value) for key, value in arrays.items() if key.startswith("held.")}
    reached = {key: value for key, value in arrays.items() if not key.startswith("held.")}
    names = [finger.name for finger in grasp.fingers if finger.setup.friction_states]
    for k in range(len(given["object.pose"]) if given else 0):
        own = {**reached, **{key: value[k] for key, value in given.items()}}
        # Contacts without a name are clear here, as the penetrations show.
        on = own["contact_names"] != ""
        own |= {key: value[on] for key, value in own.items() if key.startswith("contact_")}
        yield np.concatenate([own[f"{name}.friction_states"] for name in names]), own


def searched(grasp: RecomputedGrasp, arrays: Mapping[str, Any], recompute: Recompute) -> StateSearch | None:
    """The certificate's own search for worse friction states than those that are stored; None where none are."""
    held = list(held_postures(grasp, arrays))
    return search_states(grasp, held, lambda own: _parts(grasp, own, recompute)) if held else None


def _parts(grasp: RecomputedGrasp, own: Mapping[str, Any], recompute: Recompute) -> dict[str, float]:
    """The parts of its limits that a posture takes, by name."""
    checks, posture = recompute(own)
    if posture is None:
        return {check.name: float("inf") for check in checks if not check.passed}
    # Where the object may be is another limit here.
    parts = {check.name: _part(check) for check in checks if check.name != "object pose"}
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
