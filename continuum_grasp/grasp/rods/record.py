"""A solution of the problem of rods as the record that its certificate takes."""

from __future__ import annotations

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.judge.held import HeldContact, HeldFinger, HeldRods
from continuum_grasp.grasp.rods.geometry import exerted
from continuum_grasp.grasp.rods.numbers import FingerNumbers
from continuum_grasp.grasp.rods.problem import FingerPlaces
from continuum_grasp.grasp.rods.solving import RodGrasp


def held_rods(grasp: RodGrasp) -> HeldRods:
    """The record of a grasp, in SI units and the world."""
    problem, x = grasp.problem, grasp.attempt.x
    numbers, geometry = problem.numbers, problem.geometry
    pose = x[problem.pose]
    position: Array = numbers.size * np.array(geometry.place(pose))
    axes: Array = np.array(geometry.turn(pose, numbers.axes))
    center = position + numbers.size * axes @ numbers.center
    supports = list[HeldContact]()
    for support in numbers.supports:
        force = numbers.force * np.array(exerted(x[problem.contacts[support.name]], support.normal, support.across))
        supports.append(HeldContact(support.name, force, position=center + numbers.size * support.arm))
    fingers = zip(numbers.fingers, problem.parts, strict=True)
    return HeldRods(position, axes, tuple(_finger(grasp, *pair) for pair in fingers), tuple(supports))


def _finger(grasp: RodGrasp, finger: FingerNumbers, part: FingerPlaces) -> HeldFinger:
    problem, x = grasp.problem, grasp.attempt.x
    length, geometry = finger.length, problem.geometry
    d = geometry.dimensions
    contacts = list[HeldContact]()
    for k, name in enumerate(finger.contacts):
        held = x[problem.contacts[name]]
        node = x[part.nodes[part.first[k + 1]]]
        normal = problem.numbers.seen(finger, node[None, :d], x[problem.pose], name)[1][0]
        force = finger.force * np.array(exerted(held, normal, finger.across))
        moment = finger.force * length * finger.arm * float(held[3])
        contacts.append(HeldContact(name, force, place=float(x[part.segments[k][1]]) * length, moment=moment))
    used = np.array([finger.setup.finger.tendons_used in ("both", side) for side in ("left", "right")])
    tensions = x[part.pulls] * finger.moment / finger.offset + finger.setup.tendons.min_tension * used
    position: Array = length * np.array(geometry.in_space(list(finger.base[:d])))
    bent: Array = finger.moment * np.array(geometry.moment_in_space(list(x[part.nodes[0]][geometry.moments])))
    return HeldFinger(finger.name, position, geometry.frame(finger.base), tensions, tuple(contacts), bent)
