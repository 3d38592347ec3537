"""Unknowns of a problem from what a search knows of each finger: an equilibrium, or a posture with forces."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.rods.geometry import cross, exerted
from continuum_grasp.grasp.rods.numbers import FingerNumbers
from continuum_grasp.grasp.rods.problem import FingerPlaces, GraspRods
from continuum_grasp.grasp.rods.rod import integral, polynomial, stage

Held = Mapping[str, Array]
"""Force and moment (N, f, g, tau) of contacts by name, in units of the finger."""
_FINE = 800
"""Steps in which the line of a posture is integrated."""


class FingerGuess(ABC):
    """What is known of a finger."""

    middles: tuple[float, ...]
    """Places of its middle contacts [L]."""

    @abstractmethod
    def fill(self, problem: GraspRods, index: int, x: Array) -> None:
        """Set the unknowns of a finger by index, with the pose as it is in the unknowns."""


def filled(problem: GraspRods, guesses: Sequence[FingerGuess], supports: Held) -> Array:
    """Unknowns from what is known of all fingers, and the forces of supports [F0]."""
    numbers, x = problem.numbers, np.zeros(problem.size)
    x[problem.pose] = numbers.pose
    for index, guess in enumerate(guesses):
        guess.fill(problem, index, x)
    for name, held in supports.items():
        x[problem.contacts[name][: len(held)]] = held
    problem.bear(x)
    return x


@dataclass(frozen=True, eq=False)
class ShotFinger(FingerGuess):
    """An equilibrium in the plane, by what integrates it from its base.

    ``held`` are the forces of middle contacts, ``lift`` that of each contact out of the plane, per unit of F0.
    """

    bend: float  # curvature at the base
    force: Array  # (2,) beyond the base
    pull: float  # moment of the tendons
    middles: tuple[float, ...]  # places of middle contacts
    held: Sequence[Array]  # (N, f) of each
    lift: float = 0.0

    def fill(self, problem: GraspRods, index: int, x: Array) -> None:
        """Set the unknowns of a finger by integration from its base."""
        finger, part, geometry = problem.numbers.fingers[index], problem.parts[index], problem.geometry
        course, gravity, moments = finger.course, finger.gravity, geometry.moments
        x[part.pulls] = max(self.pull, 0.0), max(-self.pull, 0.0)
        moment = course.stiffness[0] * (self.bend - course.rest[0]) - course.tendon[0] * self.pull
        force, state = self.force, geometry.bent(finger.base, 0.0, 0.0, 0.0, moment)
        x[part.nodes[0]] = state
        out = self.lift * problem.numbers.force / finger.force
        for k, (begin, end) in enumerate(itertools.pairwise([0.0, *self.middles, 1.0])):
            x[part.segments[k]] = begin, end
            x[part.forces[k]] = force
            each = (end - begin) / part.stages
            for j in range(part.stages):
                s = begin + each * j
                beyond = force - gravity * integral(course.weight, begin, s)
                state = np.array(stage(geometry, course, finger.sides, gravity, state, beyond, self.pull, s, each))
                x[part.nodes[k * part.stages + j + 1]] = state
            force = force - gravity * integral(course.weight, begin, end)
            if k == len(finger.contacts):
                return
            normal = problem.numbers.seen(finger, state[None, : geometry.dimensions], x[problem.pose])[1][0]
            along = np.array(cross(finger.across, normal))
            if k < len(self.middles):
                pressed, rubbed = self.held[k]
                on_finger = pressed * normal + rubbed * along
                force = force - on_finger[: geometry.dimensions]
                state = state.copy()
                state[moments] += polynomial(course.half, end) * np.array(geometry.moment(cross(normal, on_finger)))
                x[part.turns[k]] = state[moments]
            else:
                left = np.array(geometry.in_space(list(force - finger.load)))
                pressed, rubbed = left @ normal, left @ along
            x[problem.contacts[finger.contacts[k]]] = pressed, rubbed, out, 0.0


@dataclass(frozen=True, eq=False)
class PosedFinger(FingerGuess):
    """A posture in the plane of a finger, whose curvature is linear between knots, with forces of its contacts."""

    places: Array  # of the knots [L]
    curvatures: Array  # there
    middles: tuple[float, ...]  # places of middle contacts
    pulls: Array  # (2,) moments of the tendons
    held: Held

    def fill(self, problem: GraspRods, index: int, x: Array) -> None:
        """Set the unknowns of a finger: states along the line, moments by its curvature, forces by its contacts."""
        finger, part, geometry = problem.numbers.fingers[index], problem.parts[index], problem.geometry
        marks = [0.0, *self.middles, 1.0]
        shares = np.arange(1, part.stages + 1) / part.stages
        s = np.concatenate([[0.0], *(begin + (end - begin) * shares for begin, end in itertools.pairwise(marks))])
        fine = np.union1d(np.linspace(0.0, 1.0, _FINE + 1), s)
        step = np.diff(fine)
        angle = np.concatenate([[0.0], np.cumsum(self._bent(0.5 * (fine[1:] + fine[:-1])) * step)])
        middle = 0.5 * (angle[1:] + angle[:-1])
        line = [np.concatenate([[0.0], np.cumsum(rate * step)]) for rate in (-np.sin(middle), np.cos(middle))]
        at = np.searchsorted(fine, s)
        x[part.pulls] = self.pulls
        for node, i, place in zip(part.nodes, at, s, strict=True):
            # A curvature that jumps at a contact is that before it.
            moment = self._moment(finger, place, place - 1e-6)
            x[node] = geometry.bent(finger.base, line[0][i], line[1][i], angle[i], moment)
        for k, joint in enumerate(self.middles):
            # 2e-3: beyond the step of the curvature
            i = at[part.first[k + 1]]
            state = geometry.bent(finger.base, 0.0, 0.0, angle[i], self._moment(finger, joint, joint + 2e-3))
            x[part.turns[k]] = state[geometry.moments]
        for ends, pair in zip(part.segments, itertools.pairwise(marks), strict=True):
            x[ends] = pair
        self._forces(problem, finger, part, x)

    def _bent(self, s: Array | float) -> Array:
        return np.asarray(np.interp(s, self.places, self.curvatures))

    def _moment(self, finger: FingerNumbers, s: float, near: float) -> float:
        """Moment at a place whose curvature is that near it."""
        course, pull = finger.course, self.pulls[0] - self.pulls[1]
        bent = float(self._bent(min(max(near, 0.0), 1.0))) - polynomial(course.rest, s)
        return float(polynomial(course.stiffness, s) * bent - polynomial(course.tendon, s) * pull)

    def _forces(self, problem: GraspRods, finger: FingerNumbers, part: FingerPlaces, x: Array) -> None:
        """Forces of contacts, and beyond the begin of each segment: from the tip back."""
        d = problem.geometry.dimensions
        force = np.array(finger.load)
        for k in reversed(range(len(part.segments))):
            if k < len(finger.contacts):
                name = finger.contacts[k]
                x[problem.contacts[name]] = self.held[name]
                place = x[part.nodes[part.first[k + 1]]][None, :d]
                normal = problem.numbers.seen(finger, place, x[problem.pose])[1][0]
                force = force + exerted(self.held[name], normal, finger.across)[:d]
            begin, end = x[part.segments[k]]
            force = force + finger.gravity * integral(finger.course.weight, begin, end)
            x[part.forces[k]] = force
