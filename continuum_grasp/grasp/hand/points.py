"""Points of the problem of a hand: unknowns and numbers by postures, their neighbors, and their stored arrays."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.hand.body import BodySurface
from continuum_grasp.grasp.hand.frames import PlaneFrame
from continuum_grasp.grasp.hand.numbers import (
    PRESSED,
    ForceRows,
    finger_bounds,
    hand_numbers,
    hand_units,
    surfaces,
    with_shifts,
)
from continuum_grasp.grasp.hand.parts import RELAXED, SURFACE
from continuum_grasp.grasp.hand.problem import HandProblem, grown_function
from continuum_grasp.grasp.hand.starts import DEPTH, FingerPlane, TouchingPosture, postures
from continuum_grasp.grasp.problem.points import bending_arrays, coordinates, wound_start
from continuum_grasp.grasp.problem.values import Values, node_places
from continuum_grasp.scene import HandScene

ASIDE = 0.03 - 1e-5
"""Greatest shift of a contact out of its finger's plane, per length: the certificate's limit, less than its solver is
off."""
AWAY = 10.0
"""Height of fingers over a plane that stands for nothing, in lengths."""
PROBED = np.linspace(0.05, 0.95, 13)
"""Places on each element among which its deepest one is guarded, per length of the element."""


class HandPoints:
    """Points of the problem of a scene, by structure."""

    def __init__(self, scene: HandScene) -> None:
        self.scene = scene
        self.units = hand_units(scene)
        self._body = BodySurface(scene)
        frames = PlaneFrame.each(scene)
        self.planes = [
            FingerPlane(setup, frame, self._body.distance) for setup, frame in zip(scene.setups, frames, strict=True)
        ]

    # -- starts --------------------------------------------------------------------------------------------------

    def postures(self, plane: FingerPlane, on: frozenset[str], most: int) -> list[TouchingPosture]:
        """The likeliest postures of a finger with contacts of a set."""

        def clears(posture: TouchingPosture) -> bool:
            if not self.scene.supports:
                return True
            at = np.linspace(0.05, 1.0, 20)
            points = np.array([plane.place(posture, s) for s in at])
            heights = self._over_supports(plane, points, plane.length * plane.half(at))
            return min(float(height.min()) for height in heights) > -DEPTH * plane.length

        setup = plane.setup
        return postures(plane, setup.middle_names[0] in on, setup.tip_name in on, most, clears)

    def start(self, problem: HandProblem, chosen: Sequence[TouchingPosture]) -> tuple[Array, Array]:
        """Unknowns with the best forces, and numbers, for a posture of each finger."""
        x, p = self.at(problem, chosen)
        rows = ForceRows.of(self.scene, problem, x, p)
        _, x[rows.columns] = rows.best(self.scene)
        for k, (plane, posture) in enumerate(zip(self.planes, chosen, strict=True)):
            pulls = x[problem.x.at[f"{plane.setup.name}.pulls"]]
            wound = wound_start(plane.setup, problem.finger(k).finger, plane.bend(posture), pulls)
            for name, value in wound.items():
                x[problem.x.at[f"{plane.setup.name}.{name}"]] = value
        return with_shifts(problem, x, p), p

    def at(self, problem: HandProblem, chosen: Sequence[TouchingPosture]) -> tuple[Array, Array]:
        """Unknowns, without forces, and numbers for a posture of each finger."""
        numbers = hand_numbers(self.scene, [plane.frame for plane in self.planes], chosen)
        values: Values = {}
        for k, (plane, posture) in enumerate(zip(self.planes, chosen, strict=True)):
            setup, (knots, curvatures) = plane.setup, plane.knots(posture)
            lengths = np.diff(node_places(setup, [posture.joint * plane.length])) / plane.length
            values |= {
                f"{setup.name}.q": coordinates(setup, problem.finger(k).finger, lengths, knots[None], curvatures[None]),
                f"{setup.name}.joint_0": posture.joint,
            }
            for name, place in ((setup.middle_names[0], posture.joint), (setup.tip_name, 1.0)):
                values[f"place, {name}"] = plane.place(posture, place) / self.units.length
        # Probes sit amid the elements. What the posture may not penetrate would hold contacts in place: the first run
        # has no such surfaces.
        sizes = problem.numbers.sizes
        free = {name: np.full(sizes[name], 0.5) for name in sizes if name.endswith((".probes", ".strain probes"))}
        free |= {
            name: np.zeros(sizes[name])
            for name in sizes
            if name.startswith(("first of ", "second of ", "stability "))
            or name.endswith((".stability slope", ".surface"))
            or ".clear of " in name
            or name == "grip"
        }
        away = np.concatenate([[0.0, 0.0, -AWAY, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0], np.zeros(SURFACE - 9)])
        free |= {name: np.tile(away, sizes[name] // SURFACE) for name in sizes if name.endswith(".surfaces")}
        p = problem.numbers.pack({name: value for name, value in (numbers | free).items() if name in sizes})
        x = problem.x.pack({name: value for name, value in values.items() if name in problem.x.at}, 0.0)
        self._set_contacts(problem, x, p)
        self._choose(problem, self._guarded(problem, x, p), p)
        return x, p

    def bounds(self, problem: HandProblem, relaxed: str = "") -> tuple[Array, Array]:
        """Bounds of the unknowns, and of the slack of a limit that is ``relaxed``."""
        low: Values = {f"relaxed {name}": 0.0 for name in RELAXED}
        high: Values = dict(low)
        if relaxed:
            high[f"relaxed {relaxed}"] = 1.0 if relaxed == "mass" else np.inf
        for setup in self.scene.setups:
            length = setup.finger.rod.length
            (span,) = setup.contact_bounds
            low[f"{setup.name}.joint_0"], high[f"{setup.name}.joint_0"] = (s / length for s in span)
            low[f"{setup.name}.pulls"], pulled = finger_bounds(setup)
            # Greatest tensions are constraints, which can be relaxed; a tendon that is not there has a bound.
            high[f"{setup.name}.pulls"] = [np.inf if pull > 0.0 else 0.0 for pull in pulled]
        # Where palm or table could carry the object alone, fingers would touch it without a force that holds it.
        least = PRESSED * self.scene.weight / self.units.force if problem.spec.carried else 0.0
        for contact in problem.spec.contacts:
            low[f"force, {contact.name}"] = [least, -np.inf, -np.inf]
        for k, setup in enumerate(self.scene.setups):
            most = np.full(problem.x.sizes[f"{setup.name}.shifts"], np.inf)
            per = most.size // setup.elements
            most[[per * (c.end + 1) - 1 for c in problem.spec.contacts if c.finger == k]] = ASIDE
            low[f"{setup.name}.shifts"], high[f"{setup.name}.shifts"] = -most, most
        for name in problem.spec.carried:
            low[f"force, {name}"] = [0.0, -np.inf, -np.inf]
        return problem.x.pack(low, -np.inf), problem.x.pack(high, np.inf)

    # -- the neighborhood of a point -------------------------------------------------------------------------------

    def near(self, problem: HandProblem, x: Array, p: Array) -> Array:
        """Numbers that have the object as it is near the contacts and guarded places of a point."""
        p = p.copy()
        self._set_contacts(problem, x, p)
        # Of each element the deepest place among these: (fractions, elements).
        probed = list[list[tuple[Array, Array]]]()
        for fraction in PROBED:
            for setup in self.scene.setups:
                p[problem.numbers.at[f"{setup.name}.probes"]] = fraction
            probed.append(self._guarded(problem, x, p))
        for k, plane in enumerate(self.planes):
            count = problem.spec.fingers[k].probes
            last = slice(-count * plane.setup.elements, None)
            placed, halves = (np.array([guarded[k][part][last] for guarded in probed]) for part in (0, 1))
            away = self._body.distance(placed)[0] - halves
            away = np.minimum.reduce([away, *self._over_supports(plane, placed, halves)])
            # Of several places on an element each is the deepest one of its part.
            part = np.arange(len(PROBED)) * count // len(PROBED)
            own = np.arange(away.shape[1]) % count
            away[part[:, None] != own] = np.inf
            p[problem.numbers.at[f"{plane.setup.name}.probes"]] = PROBED[away.argmin(axis=0)]
        guarded = self._guarded(problem, x, p)
        self._choose(problem, guarded, p)
        for k, (points, halves) in enumerate(guarded):
            free = problem.finger(k).free
            # Edges of triangles stand out where normals go smoothly over them.
            thick = halves[free] - self.scene.object.deviation
            near = surfaces(self._body, points[free], thick, self.units.length)
            p[problem.numbers.at[f"{self.scene.setups[k].name}.surfaces"]] = near.ravel()
        return p

    def depth(self, problem: HandProblem, x: Array, p: Array) -> float:
        """Greatest depth of a guarded place in the object, a support or another finger, per length of its finger."""
        guarded = self._guarded(problem, x, p)
        deepest = -np.inf
        for k, (plane, (points, halves)) in enumerate(zip(self.planes, guarded, strict=True)):
            free = problem.finger(k).free
            depths = [halves[free] - self._body.near(points[free]).distance - self.scene.object.deviation]
            depths += [-gaps for gaps in self._over_supports(plane, points, halves)]
            depths += [-_gaps(guarded[k], guarded[m]).ravel() for j, m in problem.spec.pairs if j == k]
            deepest = max(deepest, float(np.concatenate(depths).max()) / plane.length)
        return deepest

    def crossed(self, problem: HandProblem, x: Array, p: Array) -> list[tuple[int, int]]:
        """Pairs of fingers that overlap, by their guarded places."""
        guarded = self._guarded(problem, x, p)
        pairs = combinations(range(len(guarded)), 2)
        return [(k, m) for k, m in pairs if float(_gaps(guarded[k], guarded[m]).min()) < 0.0]

    @staticmethod
    def misses(problem: HandProblem, x: Array, before: Array, after: Array) -> float:
        """By how much the cubics of contacts miss the object: the gap, per length, or the normal."""
        missed = 0.0
        for contact in problem.spec.contacts:
            at = problem.numbers.at[f"{contact.name}.surface"]
            place, (here, normal) = x[problem.x.at[f"place, {contact.name}"]], after[at][:6].reshape(2, 3)
            _, gradient = (np.array(part).ravel() for part in grown_function()(place, before[at]))
            turned = gradient / np.linalg.norm(gradient) - normal
            missed = max(missed, abs(float(normal @ (place - here))), float(np.abs(turned).max()))
        return missed

    def _guarded(self, problem: HandProblem, x: Array, p: Array) -> list[tuple[Array, Array]]:
        """Guarded places of each finger (K, 3) and half its thickness there (K,) [m]."""
        unit = self.units.length
        return [(points * unit, halves * unit) for points, halves in problem.guarded(x, p)]

    def _over_supports(self, plane: FingerPlane, points: Array, halves: Array) -> Iterator[Array]:
        """Gaps between a finger at points (..., 3) of its line and each support [m]; infinite near the base, where it
        may come out of it.
        """
        frame = plane.frame
        half = plane.length * float(plane.half(0.0))
        away = np.linalg.norm(points - frame.base, axis=-1)
        for support in self.scene.supports:
            needed = support.clear_from(tuple(frame.base), tuple(frame.axes[:, 1]), half)
            heights = (points - np.array(support.point)) @ np.array(support.normal) - halves
            yield np.where(away >= needed, heights, np.inf)

    def _set_contacts(self, problem: HandProblem, x: Array, p: Array) -> None:
        """Set the numbers that stand for the object at the contacts."""
        unit, contacts = self.units.length, problem.spec.contacts
        places = np.array([x[problem.x.at[f"place, {contact.name}"]] for contact in contacts]) * unit
        for contact, row in zip(contacts, surfaces(self._body, places, problem.halves(x, p) * unit, unit), strict=True):
            p[problem.numbers.at[f"{contact.name}.surface"]] = row

    def _choose(self, problem: HandProblem, guarded: Sequence[tuple[Array, Array]], p: Array) -> None:
        """Set the numbers that say where fingers are nearest to each other, and which places of theirs keep clear of
        palm and table.
        """
        for k, m in problem.spec.pairs:
            pair = [self.scene.setups[j].name for j in (k, m)]
            chosen = _nearest(_gaps(guarded[k], guarded[m]), np.array(problem.finger(k).owners))
            for side, weights in zip(("first", "second"), chosen, strict=True):
                p[problem.numbers.at[f"{side} of {pair[0]}, {pair[1]}"]] = weights.ravel()
        for plane, (points, halves) in zip(self.planes, guarded, strict=True):
            gaps = self._over_supports(plane, points, halves)
            for support, gap in zip(self.scene.supports, gaps, strict=True):
                p[problem.numbers.at[f"{plane.setup.name}.clear of {support.name}"]] = np.isfinite(gap)

    # -- results -------------------------------------------------------------------------------------------------

    def arrays(self, problem: HandProblem, x: Array, p: Array) -> dict[str, Array]:
        """Stored arrays of a point (SI)."""
        units = self.units
        contacts = problem.spec.contacts
        names = [*(contact.name for contact in contacts), *problem.spec.carried]
        # Of each contact point, normal, force, place along its finger, shift and moment about the normal; of palm and
        # table these three are zero.
        per = [part for k in range(len(problem.fingers)) for part in problem.touches(k, x, p)]
        per += [[*part, *np.zeros((3, 1))] for part in problem.carried(x, p)]
        lengths = [self.scene.setups[contact.finger].finger.rod.length for contact in contacts]
        lengths += [0.0] * len(problem.spec.carried)
        out: dict[str, Array] = {
            "contact_names": np.array(names),
            "contact_positions": np.array([part[0].ravel() for part in per]) * units.length,
            "contact_normals": np.array([part[1].ravel() for part in per]),
            "contact_forces": np.array([part[2].ravel() for part in per]) * units.force,
            "contact_stations": np.array([float(part[3].item()) for part in per]) * lengths,
            "contact_deflections": np.array([float(part[4].item()) for part in per]) * units.length,
        }
        if problem.spec.soft:
            out["contact_moments"] = np.array([float(part[5].item()) for part in per]) * units.force * units.length
        for k, setup in enumerate(self.scene.setups):
            finger = problem.finger(k)
            placed = problem.fingers[k]
            q, shares, tip, pulls, _ = placed.values(finger.stored, x, p)
            name = setup.name
            length = setup.finger.rod.length
            elements = shares.ravel() * length
            tensions = pulls.ravel() * setup.stiffness / length / setup.tendons.offset
            bending = bending_arrays(
                setup, problem.finger(k).finger, q.ravel(), elements, float(tip.ravel()[0]), tensions
            )
            line = np.array(finger.finger.shared.line(*placed.values(finger.state, x, p))).T
            out |= {f"{name}.{key}": value for key, value in bending.items()} | {
                f"{name}.family": np.array(setup.family),
                f"{name}.lengths": elements,
                f"{name}.tensions": tensions,
                f"{name}.base": np.zeros(3),
                f"{name}.backbone": line * [length, length, length, 1.0],
            }
        return out


def _gaps(first: tuple[Array, Array], second: tuple[Array, Array]) -> Array:
    """Gaps (K, M) between places of a finger (K, 3), half as thick as (K,), and places of another."""
    (points, halves), (others, theirs) = first, second
    return np.asarray(np.linalg.norm(points[:, None] - others, axis=2) - halves[:, None] - theirs)


def _nearest(gaps: Array, owners: Array) -> tuple[Array, Array]:
    """Weights (N, K) and (N, M) of the place of each element of a finger that is nearest to another finger, and of the
    nearest one there, by gaps (K, M) and the elements of the first finger's places.
    """
    count, (places, others) = int(owners.max()) + 1, gaps.shape
    first = np.zeros((count, places))
    second = np.zeros((count, others))
    for element in range(count):
        mine = np.flatnonzero(owners == element)
        a, b = np.unravel_index(int(gaps[mine].argmin()), (mine.size, others))
        first[element, mine[a]] = second[element, b] = 1.0
    return first, second
