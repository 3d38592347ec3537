"""The search for the grasp of a hand: postures, the forces that go with them, and the solver."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, product

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.base import interrupts_held
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
from continuum_grasp.grasp.hand.problem import HandProblem, HandSpec, grown_function, hand_problem
from continuum_grasp.grasp.hand.starts import DEPTH, STRAIGHT, FingerPlane, TouchingPosture, postures
from continuum_grasp.grasp.problem.points import bending_arrays, coordinates
from continuum_grasp.grasp.problem.solver_run import allowed_depth, settings_of, solve_clear
from continuum_grasp.grasp.problem.unknowns import FingerLayout
from continuum_grasp.grasp.problem.values import Values
from continuum_grasp.nlp import Attempt, Budget, Start
from continuum_grasp.scene import FingerSetup, HandScene

POSTURES = {"quick": 2, "normal": 4, "thorough": 8}
"""Postures of each finger that are combined, by effort."""
COMBINED = 64
"""Most combinations whose forces are looked at."""
MIXED = 2
"""Postures of each finger and kind of contact where kinds are mixed."""
LEFT = 0.5
"""Residual, scaled, that the best forces of a start may leave: of five hands, starts that led to a grasp leave 0.002 to
0.13, and those with more than 1 led to none."""
SOLVED = {"quick": 1, "normal": 3, "thorough": 12}
"""Combinations of each set of contacts that are solved, by effort."""
ASIDE = 0.03 - 1e-5
"""Greatest shift of a contact out of its finger's plane, per length: the certificate's limit, less than its solver is
off."""
PATIENCE = 20
"""Iterations that may leave a violation as it is until it is half of what it was; a run ends then. Those that lead to a
grasp take 5 to 45 in all."""
EFFORT = 1e-3
"""Weight of the tensions beside a limit that is relaxed, so that they are unique."""
FAR = 1e-3
"""Violation, in units of the problem, above which a run does not begin with the multipliers of the one before."""
SETTLED = 1e-7
"""By how much cubics may miss the object at contacts, per length or in its normals; the certificate allows ten
times that."""
AWAY = 10.0
"""Height of fingers over a plane that stands for nothing, in lengths."""
PROBED = np.linspace(0.05, 0.95, 13)
"""Places on each element among which its deepest one is guarded, per length of the element."""
IDLE = 1e-3
"""Normal force, per greatest, below which a contact holds nothing."""


@dataclass(frozen=True)
class HandTried:
    """A start that was solved."""

    on: frozenset[str]  # names of the contacts
    chosen: tuple[TouchingPosture, ...]
    attempt: Attempt
    numbers: Array  # of the last run
    arrays: dict[str, Array]
    problem: HandProblem

    @property
    def tension(self) -> float:
        """Sum of the tensions [N]."""
        return float(sum(value.sum() for name, value in self.arrays.items() if name.endswith(".tensions")))


@dataclass(frozen=True)
class PostureCandidate:
    """A posture of one finger."""

    on: frozenset[str]  # names of its contacts
    posture: TouchingPosture
    rows: ForceRows  # of a hand whose other fingers are anyhow


@dataclass(frozen=True)
class HandStart:
    """A posture of each finger."""

    on: frozenset[str]  # names of the contacts
    chosen: tuple[TouchingPosture, ...]
    left: float  # residual that the best forces leave


class HandSearch:
    """Grasps of a scene, one set of contacts after the other."""

    def __init__(self, scene: HandScene, budget: Budget) -> None:
        self.scene, self.budget, self.body = scene, budget, BodySurface(scene)
        self._solver, self._frames = settings_of(scene).solver(), PlaneFrame.each(scene)
        self.units = hand_units(scene)
        self._met = dict[HandSpec, list[Array]]()  # solutions of first runs by structure
        self.held = False  # whether a grasp was found that is as the scene asks
        # Fingers that touch the object in no posture, by set of contacts.
        self.untouched = dict[frozenset[str], list[str]]()

    # -- sets of contacts ----------------------------------------------------------------------------------------

    @property
    def modes(self) -> list[frozenset[str]]:
        """Sets of contacts that the scene leaves to choose: the same kinds for all fingers, where they are free."""
        sets = dict[frozenset[str], None]()
        carried = {contact.name for contact in self.scene.support_contacts}
        for middle, tip in ((True, False), (False, True), (True, True)):
            on = set[str]()
            for setup in self.scene.setups:
                (one,) = setup.middles
                on |= {setup.middle_names[0]} if one == "on" or (middle and one == "auto") else set()
                on |= {setup.tip_name} if setup.tip == "on" or (tip and setup.tip == "auto") else set()
            if on and all({s.middle_names[0], s.tip_name} & on for s in self.scene.setups):
                sets[frozenset(on | carried)] = None
        return list(sets)

    def run(self) -> Iterator[HandTried]:
        """Solve the likeliest start of each set of contacts, then the next of each, until ``held`` is set."""
        thorough = self.scene.solver.effort == "thorough"
        once, twice = list[frozenset[str]](), list[frozenset[str]]()
        for on in self.modes:
            # Fingers that touch with both of their contacts rarely hold with less, and take twice the equations.
            (once if len(HandSpec.of(self.scene, on).contacts) <= len(self.scene.setups) else twice).append(on)
        for modes in (once, twice):
            if self.held and not thorough:
                return
            touching = {on: self._candidates(on) for on in modes}
            ranked = [self._ranked([touching[on]]) for on in modes]
            for n in range(SOLVED[self.scene.solver.effort]):
                for starts in ranked[: len(modes)]:
                    if n < len(starts) and (thorough or not self.held or starts[n].left <= LEFT):
                        yield from self._tried(starts[n])
                if self.held and not thorough:
                    break
                if n == 0 and len(modes) > 1:
                    # Fingers whose contacts are of different kinds, where those of one kind hold nothing.
                    ranked.append(self._ranked(list(touching.values())))
                for starts in ranked[len(modes) :]:
                    if n < len(starts):
                        yield from self._tried(starts[n])

    def _tried(self, start: HandStart) -> Iterator[HandTried]:
        """Grasps from a start, with all contacts and without those that are idle."""
        if self.budget.over:
            return
        on, chosen = start.on, start.chosen
        problem = hand_problem(HandSpec.of(self.scene, on))
        tried = self._solve(problem, on, chosen, *self._start(problem, on, chosen))
        if tried.attempt.known:
            return
        lighter = self._without_idle(tried) if tried.attempt.converged else None
        # Palm or table that carries nothing would count as what holds the object in place.
        if lighter is None or not lighter.attempt.converged or not tried.problem.spec.carried:
            yield tried
        if lighter is not None:
            yield lighter

    def _without_idle(self, tried: HandTried) -> HandTried | None:
        """A grasp without contacts that press nothing, where the scene leaves them to choose; None where all press."""
        auto = {name for setup in self.scene.setups for name, state in setup.switches.items() if state == "auto"}
        forces, normals = tried.arrays["contact_forces"], tried.arrays["contact_normals"]
        pressing = dict(zip(tried.arrays["contact_names"].tolist(), (forces * normals).sum(axis=1), strict=True))
        least = IDLE * max(pressing.values())
        idle = {name for name in auto & tried.on if pressing[name] <= least}
        for contact in self.scene.support_contacts:  # the rounded apex of a cone leaves a force that grows as 1 / mu
            friction = pressing.get(contact.name, 0.0) * contact.support.friction
            idle |= {contact.name} if friction <= max(least, IDLE * self.scene.weight) else set()
        on = tried.on - idle
        if on == tried.on:
            return None
        lighter = hand_problem(replace(HandSpec.of(self.scene, on), pairs=tried.problem.spec.pairs))
        x, p = self._start(lighter, on, tried.chosen)
        before, after = tried.problem, lighter
        for name in before.x.at.keys() & after.x.at.keys():
            x[after.x.at[name]] = tried.attempt.x[before.x.at[name]]
        return self._solve(lighter, on, tried.chosen, x, self._near(lighter, x, p))

    def relaxed(self, tried: HandTried, limit: str, eased: HandSearch, amount: float) -> tuple[HandTried, float]:
        """The nearest point with a limit relaxed as little as can be, and by how much, in units of the problem.

        The forces to start with are those of a search whose limit is ``eased`` by an amount.
        """
        problem = tried.problem
        x, _ = eased._start(problem, tried.on, tried.chosen)
        _, p = self._at(problem, tried.on, tried.chosen)
        p[problem.numbers.at["effort weight"]] = EFFORT
        p[problem.numbers.at["relaxation weights"]] = np.array([1.0 if name == limit else 0.0 for name in RELAXED])
        at = problem.x.at[f"relaxed {limit}"]
        x[at] = amount
        found = self._solve(problem, tried.on, tried.chosen, x, p, limit)
        return found, float(found.attempt.x[at][0])

    def again(self, tried: HandTried) -> HandTried:
        """Solve from a point that was found, with the numbers of this scene."""
        problem = tried.problem
        _, p = self._at(tried.problem, tried.on, tried.chosen)
        x = tried.attempt.x.copy()
        for name in RELAXED:
            x[problem.x.at[f"relaxed {name}"]] = 0.0
        return self._solve(tried.problem, tried.on, tried.chosen, x, p)

    def next_to(self, tried: HandTried, problem: HandProblem, numbers: Values) -> HandTried:
        """Solve other equations of the same unknowns, with some numbers, from a point that was found."""
        _, p = self._at(problem, tried.on, tried.chosen)
        p = self._near(problem, tried.attempt.x, p)
        for name, value in numbers.items():
            p[problem.numbers.at[name]] = value
        return self._solve(problem, tried.on, tried.chosen, tried.attempt.x, p)

    def arrays_at(self, tried: HandTried, x: Array) -> dict[str, Array]:
        """Stored arrays (SI) of a point beside one that was found."""
        return self._arrays(tried.problem, x, tried.numbers)

    @property
    def _fingers(self) -> list[tuple[FingerSetup, PlaneFrame]]:
        return list(zip(self.scene.setups, self._frames, strict=True))

    def _postures(self, setup: FingerSetup, frame: PlaneFrame, on: frozenset[str], most: int) -> list[TouchingPosture]:
        half = float(setup.finger.profile.half_thickness(0.0))
        plane = FingerPlane(frame, setup.finger.rod.length, half, self.body.distance)
        return postures(
            plane, setup, setup.middle_names[0] in on, setup.tip_name in on, most, partial(self._clears, setup, frame)
        )

    def _clears(self, setup: FingerSetup, frame: PlaneFrame, posture: TouchingPosture) -> bool:
        """Whether a posture keeps clear of palm and table, but for what the solver moves out."""
        if not self.scene.supports:
            return True
        length = setup.finger.rod.length
        line = length * np.array([_place(posture, at) for at in np.linspace(0.05, 1.0, 20)])
        heights = self._over_supports(setup, frame, frame.world(np.column_stack([line, np.zeros(len(line))])))
        return min(float(height.min()) for height in heights) > -DEPTH * length

    def _over_supports(self, setup: FingerSetup, frame: PlaneFrame, points: Array) -> list[Array]:
        """Gaps between a finger at points (..., 3) of its line and each support [m]; infinite near the base, where it
        may come out of it.
        """
        half = float(setup.finger.profile.half_thickness(0.0))
        away, gaps = np.linalg.norm(points - frame.base, axis=-1), []
        for support in self.scene.supports:
            needed = support.clear_from(tuple(frame.base), tuple(frame.axes[:, 1]), half)
            heights = (points - np.array(support.point)) @ np.array(support.normal) - half
            gaps.append(np.where(away >= needed, heights, np.inf))
        return gaps

    # -- a start -------------------------------------------------------------------------------------------------

    def _candidates(self, on: frozenset[str]) -> list[list[PostureCandidate]]:
        """Postures of each finger with contacts of a set; none for a finger that touches in no posture."""
        most = POSTURES[self.scene.solver.effort]
        each = [self._postures(setup, frame, on, most) for setup, frame in self._fingers]
        untouched = [setup.name for setup, found in zip(self.scene.setups, each, strict=True) if not found]
        if untouched:
            self.untouched[on] = untouched
        problem, candidates = hand_problem(HandSpec.of(self.scene, on)), [list[PostureCandidate]() for _ in each]
        for n in range(max(map(len, each))):
            chosen = tuple(found[min(n, len(found) - 1)] if found else STRAIGHT for found in each)
            rows = ForceRows.of(self.scene, problem, *self._at(problem, on, chosen))
            for setup, found, own in zip(self.scene.setups, each, candidates, strict=True):
                names = frozenset({setup.middle_names[0], setup.tip_name} & on)
                own += [PostureCandidate(names, found[n], rows)] if n < len(found) else []
        return candidates

    def _ranked(self, sets: Sequence[Sequence[Sequence[PostureCandidate]]]) -> list[HandStart]:
        """Combinations of the candidates of each finger, the one whose best forces leave the least first: those of one
        set of contacts, or of several sets, not all from the same; none where a finger has no posture.
        """
        fingers, most = range(len(self.scene.setups)), MIXED if len(sets) > 1 else None
        each = [[one for candidates in sets for one in candidates[k][:most]] for k in fingers]
        alike = [frozenset().union(*(own[0].on for own in candidates if own)) for candidates in sets]
        carried = frozenset(contact.name for contact in self.scene.support_contacts)
        starts = list[HandStart]()
        for chosen in _likeliest(each):
            on = frozenset[str]().union(*(one.on for one in chosen))
            if len(sets) > 1 and on in alike:
                continue
            left, _ = ForceRows.combined([one.rows for one in chosen]).best(self.scene)
            starts.append(HandStart(on | carried, tuple(one.posture for one in chosen), left))
        return sorted(starts, key=lambda start: start.left)

    def _start(
        self, problem: HandProblem, on: frozenset[str], chosen: Sequence[TouchingPosture]
    ) -> tuple[Array, Array]:
        """Unknowns with the best forces, and numbers, for a posture of each finger."""
        x, p = self._at(problem, on, chosen)
        rows = ForceRows.of(self.scene, problem, x, p)
        _, x[rows.columns] = rows.best(self.scene)
        return with_shifts(problem, x, p), p

    def _at(self, problem: HandProblem, on: frozenset[str], chosen: Sequence[TouchingPosture]) -> tuple[Array, Array]:
        """Unknowns, without forces, and numbers for a posture of each finger."""
        scene, units = self.scene, self.units
        numbers = hand_numbers(scene, self._frames, chosen)
        values: Values = {}
        places = dict[str, Array]()
        for k, (setup, frame) in enumerate(self._fingers):
            spec, length, posture = problem.spec.fingers[k], setup.finger.rod.length, chosen[k]
            knots, curvatures = (np.array([part]) for part in posture.knots)
            count, before = setup.elements, setup.before[0]
            lengths = np.concatenate(
                [
                    np.full(before, posture.joint / before),
                    np.full(count - before, (1.0 - posture.joint) / (count - before)),
                ]
            )
            layout = FingerLayout(spec, problem.finger(k).coordinates, [], [])
            values |= {f"{setup.name}.q": coordinates(setup, layout, lengths, knots, curvatures)}
            values |= {f"{setup.name}.joint_0": posture.joint}
            for name, at in ((setup.middle_names[0], posture.joint), (setup.tip_name, 1.0)):
                if name in on:
                    places[name] = frame.world(np.append(length * _place(posture, at), 0.0))
        values |= {f"place, {name}": place / units.length for name, place in places.items()}
        numbers |= self._near_contacts(problem, np.array([places[c.name] for c in problem.spec.contacts]))
        # Probes sit amid the elements. What the posture may not penetrate would hold contacts in place: the first run
        # has no such surfaces.
        sizes = problem.numbers.sizes
        free = {name: np.full(sizes[name], 0.5) for name in sizes if name.endswith((".probes", ".strain probes"))}
        free |= {
            name: np.zeros(sizes[name])
            for name in sizes
            if name.startswith(("first of ", "second of ", "stability "))
            or name.endswith(".stability slope")
            or ".clear of " in name
            or name == "grip"
        }
        away = np.concatenate([[0.0, 0.0, -AWAY, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0], np.zeros(SURFACE - 9)])
        free |= {name: np.tile(away, sizes[name] // SURFACE) for name in sizes if name.endswith(".surfaces")}
        p = problem.numbers.pack({name: value for name, value in (numbers | free).items() if name in sizes})
        x = problem.x.pack(values, 0.0)
        guarded = self._guarded(problem, x, p)
        self._choose_places(problem, guarded, p)
        self._choose_free(problem, guarded, p)
        return x, p

    def _near(self, problem: HandProblem, x: Array, p: Array) -> Array:
        """Numbers that have the object as it is near the contacts and guarded places of a point."""
        p = p.copy()
        places = [x[problem.x.at[f"place, {contact.name}"]] for contact in problem.spec.contacts]
        for name, value in self._near_contacts(problem, np.array(places) * self.units.length).items():
            p[problem.numbers.at[name]] = value
        # Of each element the deepest place among these: (fractions, elements).
        probed = list[list[Array]]()
        for fraction in PROBED:
            for setup in self.scene.setups:
                p[problem.numbers.at[f"{setup.name}.probes"]] = fraction
            probed.append(self._guarded(problem, x, p))
        for k, (setup, frame) in enumerate(self._fingers):
            count = problem.spec.fingers[k].probes
            placed = np.array([points[k][-count * setup.elements :] for points in probed])
            away = self.body.distance(placed)[0] - float(setup.finger.profile.half_thickness(0.0))
            away = np.minimum.reduce([away, *self._over_supports(setup, frame, placed)])
            # Of several places on an element each is the deepest one of its part.
            part, own = np.arange(len(PROBED)) * count // len(PROBED), np.arange(away.shape[1]) % count
            away[part[:, None] != own] = np.inf
            p[problem.numbers.at[f"{setup.name}.probes"]] = PROBED[away.argmin(axis=0)]
        guarded = self._guarded(problem, x, p)
        self._choose_places(problem, guarded, p)
        self._choose_free(problem, guarded, p)
        for k, (points, setup) in enumerate(zip(guarded, self.scene.setups, strict=True)):
            free = problem.finger(k).free
            # Edges of triangles stand out where normals go smoothly over them.
            thick = np.full(len(free), float(setup.finger.profile.half_thickness(0.0)) - self.scene.object.deviation)
            near = surfaces(self.body, points[free], thick, self.units.length)
            p[problem.numbers.at[f"{setup.name}.surfaces"]] = near.ravel()
        return p

    def _near_contacts(self, problem: HandProblem, places: Array) -> Values:
        """Numbers that stand for the object at the places (K, 3) [m] of the contacts."""
        thick = [self.scene.setups[c.finger].finger.profile.half_thickness(0.0) for c in problem.spec.contacts]
        near = surfaces(self.body, places, np.array(thick, dtype=float), self.units.length)
        return {f"{contact.name}.surface": row for contact, row in zip(problem.spec.contacts, near, strict=True)}

    def _choose_places(self, problem: HandProblem, guarded: Sequence[Array], p: Array) -> None:
        """Set the numbers that say where fingers are nearest to each other."""
        for k, m in problem.spec.pairs:
            pair = [self.scene.setups[j].name for j in (k, m)]
            for side, chosen in zip(("first", "second"), _nearest(guarded[k], guarded[m], problem, k), strict=True):
                p[problem.numbers.at[f"{side} of {pair[0]}, {pair[1]}"]] = chosen.ravel()

    def _choose_free(self, problem: HandProblem, guarded: Sequence[Array], p: Array) -> None:
        """Set the numbers that say which places of fingers keep clear of palm and table."""
        for (setup, frame), points in zip(self._fingers, guarded, strict=True):
            for support, gaps in zip(self.scene.supports, self._over_supports(setup, frame, points), strict=True):
                p[problem.numbers.at[f"{setup.name}.clear of {support.name}"]] = np.isfinite(gaps)

    def _guarded(self, problem: HandProblem, x: Array, p: Array) -> list[Array]:
        """Guarded places of each finger (K, 3) [m]."""
        return [points * self.units.length for points in problem.guarded(x, p)]

    # -- the solver ----------------------------------------------------------------------------------------------

    def _bounds(self, problem: HandProblem, relaxed: str = "") -> tuple[Array, Array]:
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
            most = np.full(setup.elements, np.inf)
            most[[contact.end for contact in problem.spec.contacts if contact.finger == k]] = ASIDE
            low[f"{setup.name}.shifts"], high[f"{setup.name}.shifts"] = -most, most
        for name in problem.spec.carried:
            low[f"force, {name}"] = [0.0, -np.inf, -np.inf]
        return problem.x.pack(low, -np.inf), problem.x.pack(high, np.inf)

    def _solve(
        self,
        problem: HandProblem,
        on: frozenset[str],
        chosen: tuple[TouchingPosture, ...],
        x: Array,
        p: Array,
        relaxed: str = "",
    ) -> HandTried:
        """Solve from a start, laying planes anew until no place of a finger is in the object."""
        depth = allowed_depth(self.scene)
        near_to = {k: [m for j, m in problem.spec.pairs if j == k] for k, _ in problem.spec.pairs}

        def look(x: Array, numbers: Array) -> tuple[float, Array]:
            near = self._near(problem, x, numbers)
            gaps = []
            guarded = self._guarded(problem, x, near)
            halves = [float(setup.finger.profile.half_thickness(0.0)) for setup in self.scene.setups]
            for k, points in enumerate(guarded):
                free = problem.finger(k).free
                depths = [halves[k] - self.body.near(points[free]).distance - self.scene.object.deviation]
                depths += [-gaps for gaps in self._over_supports(*self._fingers[k], points)]
                depths += [(halves[k] + halves[m] - _apart(points, guarded[m])).ravel() for m in near_to.get(k, ())]
                gaps.append(float(np.concatenate(depths).max()) / self.scene.setups[k].finger.rod.length)
            # Where contacts have moved, the cubics have to follow.
            return (max(gaps) if self._misses(problem, x, numbers, near) < SETTLED else np.inf), near

        lower, upper = problem.rows.bounds()
        bounds = self._bounds(problem, relaxed)
        start = Start(x, *bounds, lower, upper, p, patience=PATIENCE, standstill=PATIENCE // 2)
        known = [] if relaxed else self._met.setdefault(problem.spec, [])

        def run(start: Start, budget: Budget) -> Attempt:
            if start.p is p:
                found = self._solver.solve(problem.nlp, replace(start, known=tuple(known)), budget)
                if found.converged:
                    known.append(found.x)
                return found
            # Where places that were not looked at are in the object, multipliers mislead.
            if start.multipliers is not None and self._violated(problem, start) > FAR:
                start = replace(start, multipliers=None)
            return self._solver.solve(problem.nlp, start, budget)

        with interrupts_held(quietly=True):
            attempt, numbers = solve_clear(
                run,
                problem.nlp,
                start,
                look,
                depth,
                self.budget,
                self.scene.solver.max_iterations,
            )
        crossed = self._crossed(problem, attempt.x, numbers) if attempt.converged else ()
        if set(crossed) <= set(problem.spec.pairs):
            return HandTried(on, chosen, attempt, numbers, self._arrays(problem, attempt.x, numbers), problem)
        # Once more, with these fingers clear of each other.
        pairs = tuple(sorted({*problem.spec.pairs, *crossed}))
        wider = hand_problem(replace(problem.spec, pairs=pairs))
        x = wider.x.pack({name: attempt.x[at] for name, at in problem.x.at.items()}, 0.0)
        p = wider.numbers.pack({name: numbers[at] for name, at in problem.numbers.at.items()}, 0.0)
        return self._solve(wider, on, chosen, x, self._near(wider, x, p), relaxed)

    @staticmethod
    def _violated(problem: HandProblem, start: Start) -> float:
        """By how much a start violates the constraints."""
        return start.violation(start.x, np.array(problem.nlp.values(start.x, start.p)[1]).ravel())

    def _misses(self, problem: HandProblem, x: Array, before: Array, after: Array) -> float:
        """By how much the cubics of contacts miss the object: the gap, per length, or the normal."""
        missed = 0.0
        for contact in problem.spec.contacts:
            at = problem.numbers.at[f"{contact.name}.surface"]
            place, (here, normal) = x[problem.x.at[f"place, {contact.name}"]], after[at][:6].reshape(2, 3)
            _, gradient = (np.array(part).ravel() for part in grown_function()(place, before[at]))
            turned = gradient / np.linalg.norm(gradient) - normal
            missed = max(missed, abs(float(normal @ (place - here))), float(np.abs(turned).max()))
        return missed

    def _crossed(self, problem: HandProblem, x: Array, p: Array) -> list[tuple[int, int]]:
        """Pairs of fingers that overlap, by their guarded places."""
        guarded = self._guarded(problem, x, p)
        halves = [float(setup.finger.profile.half_thickness(0.0)) for setup in self.scene.setups]
        return [
            (k, m)
            for k, m in combinations(range(len(guarded)), 2)
            if float(_apart(guarded[k], guarded[m]).min()) < halves[k] + halves[m]
        ]

    def _arrays(self, problem: HandProblem, x: Array, p: Array) -> dict[str, Array]:
        """Stored arrays of a point (SI)."""
        units, contacts = self.units, problem.spec.contacts
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
            finger, placed = problem.finger(k), problem.fingers[k]
            q, shares, tip, pulls, _ = placed.values(finger.stored, x, p)
            name, length = setup.name, setup.finger.rod.length
            layout = FingerLayout(problem.spec.fingers[k], problem.finger(k).coordinates, [], [])
            elements = shares.ravel() * length
            tensions = pulls.ravel() * setup.stiffness / length / setup.tendons.offset
            bending = bending_arrays(setup, layout, q.ravel(), elements, float(tip.ravel()[0]), tensions)
            line = np.array(finger.finger.shared.line(*placed.values(finger.state, x, p))).T
            out |= {f"{name}.{key}": value for key, value in bending.items()} | {
                f"{name}.family": np.array(setup.family),
                f"{name}.lengths": elements,
                f"{name}.tensions": tensions,
                f"{name}.base": np.zeros(3),
                f"{name}.backbone": line * [length, length, length, 1.0],
            }
        return out


def _apart(points: Array, others: Array) -> Array:
    """Distances (K, M) of points (K, 3) from others (M, 3)."""
    return np.asarray(np.linalg.norm(points[:, None] - others, axis=2))


def _nearest(points: Array, others: Array, problem: HandProblem, k: int) -> tuple[Array, Array]:
    """Weights (N, K) and (N, M) of the place of each element of finger k that is nearest to the other finger, and of
    the nearest one there.
    """
    apart, owners = _apart(points, others), np.array(problem.finger(k).owners)
    first = np.zeros((problem.spec.fingers[k].elements, len(points)))
    second = np.zeros((len(first), len(others)))
    for element in range(len(first)):
        mine = np.flatnonzero(owners == element)
        a, b = np.unravel_index(int(apart[mine].argmin()), (mine.size, len(others)))
        first[element, mine[a]] = second[element, b] = 1.0
    return first, second


def _place(posture: TouchingPosture, at: float) -> Array:
    """Position of a place along a finger of unit length (2,)."""
    s = np.linspace(0.0, at, 401)
    knots, curvatures = posture.knots
    angle = np.concatenate([[0.0], np.cumsum(np.interp(0.5 * (s[1:] + s[:-1]), knots, curvatures) * np.diff(s))])
    middle = 0.5 * (angle[1:] + angle[:-1])
    return np.array([-np.sin(middle) @ np.diff(s), np.cos(middle) @ np.diff(s)])


def _likeliest(each: Sequence[Sequence[PostureCandidate]]) -> list[tuple[PostureCandidate, ...]]:
    """Combinations of a posture of each finger, those of least scores first."""
    combined = sorted(product(*each), key=lambda chosen: sum(one.posture.score for one in chosen))
    return combined[:COMBINED]
