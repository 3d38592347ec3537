"""Checks of a grasp's contacts: that they are where the scene has them, touch, and bear what they can."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from continuum_grasp.grasp.certificate.check import GAP, LIMIT, Check, worst
from continuum_grasp.grasp.certificate.recomputed import RecomputedContact, RecomputedGrasp, known_contacts
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity
from continuum_grasp.scene.supports import Peg, Wall

__all__ = ["contact_checks", "mode_check"]


def mode_check(grasp: RecomputedGrasp) -> Check:
    """How many contacts are missing, unknown, there twice, or there although they are off."""
    switches: dict[str, str] = {}
    for setup in grasp.setups:
        switches |= dict(zip(setup.middle_names, setup.middles, strict=True)) | {setup.tip_name: setup.tip}
    present = Counter(grasp.names)
    wrong = sum(count - 1 for count in present.values())
    wrong += len(set(present) - set(known_contacts(grasp.setups, grasp.walls, grasp.pegs)))
    supports: list[Wall | Peg] = [*grasp.walls, *grasp.pegs]
    for body in supports:
        ends = (f"{body.name}.1" in present) + (f"{body.name}.2" in present)
        whole = body.name in present
        wrong += ends == 1 or (ends == 2 and whole)
        wrong += _amiss(body.touch, whole or ends == 2)
    wrong += sum(_amiss(switch, name in present) for name, switch in switches.items())
    return Check("contacts as the scene has them", float(wrong), 0.0)


def contact_checks(grasp: RecomputedGrasp) -> Iterator[Check]:
    """Forces, gaps and normals of each contact."""
    scale = grasp.force_scale
    friction_only = not isinstance(grasp.scene.gravity, OutOfPlaneGravity)
    for c in grasp.contacts:
        n, f, lift = c.normal_force, c.friction_force, c.lift
        over = float(np.hypot(f, lift)) - c.friction * n
        yield Check(f"friction cone, {c.name}", over / scale, LIMIT, "1", f"{scale:.4g} N")
        most = c.normal_force_max
        yield Check(f"normal force, {c.name}", worst(-n / scale, n / most - 1), LIMIT, "1", f"{most:.4g} N")
        if friction_only:
            yield Check(f"no lift in the plane, {c.name}", abs(lift) / scale, LIMIT, "1", f"{scale:.4g} N")
        yield from _geometry(grasp, c)


def _geometry(grasp: RecomputedGrasp, c: RecomputedContact) -> Iterator[Check]:
    reference = f"{c.length:.4g} m"
    off = [*np.abs(c.stored_position - c.point) / c.length, *np.abs(c.stored_normal - c.normal)]
    if c.finger is not None:
        off.append(abs(c.stored_station - c.finger.joint_position(c.joint)) / c.length)
    yield Check(f"stored contact, {c.name}", worst(*off), GAP, "1", reference)
    limit = 2 * GAP if c.finger is None else GAP  # an object at rest may lie that far from a support
    yield Check(f"contact gap, {c.name}", c.gap / c.length, limit, "1", reference)
    yield Check(f"contact normal, {c.name}", c.tilt / c.length, limit, "1", reference)
    if len(grasp.object.parts) > 1:
        yield Check(f"contact inside another part, {c.name}", c.buried / c.length, GAP, "1", reference)
    if isinstance(c.support, Wall) and np.isfinite(c.support.half_length):
        along = np.array([-c.support.normal[1], c.support.normal[0]])
        beyond = abs(float(along @ (c.point - np.asarray(c.support.point)))) - c.support.half_length
        yield Check(f"within the line, {c.name}", beyond / c.length, 2 * GAP, "1", reference)


def _amiss(switch: str, present: bool) -> bool:
    return (switch == "on" and not present) or (switch == "off" and present)
