"""Unknowns of a problem by knowledge about each finger: an equilibrium, or a posture with forces."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.geometry import cross, exerted
from continuum_grasp.grasp.rods.numbers import FingerNumbers
from continuum_grasp.grasp.rods.places import FingerPlaces, StageSpan
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.model import SectionForm

Held = Mapping[str, Array]
"""Force and moment (N, f, g, tau) of contacts by name, in units of the finger."""
_FINE = 800
"""Steps in which the line of a posture is integrated."""


class FingerGuess(ABC):
    """Knowledge about a finger from which its unknowns follow."""

    @property
    @abstractmethod
    def joints(self) -> tuple[float, ...]:
        """Places of its middle contacts [L]."""

    @abstractmethod
    def fill(self, problem: GraspRods, index: int, x: Array) -> None:
        """Set the unknowns of a finger by index, with the pose as it is in the unknowns."""


def filled(problem: GraspRods, guesses: Sequence[FingerGuess], supports: Held, pose: Array | None = None) -> Array:
    """Unknowns by the guesses of all fingers, the forces of supports [F0], and the pose if it is another one."""
    numbers, x = problem.numbers, np.zeros(problem.size)
    x[problem.pose] = numbers.pose if pose is None else pose
    for index, guess in enumerate(guesses):
        guess.fill(problem, index, x)
    for name, held in supports.items():
        x[problem.contacts[name][: len(held)]] = held
    problem.wind(x)
    problem.bear(x)
    return x


@dataclass(frozen=True, eq=False)
class ShotFinger(FingerGuess):
    """An equilibrium in the plane, by what integrates it from its base.

    ``held`` are the forces of middle contacts, ``lift`` the force of each contact out of the plane, per unit of F0.
    """

    bend: float  # curvature at the base
    force: Array  # (2,) beyond the base
    pull: float  # moment of the tendons
    middles: tuple[float, ...]  # places of middle contacts
    held: Sequence[Array]  # (N, f) of each
    lift: float = 0.0

    @property
    def joints(self) -> tuple[float, ...]:
        """Places of its middle contacts."""
        return self.middles

    def fill(self, problem: GraspRods, index: int, x: Array) -> None:
        """Set the unknowns of a finger by integration from its base."""
        finger, part, geometry = problem.numbers.fingers[index], problem.parts[index], problem.geometry
        form, section = finger.section.form, finger.section
        x[part.pulls] = [max(pull.side * self.pull, 0.0) for pull in section.pulls]
        for span, ends in zip(part.spans, self._ends(finger), strict=True):
            x[span.ends] = ends
        load = float(
            form.load(form.at(0.0, section.numbers(0)), 0.0, x[part.pulls], self._still(form), section.numbers(0))
        )
        resisted = bent_moment(finger, 0.0, self.bend)
        base = geometry.bent(finger.base, 0.0, 0.0, 0.0, resisted - load)
        still = self._still(form)
        self._shoot(problem, finger, part, x, np.concatenate([base, still]))
        if still.size:
            self._shoot(problem, finger, part, x, np.concatenate([base, -self._slid(form, x, part)]))

    @staticmethod
    def _still(form: SectionForm) -> Array:
        """States of tendons that do not slide."""
        return np.zeros(len(form.sliding_names))

    def _slid(self, form: SectionForm, x: Array, part: FingerPlaces) -> Array:
        """Slides at the tip of tendons that do not slide at the base."""
        end = x[part.nodes[-1]][-len(form.sliding_names) :]
        return np.array([value * name.startswith("slide") for value, name in zip(end, form.sliding_names, strict=True)])

    def _ends(self, finger: FingerNumbers) -> list[tuple[float, float]]:
        """Ends of all spans."""
        return list(itertools.pairwise(sorted([*finger.section.places, *self.middles])))

    def _shoot(self, problem: GraspRods, finger: FingerNumbers, part: FingerPlaces, x: Array, state: Array) -> None:
        """Set nodes, forces and contacts, from a state at the base."""
        geometry = problem.geometry
        d = geometry.dimensions
        stage = kinds.stage_kind(geometry, finger.section.form)
        # Forces have the weight of everything before.
        force = np.array(self.force)
        x[part.nodes[0]] = state
        out = self.lift * problem.numbers.force / finger.force
        for span in part.spans:
            x[span.force] = force
            node = span.first + span.stages
            acting = [*force, *x[part.pulls], *x[span.ends]]
            nodes = range(span.first + 1, node + 1)
            data = [[*finger.acting(span.piece, part.along(k)), *span.shares(k)] for k in nodes]
            states = kinds.led(stage, state, np.array(acting), np.array(data))
            x[np.array(part.nodes[span.first + 1 : node + 1])] = states
            state = states[-1]
            if node not in part.touching:
                continue
            k = part.touching.index(node)
            normal = problem.numbers.seen(finger, state[None, :d], x[problem.pose])[1][0]
            along = np.array(cross(finger.across, normal))
            if k < len(self.middles):
                pressed, along_force = self.held[k]
                on_finger = pressed * normal + along_force * along
                force = force - on_finger[:d]
                state = state.copy()
                couple = np.array(geometry.moment(cross(normal, on_finger)))
                state[geometry.moments] += float(finger.half(x[span.ends[1]])) * couple
                x[part.turns[k]] = state[geometry.moments]
            else:
                left = np.array(geometry.in_space(list(force - finger.load)))
                pressed, along_force = left @ normal, left @ along
            x[problem.contacts[finger.contacts[k]]] = pressed, along_force, out, 0.0


def bent_moment(finger: FingerNumbers, s: float, curvature: float) -> float:
    """Moment with which the section resists a curvature at a place."""
    section = finger.section
    numbers = section.numbers(section.piece_at(s))
    place = section.form.at(s, numbers)
    own = [value for of_law in place.own for value in of_law]
    resisted = section.form.resisting(curvature - place.rest, place.rest, own, numbers, finger.history[0])
    return float(place.stiffness * resisted)


@dataclass(frozen=True, eq=False)
class PosedFinger(FingerGuess):
    """A posture in the plane of a finger, whose curvature is linear between knots, with forces of its contacts."""

    places: Array  # of the knots [L]
    curvatures: Array  # there
    middles: tuple[float, ...]  # places of middle contacts
    pulls: Array  # (2,) moments of the tendons
    held: Held

    @property
    def joints(self) -> tuple[float, ...]:
        """Places of its middle contacts."""
        return self.middles

    def fill(self, problem: GraspRods, index: int, x: Array) -> None:
        """Set the unknowns of a finger: states along the line, moments by its curvature, forces by its contacts."""
        finger, part, geometry = problem.numbers.fingers[index], problem.parts[index], problem.geometry
        x[part.pulls] = self.pulls
        for span, ends in zip(
            part.spans, itertools.pairwise(sorted([*finger.section.places, *self.middles])), strict=True
        ):
            x[span.ends] = ends
        s = nodes_along(part, x)
        fine = np.union1d(np.linspace(0.0, 1.0, _FINE + 1), s)
        step = np.diff(fine)
        angle = np.concatenate([[0.0], np.cumsum(self._bent(0.5 * (fine[1:] + fine[:-1])) * step)])
        middle = 0.5 * (angle[1:] + angle[:-1])
        line = [np.concatenate([[0.0], np.cumsum(rate * step)]) for rate in (-np.sin(middle), np.cos(middle))]
        at = np.searchsorted(fine, s)
        for node, i, place in zip(part.nodes, at, s, strict=True):
            # A curvature that jumps at a contact is that before it.
            moment = self._moment(finger, place, place - 1e-6)
            x[node[: geometry.state]] = geometry.bent(finger.base, line[0][i], line[1][i], angle[i], moment)
        for k, joint in enumerate(self.middles):
            # 2e-3: beyond the step of the curvature
            i = at[part.touching[k]]
            state = geometry.bent(finger.base, 0.0, 0.0, angle[i], self._moment(finger, joint, joint + 2e-3))
            x[part.turns[k]] = state[geometry.moments]
        self._forces(problem, finger, part, x)

    def _bent(self, s: Array | float) -> Array:
        return np.asarray(np.interp(s, self.places, self.curvatures))

    def _moment(self, finger: FingerNumbers, s: float, near: float) -> float:
        """Moment at a place whose curvature is that near it."""
        section = finger.section
        form, numbers = section.form, section.numbers(section.piece_at(s))
        still = np.zeros(len(form.sliding_names))
        load = float(form.load(form.at(s, numbers), 0.0, self.pulls, still, numbers))
        return bent_moment(finger, s, float(self._bent(min(max(near, 0.0), 1.0)))) - load

    def _forces(self, problem: GraspRods, finger: FingerNumbers, part: FingerPlaces, x: Array) -> None:
        """Forces of contacts, and beyond each of them: from the tip back."""
        d = problem.geometry.dimensions
        force = np.array(finger.load)
        for span in reversed(part.spans):
            node = span.first + span.stages
            if node in part.touching:
                name = finger.contacts[part.touching.index(node)]
                x[problem.contacts[name]] = self.held[name]
                normal = problem.numbers.seen(finger, x[part.nodes[node]][None, :d], x[problem.pose])[1][0]
                force = force + exerted(self.held[name], normal, finger.across)[:d]
            x[span.force] = force


@dataclass(frozen=True, eq=False)
class ContinuedFinger(FingerGuess):
    """A finger of a solution, by index, whose numbers have other contacts now: new ones press nothing."""

    before: GraspRods
    x: Array
    index: int
    now: FingerNumbers

    @property
    def joints(self) -> tuple[float, ...]:
        """Places of its middle contacts: as before, new ones in the middle of their bounds."""
        part, known = self.before.parts[self.index], self.before.numbers.fingers[self.index]
        places = {
            name: float(self.x[part.span_of(node).ends[1]])
            for name, node in zip(known.contacts, part.touching, strict=True)
        }
        pairs = zip(self.now.middles, self.now.places, strict=True)
        return tuple(float(np.clip(places.get(name, 0.5 * (low + high)), low, high)) for name, (low, high) in pairs)

    def fill(self, problem: GraspRods, index: int, x: Array) -> None:
        """Set the unknowns of a finger: states between the ones of the solution, forces of its spans and contacts."""
        part, former = problem.parts[index], self.before.parts[self.index]
        x[part.pulls] = self.x[former.pulls]
        bounds = sorted([*self.now.section.places, *self.joints])
        for span, ends in zip(part.spans, itertools.pairwise(bounds), strict=True):
            x[span.ends] = ends
            x[span.force] = self.x[self._span_at(former, 0.5 * (ends[0] + ends[1])).force]
        old, new = (nodes_along(one, y) for one, y in ((former, self.x), (part, x)))
        states = self.x[np.array(former.nodes)]
        for node, place in zip(part.nodes, new, strict=True):
            x[node] = [np.interp(place, old, column) for column in states.T]
        moments = problem.geometry.moments
        held = {name: self.x[self.before.contacts[name]] for name in self.before.numbers.fingers[self.index].contacts}
        for name in self.now.contacts:
            x[problem.contacts[name]] = held.get(name, np.zeros(kinds.HELD))
        for k, turns in enumerate(part.turns):
            # Just beyond a contact that was there the moment has its step.
            beyond = self.joints[k] + 0.5 * float(np.diff(old).min())
            x[turns] = [np.interp(beyond, old, column) for column in states[:, moments].T]

    def _span_at(self, part: FingerPlaces, place: float) -> StageSpan:
        """Span of the solution at a place."""
        return next((span for span in part.spans if place <= self.x[span.ends[1]]), part.spans[-1])


def nodes_along(part: FingerPlaces, x: Array) -> Array:
    """Places of the nodes along a finger [L]."""
    places = [np.zeros(1)]
    for span in part.spans:
        begin, end = x[span.ends]
        places.append(begin + (end - begin) * np.arange(1, span.stages + 1) / span.stages)
    return np.concatenate(places)
