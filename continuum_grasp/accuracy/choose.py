"""From a tolerance to the cheapest model that keeps it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from os import PathLike
from time import perf_counter

import numpy as np

from continuum_grasp import interrupt
from continuum_grasp.accuracy.choice import ACCURACIES, COUNTS, Choice, choices, open_families
from continuum_grasp.accuracy.measure import Measured, measure
from continuum_grasp.accuracy.truth import Truth, find_truth
from continuum_grasp.errors import InputError, SolverError
from continuum_grasp.scene.load import scene_of
from continuum_grasp.scene.simulate import Scene

__all__ = ["Chosen", "allowed_accuracies", "allowed_families", "choose_fidelity"]

_PROBE = 1e-6
"""Accuracy of evaluation with which it is seen whether a number of elements can do."""

_TERMS_SHARE = 4.0
"""Accuracy of evaluation per tolerance up to which choices are listed where the scene moves."""


@dataclass(frozen=True)
class Chosen:
    """The cheapest choice that keeps a tolerance.

    Attributes
    ----------
    best : Measured
    tolerance : float
    tried : tuple of Measured
        All that was measured, in the order in which it was.
    truth : Truth
    seconds : float
        Time that choosing took.
    """

    best: Measured
    tolerance: float
    tried: tuple[Measured, ...]
    truth: Truth
    seconds: float

    @property
    def scene(self) -> Scene:
        """The scene with the choice in place of the tolerance."""
        scene = self.best.choice.scene
        return scene.model_copy(update={"fidelity": self.best.choice.fidelity})

    def __str__(self) -> str:
        best, moving = self.best, self.best.choice.scene.time is not None
        errors = f"shape {best.shape:.2g} of the length (tip {best.tip:.2g})"
        if moving:
            errors += f", first frequency {best.frequencies[0]:.2g}"
        return (
            f"{best.choice}: {errors}; {best.instructions} instructions; the cheapest of {len(self.tried)} measured "
            f"against the exact rod for a tolerance of {self.tolerance:g}"
        )


@interrupt.listening()
def choose_fidelity(scene: Scene | str | PathLike[str], tolerance: float | None = None) -> Chosen:
    """Find the cheapest family, elements and terms with which a scene keeps a tolerance.

    Every choice is measured in the scene's own static poses and, where the scene moves, by its natural frequencies,
    against the exact elastic rod. What ``fidelity`` fixes stays as it is. Costs are counted instructions, per
    evaluation, or, where the scene moves, per second of explicit simulation, whose step the stiffest mode limits.

    Parameters
    ----------
    scene : Scene or path-like
        The scene, or its YAML file.
    tolerance : float, optional
        Greatest error of position per length, and of frequency where the scene moves; the scene's own where not given.

    Returns
    -------
    Chosen

    Raises
    ------
    InputError
        If there is no tolerance or none that makes sense, or the scene says its initial state in coordinates of a model
        yet to be chosen.
    SolverError
        If the exact rod is not found, or no choice keeps the tolerance; ``result`` is the best that was found.
    """
    began = perf_counter()
    scene = scene_of(scene)
    asked = scene.fidelity.tolerance if tolerance is None else tolerance
    if asked is None:
        raise InputError("choosing needs a tolerance", key="fidelity.tolerance")
    if not isinstance(asked, int | float) or not 0.0 < asked <= 0.5:
        raise InputError(f"expected a number above 0 and up to 0.5, got {asked!r}", key="tolerance")
    if scene.initial.q is not None:
        raise InputError(
            "initial.q says bends of a given model, which a tolerance has yet to choose: give fidelity.family and "
            "elements, or a pose",
            key="fidelity.tolerance",
        )
    truth = find_truth(scene)
    search = _Search(scene, truth, asked)
    for family in allowed_families(scene):
        search.through(family)
    if search.best is None:  # the most elements are measured before that is said, also where they were passed over
        for family in allowed_families(scene):
            search.through(family, only_most=True)
    if search.best is None:
        raise _none_keeps(scene, asked, search.tried)
    return Chosen(search.best, asked, tuple(search.tried), truth, perf_counter() - began)


def allowed_families(scene: Scene) -> tuple[str, ...]:
    """Families that a scene can have."""
    if scene.fidelity.family is not None:
        return (scene.fidelity.family,)
    return open_families(scene)


def allowed_accuracies(scene: Scene, tolerance: float) -> tuple[float, ...]:
    """Accuracies of evaluation that a scene can have, coarse first.

    Poses and frequencies do not see the velocity products, so that where the scene moves the evaluation has to be about
    as accurate as the tolerance by itself.
    """
    if scene.fidelity.accuracy is not None:
        return (scene.fidelity.accuracy,)
    most = _TERMS_SHARE * tolerance if scene.time is not None else math.inf
    return tuple(accuracy for accuracy in ACCURACIES if accuracy <= most) or ACCURACIES[-1:]


class _Search:
    """The cheapest choice so far."""

    def __init__(self, scene: Scene, truth: Truth, tolerance: float) -> None:
        self._scene, self._truth, self._tolerance = scene, truth, tolerance
        self._frequencies = scene.fidelity.frequencies
        self.best: Measured | None = None
        self.tried: list[Measured] = []

    def through(self, family: str, *, only_most: bool = False) -> None:
        """Try the choices of a family, from few to many elements, until they cost more than the best.

        Those that cannot do by the order of convergence are skipped, unless only the most elements are asked for.
        """
        accuracies = allowed_accuracies(self._scene, self._tolerance)
        stiffness = {False: 0.0, True: 0.0}
        hopeless = {False: 0.0, True: 0.0}
        closed: set[bool] = set()
        counts = COUNTS[-1:] if only_most else COUNTS
        for coarse in choices(self._scene, self._truth, family, accuracies[0], counts=counts):
            if coarse.aligned in closed:
                continue
            if self._dearer(coarse, stiffness[coarse.aligned]):
                closed.add(coarse.aligned)
                continue
            if hopeless[coarse.aligned] > coarse.elements:
                continue
            probe = self._measured(coarse.with_accuracy(min(_PROBE, 0.1 * self._tolerance, accuracies[-1])))
            if math.isfinite(probe.radius):
                stiffness[coarse.aligned] = probe.radius
            hopeless[coarse.aligned] = self._hopeless_below(probe)
            if probe.within(2.0 * self._tolerance, self._frequencies):
                self._cheapest_terms(coarse, accuracies, probe.radius)

    def _hopeless_below(self, probe: Measured) -> float:
        """Number of elements that cannot do, with a margin, by the order with which the family converges."""
        if not math.isfinite(probe.shape):
            return 0.0
        order = probe.choice.model.structure.family.order
        return float(0.6 * probe.choice.elements * (probe.shape / self._tolerance) ** (1.0 / order))

    def _cheapest_terms(self, coarse: Choice, accuracies: tuple[float, ...], radius: float) -> None:
        before = 0
        for accuracy in accuracies:
            choice = coarse.with_accuracy(accuracy)
            if choice.instructions == before:
                continue
            if self._dearer(choice, 0.99 * radius):
                return
            before = choice.instructions
            measured = self._measured(choice)
            if measured.within(self._tolerance, self._frequencies):
                if self.best is None or measured.cost < self.best.cost:
                    self.best = measured
                return

    def _dearer(self, choice: Choice, radius: float) -> bool:
        """Whether a choice costs more than the best, by a bound of its spectral radius."""
        rate = radius if self._scene.time is not None else 1.0
        return self.best is not None and choice.instructions * rate >= self.best.cost

    def _measured(self, choice: Choice) -> Measured:
        measured = measure(choice, self._truth, stop_at=2.0 * self._tolerance)
        self.tried.append(measured)
        return measured


def _none_keeps(scene: Scene, tolerance: float, tried: list[Measured]) -> SolverError:
    def worst(one: Measured) -> float:
        return float(np.nanmax([one.shape, *one.frequencies[: scene.fidelity.frequencies]]))

    closest = min((one for one in tried if math.isfinite(one.shape)), key=worst, default=None)
    if closest is None:
        violated = ["no choice has the equilibria of the exact rod within the bending ranges on the list"]
    else:
        moving = scene.time is not None and not math.isnan(closest.frequencies[0])
        frequency = f", first frequency {closest.frequencies[0]:.3g}" if moving else ""
        violated = [f"{closest.choice}: shape {closest.shape:.3g} of the length{frequency}"]
    fixed = [name for name in ("family", "elements", "accuracy") if getattr(scene.fidelity, name) is not None]
    free = f", or leave fidelity.{' and '.join(fixed)} open" if fixed else ""
    return SolverError(
        f"no choice of fidelity keeps the tolerance of {tolerance:g}",
        status="tolerance not reached",
        violated=violated,
        advice=f"raise fidelity.tolerance{free}",
        result=closest,
    )
