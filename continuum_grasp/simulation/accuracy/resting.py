"""Find shapes at rest with a sufficient number of elements.

1. Solve with the elements of the scene.
2. Measure the error: against the exact rod near the shape, in a twentieth of the time of step 1; if the exact rod
   does not cover the scene, against the shape with twice as many elements.
3. Double the elements while the error is too large or the stability is open. Stated elements are retained; a warning
   names a number that suffices.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from itertools import accumulate

import numpy as np

from continuum_grasp.base import Array, InputError, SolverError
from continuum_grasp.model import FingerModel, element_lengths
from continuum_grasp.rod import Elastica, natural_frequencies, solve_elastica
from continuum_grasp.scene import Load, MotorDrive, Scene
from continuum_grasp.simulation.accuracy.elements import (
    MOST,
    PLACES,
    ModelShape,
    left_by_halves,
    refined,
    translated,
    whole_error,
)
from continuum_grasp.simulation.resolution import ENOUGH, OF_MODES, Resolution
from continuum_grasp.simulation.rest import RestingShape
from continuum_grasp.simulation.resting import rest_at
from continuum_grasp.simulation.static_shape import Equilibrium
from continuum_grasp.simulation.vibration import frequencies_of, relative_errors

_FEW = 4
"""Greatest number of stated elements whose error is measured by default with twice as many: doubling four clothoids
takes 0.6 s of processor time, doubling eight 12 s."""
_ROD = 1e-6
"""Tolerance of the exact rod, per length [1]: far below the limit, and no slower than a coarser one."""
_BEYOND = "beyond the bending range"
"""Status of a search that leaves the bending range; more elements may succeed."""

Search = Callable[[Scene, FingerModel, Array | None], RestingShape]


@dataclass(frozen=True)
class RestCase:
    """A load case of a scene at rest."""

    exact: Scene  # scene whose loads and inputs at time zero are those in the case
    search: Search  # of the shape, from a guess
    loads: Sequence[Load] = ()  # besides those of the scene


class Level:
    """Shapes at rest of a scene with one number of elements; None marks a missing shape."""

    def __init__(
        self, scene: Scene, model: FingerModel, cases: Sequence[RestCase], coarser: Level | None = None
    ) -> None:
        self.scene, self.model, self.cases = scene, model, cases
        # Ends of elements in every level.
        self.marks: tuple[float, ...] = tuple(accumulate(model.lengths))[:-1] if coarser is None else coarser.marks
        self.count = len(model.lengths)
        self.rests: list[RestingShape | None] = []
        self.errors: list[SolverError] = []
        for k, case in enumerate(cases):
            guess = None if coarser is None else coarser.guess(k, model)
            try:
                self.rests.append(case.search(scene, model, guess))
            except SolverError as error:
                self.rests.append(None)
                self.errors.append(error)

    def guess(self, case: int, finer: FingerModel) -> Array | None:
        """Return coordinates of a finer model near the shape of a case."""
        rest = self.rests[case]
        return None if rest is None else translated(rest.model, rest.q, rest.u, finer)

    @cached_property
    def finer(self) -> Level | None:
        """Find the shapes with twice as many elements; None if the scene fits this model alone."""
        # A number of elements from the user is distributed like a greater one.
        marks = self.scene.contacts if isinstance(self.scene.fidelity.elements, int) else self.marks
        lengths = element_lengths(self.model.finger.profile, marks, 2 * self.count)
        # A start state has the coordinates of motions, and the search begins near the shape of this level.
        still = self.scene.replaced(initial=self.scene.initial.replaced(q=None, qd=None))
        try:
            scene = refined(still, self.model, lengths)
            if isinstance(self.scene.fidelity.elements, int):
                scene = scene.replaced(fidelity=scene.fidelity.replaced(elements=2 * self.count))
            model = FingerModel(scene, loads=self.model.loads, input_rates=False)
        except InputError:
            return None
        return Level(scene, model, self.cases, self)


def resolution_of(equilibrium: Equilibrium, *, vibrates: bool = False) -> Resolution:
    """Measure the errors of an equilibrium whose elements are retained."""
    scene = equilibrium.scene
    unknown = Resolution(len(equilibrium.model.lengths), counted=OF_MODES if vibrates else 0)
    return unknown if scene is None else _measured(level_of(equilibrium, scene), unknown, [])


def level_of(equilibrium: Equilibrium, scene: Scene) -> Level:
    """Return the level of a known equilibrium."""

    def search(finer_scene: Scene, model: FingerModel, guess: Array | None) -> RestingShape:
        if model is equilibrium.model:
            return equilibrium
        return rest_at(finer_scene, model, guess=guess, stable=equilibrium.stable)

    loads = equilibrium.model.loads[len(scene.loads) :]
    return Level(scene, equilibrium.model, [RestCase(scene, search, loads)])


def resolved(first: Level, *, limit: float | None, stated: bool, frequencies: int = 0) -> tuple[Level, Resolution]:
    """Find the level with a sufficient number of elements, or return the last one tried; for stated elements the first.

    The first ``frequencies`` natural frequencies must satisfy the limit too. Raises the SolverError of the first level
    if neither this level nor a finer one, where the number is open, has a shape.
    """
    asked = Resolution(0, limit=ENOUGH if limit is None else limit, stated=stated, counted=frequencies)
    steps: list[tuple[Level, Resolution]] = []
    level: Level | None = first
    while level is not None:
        if not any(level.rests) and (stated or level.errors[0].status != _BEYOND):
            break
        steps.append((level, _measured(level, asked, steps)))
        more = 2 * level.count <= MOST and not steps[-1][1].suffices
        level = level.finer if more else None
    found = [(level, resolution) for level, resolution in steps if any(level.rests)]
    if not found:
        raise first.errors[0]
    (start, at_first), (last, at_last) = found[0], found[-1]
    if stated:
        if last is start or not at_last.suffices:
            return start, replace(at_first, tried=last.count)
        # Without a potential of the loads the exact rod leaves the stability open; more elements settle it.
        verdict = at_first.stable
        if verdict is None and not at_first.settled:
            verdict = all(rest.stable for rest in last.rests if rest is not None)
        return start, replace(at_first, enough=last.count, tried=last.count, stable=verdict)
    return last, replace(at_last, tried=last.count, raised="" if last is first else steps[0][1].left)


def _measured(level: Level, asked: Resolution, before: Sequence[tuple[Level, Resolution]]) -> Resolution:
    """Return the errors of a level, the worst over its cases."""
    total = replace(asked, elements=level.count)
    parts = [_of_case(level, k, total, before) for k, rest in enumerate(level.rests) if rest is not None]
    return reduce(Resolution.joined, parts) if parts else replace(total, error=np.inf)


def _of_case(level: Level, case: int, asked: Resolution, before: Sequence[tuple[Level, Resolution]]) -> Resolution:
    by_rod = _by_rod(level, case, asked)
    coarser = before[-1] if before and before[-1][0].rests[case] is not None else None
    if by_rod is not None:
        if by_rod.suffices or coarser is None or not by_rod.settled or _falls(coarser[1], by_rod):
            return by_rod
        # The elements converge to another equilibrium than the exact rod, or to another friction state.
        own = _by_halves(coarser[0], level, case, asked, finer=True)
        return replace(own, from_rod=by_rod.error) if own.suffices else by_rod
    if not asked.stated or level.count <= _FEW:
        if 2 * level.count > MOST and coarser is not None:
            return _by_halves(coarser[0], level, case, asked, finer=True)
        if level.finer is not None:
            return _by_halves(level, level.finer, case, asked)
    return asked


def _falls(before: Resolution, now: Resolution) -> bool:
    """Whether doubling the elements has more than halved the greatest error."""
    greatest = [max(each.error, *each.counting, 0.0) for each in (before, now)]
    return bool(greatest[1] < 0.5 * greatest[0])


def _by_rod(level: Level, case: int, asked: Resolution) -> Resolution | None:
    """Measure errors against the exact rod near a shape; None if the exact rod does not cover the scene or its path of
    friction, or fails.
    """
    exact, rest = level.cases[case].exact, level.rests[case]
    motors = any(isinstance(drive, MotorDrive) for drive in exact.finger.winches)
    # The exact rod has no motors at given angles, and its motors turn although those of modes are held.
    if rest is None or exact.initial.motor_angles is not None or (asked.counted and motors):
        return None
    shape = ModelShape(rest.model, rest.q, rest.u, rest.p)
    tolerance = min(_ROD, 0.1 * asked.limit)
    loads = level.cases[case].loads
    try:
        rod = solve_elastica(exact, tolerance=tolerance, guess=shape.angle, stable=False, extra_loads=loads)
    except (InputError, SolverError):
        return None
    if rod.warnings:
        return None
    places = PLACES * exact.finger.rod.length
    error = np.linalg.norm(shape.position(places) - rod.position(places), axis=1).max() / exact.finger.rod.length
    stable = _stability(rod)
    settled, frequencies = stable == rest.stable, np.zeros(0)
    if asked.counted or stable is None:
        own = frequencies_of(rest)
        frequencies = relative_errors(own, natural_frequencies(exact.finger, rod, len(own)))
    if stable is None:
        # Near flutter the first two frequencies almost coincide, and small errors move them far.
        settled = not np.any(frequencies[:OF_MODES] > asked.limit)
    return replace(asked, error=float(error), frequencies=frequencies, stable=stable, settled=settled)


def _stability(rod: Elastica) -> bool | None:
    """Whether an exact rod is stable; None for loads without a potential, because the motion decides."""
    if rod.stable is not None:
        return rod.stable
    return True if rod.margin > 0.0 and not rod.equations.problem.following else None


def _by_halves(coarse: Level, fine: Level, case: int, asked: Resolution, *, finer: bool = False) -> Resolution:
    """Estimate the errors of a level from the level with twice as many elements; with ``finer``, the errors of the
    latter.
    """
    first, second = coarse.rests[case], fine.rests[case]
    if first is None or second is None:
        return replace(asked, error=np.inf)
    share = left_by_halves(coarse.model)
    factor = whole_error(coarse.model) * (share if finer else 1.0)
    places = PLACES * first.model.finger.rod.length
    apart = np.linalg.norm(_positions(first, places) - _positions(second, places), axis=1).max()
    frequencies = np.zeros(0)
    if asked.counted:
        own, true = frequencies_of(first), frequencies_of(second)
        frequencies = relative_errors(own, true[: len(own)], factor)
    # The sign is open if the least stiffness is smaller than its error with more elements. Without a potential the
    # motion decides, and the least stiffness may have any sign.
    open_sign = (second.margin > 0.0) == second.stable and abs(second.margin) <= share * abs(
        first.margin - second.margin
    )
    return replace(
        asked,
        error=float(factor * apart / first.model.finger.rod.length),
        frequencies=frequencies,
        stable=second.stable,
        settled=first.stable == second.stable and not open_sign,
    )


def _positions(rest: RestingShape, places: Array) -> Array:
    return ModelShape(rest.model, rest.q, rest.u, rest.p).position(places)
