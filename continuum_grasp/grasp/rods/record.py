"""A solution of the problem of rods as the record that its certificate takes."""

from __future__ import annotations

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.judge.held import HeldContact, HeldFinger, HeldRods, in_plane
from continuum_grasp.grasp.rods.numbers import FingerNumbers
from continuum_grasp.grasp.rods.problem import FingerPlaces
from continuum_grasp.grasp.rods.search import RodGrasp


def held_rods(grasp: RodGrasp) -> HeldRods:
    """The record of a grasp, in SI units and the world."""
    problem, x = grasp.problem, grasp.attempt.x
    numbers = problem.numbers
    pose = x[problem.pose] * [numbers.size, numbers.size, 1.0]
    fingers = zip(numbers.fingers, problem.parts, strict=True)
    supports = list[HeldContact]()
    position, axes = in_plane(pose)
    center = position + numbers.size * axes @ np.array([*numbers.center, 0.0])
    for support in numbers.supports:
        force = numbers.force * _force(x[problem.contacts[support.name]], support.normal)
        arm = numbers.size * np.array([*support.arm, 0.0])
        supports.append(HeldContact(support.name, force, position=center + arm))
    return HeldRods(position, axes, tuple(_finger(grasp, *pair) for pair in fingers), tuple(supports))


def _force(held: Array, normal: Array) -> Array:
    """Force (3,) on what touches the object by N, f and the lift on the object."""
    pressed, along, lift = held
    return np.array([pressed * normal[0] - along * normal[1], pressed * normal[1] + along * normal[0], -lift])


def _finger(grasp: RodGrasp, finger: FingerNumbers, part: FingerPlaces) -> HeldFinger:
    problem, x = grasp.problem, grasp.attempt.x
    length = finger.length
    position, axes = in_plane(np.array(finger.base) * [length, length, 1.0])
    contacts = list[HeldContact]()
    names = [*finger.middles, *([finger.tip] if finger.tip else [])]
    for k, name in enumerate(names):
        place = x[part.segments[k][1]]
        node = x[part.nodes[part.first[k + 1]]]
        normal = problem.seen(finger, node[None, :2], x[problem.pose])[1][0]
        force = finger.force * _force(x[problem.contacts[name]], normal)
        contacts.append(HeldContact(name, force, place=float(place) * length))
    used = np.array([finger.setup.finger.tendons_used in ("both", side) for side in ("left", "right")])
    tensions = x[part.pulls] * finger.moment / finger.offset + finger.setup.tendons.min_tension * used
    moment = np.array([0.0, 0.0, x[part.nodes[0][3]] * finger.moment])
    return HeldFinger(finger.name, position, axes, tensions, tuple(contacts), moment)
