"""A solution of the problem of rods as the record that its certificate takes."""

from __future__ import annotations

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.judge.held import HeldContact, HeldFinger, HeldRods, HeldSupport
from continuum_grasp.grasp.rods.geometry import exerted
from continuum_grasp.grasp.rods.solving import RodGrasp


def held_rods(grasp: RodGrasp) -> HeldRods:
    """The record of a grasp, in SI units and the world."""
    problem, x = grasp.problem, grasp.attempt.x
    numbers, geometry = problem.numbers, problem.geometry
    pose = x[problem.pose]
    position = numbers.size * np.array(geometry.place(pose))
    axes = np.array(geometry.turn(pose, numbers.axes), dtype=float)
    supports = []
    for support in numbers.supports:
        if not support.touches:
            continue
        place, normal = support.touched(numbers, pose)
        force = numbers.force * np.array(exerted(x[problem.contacts[support.name]], normal, support.across))
        supports.append(HeldSupport(support.name, force, numbers.size * place))
    fingers = tuple(_finger(grasp, k) for k in range(len(numbers.fingers)))
    return HeldRods(position, axes, fingers, tuple(supports))


def _finger(grasp: RodGrasp, index: int) -> HeldFinger:
    problem, x = grasp.problem, grasp.attempt.x
    numbers, geometry = problem.numbers, problem.geometry
    finger, part = numbers.fingers[index], problem.parts[index]
    contacts = list[HeldContact]()
    for name, node in zip(finger.contacts, part.touching, strict=True):
        state, held = x[part.nodes[node]], x[problem.contacts[name]]
        normal = numbers.seen(finger, state[None, : geometry.dimensions], x[problem.pose], name)[1][0]
        force = finger.force * np.array(exerted(held, normal, finger.across))
        place = float(x[part.span_of(node).ends[1]]) * finger.length
        twist = float(held[3]) * finger.arm * finger.moment
        contacts.append(HeldContact(name, force, place, twist))
    base = x[part.nodes[0]]
    position = finger.length * np.array(geometry.in_space([base[k] for k in range(geometry.dimensions)]))
    moment = finger.moment * _moment(base[geometry.moments])
    # The solver leaves bounds by 1e-8.
    tensions = finger.tensions(np.clip(x[part.pulls], 0.0, finger.pulls))
    return HeldFinger(
        finger.name, position, _axes(geometry.tangent(base), finger.across), tensions, tuple(contacts), moment
    )


def _moment(moment: Array) -> Array:
    """Three components of a moment of the plane or of space."""
    return moment if len(moment) == 3 else np.array([0.0, 0.0, *moment])


def _axes(tangent: Array, across: Array) -> Array:
    """Columns (3, 3): across the finger in its plane, along it, and the normal of the plane."""
    along = np.array([*tangent, *np.zeros(3 - len(tangent))], dtype=float)
    return np.column_stack([np.cross(along, across), along, across])
