"""The functions of a grasp problem beside its NLP, and its layout, from its expressions."""

from __future__ import annotations

import json
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.grasp.problem.points import BACKBONE_POINTS
from continuum_grasp.grasp.problem.problem import GraspProblem
from continuum_grasp.grasp.problem.unit_finger import UnitFinger
from continuum_grasp.grasp.problem.unknowns import Touch


def described(problem: GraspProblem) -> str:
    """The layout of a problem as JSON."""
    rows = [
        (one.name, one.key, one.unit, len(one.rows), float(one.lower[0, 0]), float(one.upper[0, 0]))
        for one in problem.rows.blocks
    ]
    guarded = []
    for finger in problem.fingers:
        _, elements, touches, _ = finger.guarded
        guarded.append((elements[: _unprobed(finger)], touches))
    return json.dumps([problem.x.sizes, problem.numbers.sizes, rows, guarded])


def _unprobed(finger: UnitFinger) -> int:
    """Number of guarded places that follow from the unknowns: probes are where a look puts them."""
    points, *_ = finger.guarded
    return int(points.shape[1]) - finger.spec.probes * finger.spec.elements


def places_reader(problem: GraspProblem) -> ca.Function:
    """Function of what a look at the surroundings needs, in units of the problem, from unknowns and run-time
    numbers.
    """
    out: list[ca.SX] = [problem.pose]
    for k, finger in enumerate(problem.fingers):
        points, _, _, half = finger.guarded
        count = _unprobed(finger)
        own = [contact for contact in problem.contacts if contact.spec.finger == k]
        own.sort(key=lambda contact: finger.end_of(contact.spec))
        touched = ca.horzcat(ca.SX(2, 0), *(contact.local.point for contact in own))
        out += [touched, points[:, :count], half[:count], finger.curvatures()[1], *finger.stored()]
    return ca.Function("places", [problem.x.symbol, problem.numbers.symbol], out)


def point_reader(problem: GraspProblem) -> ca.Function:
    """Function of what a result stores, in units of the problem, from unknowns and run-time numbers."""
    x, numbers, touched = problem.x.symbol, problem.numbers.symbol, problem.contacts

    def station(contact: Touch) -> ca.SX:
        spec = contact.spec
        if spec.finger < 0 or spec.joint < 0:
            return ca.SX(0 if spec.finger < 0 else 1)
        return problem.fingers[spec.finger].joints[spec.joint]

    plain: list[Any] = [
        problem.pose,
        ca.horzcat(ca.SX(2, 0), *(c.point for c in touched)),
        ca.horzcat(ca.SX(2, 0), *(c.normal for c in touched)),
        ca.horzcat(ca.SX(3, 0), *(c.force for c in touched)),
        ca.vertcat(*(station(c) for c in touched)),
    ]
    shared = len(plain)
    for finger in problem.fingers:
        plain += finger.stored()
    read = ca.Function("read", [x, numbers], plain)
    mx, mp = ca.MX.sym("x", x.numel()), ca.MX.sym("p", numbers.numel())
    values = list(read(mx, mp))
    out = values[:shared]
    s = ca.SX.sym("s")
    along = ca.DM(np.linspace(0.0, 1.0, BACKBONE_POINTS)).T
    for k, finger in enumerate(problem.fingers):
        point, angle = finger.section(s)
        section = ca.vertcat(s, finger.world(point), angle + finger.base[2])
        place = ca.Function("place", [s, x, numbers], [section])
        # Mapped, not unrolled: the expression of one place serves all.
        line = place.map(BACKBONE_POINTS, [False, True, True], [False])(along, mx, mp)
        out += [*values[shared + 5 * k : shared + 5 + 5 * k], line]
    return ca.Function("values", [mx, mp], out)
