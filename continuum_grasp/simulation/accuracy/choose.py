"""Choose the cheapest model that meets a tolerance, once, and remember it.

1. Find the truth: equilibria of the exact rod in the scene's load cases and, for a motion, its frequencies.
2. For each family, from few to many elements, measure the error with fine terms: this is the elements' error.
3. If this error is near the tolerance, measure the terms from coarse to fine, until one meets the tolerance.
4. End a family if a choice costs more than the best so far, by its instructions and stiffest mode.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from os import PathLike
from time import perf_counter

import numpy as np

from continuum_grasp.base import InputError, SolverError, Summarized, check_arguments, interruptible
from continuum_grasp.scene import Scene, scene_of
from continuum_grasp.simulation.accuracy.choice import ACCURACIES, Assessment, Choice, assess, choices, open_families
from continuum_grasp.simulation.accuracy.truth import Truth, find_truth


@dataclass(frozen=True)
class Chosen(Summarized):
    """The cheapest choice that meets a tolerance."""

    best: Assessment
    tolerance: float
    tried: tuple[Assessment, ...]  # everything that was measured, in order
    truth: Truth
    seconds: float  # that choosing took

    def headline(self) -> str:
        """The choice."""
        return self.quoted(self.best.choice.scene.name, str(self.best.choice))

    def pairs(self) -> dict[str, str]:
        """Errors, cost, and the choices that it was chosen from."""
        best = self.best
        return {
            "shape": f"{best.shape:.2g} of the length (tip {best.tip:.2g})",
            "tolerance": f"{self.tolerance:g}",
            "cost": f"{best.instructions} instructions",
            "measured": f"{len(self.tried)} choices in {self.seconds:.2g} s",
        }

    @property
    def scene(self) -> Scene:
        """Return the scene with the choice instead of the tolerance."""
        scene = self.best.choice.scene
        return scene.model_copy(update={"fidelity": self.best.choice.fidelity})

    def __str__(self) -> str:
        return (
            f"{self.best}; {self.best.instructions} instructions; the cheapest of {len(self.tried)} measured against "
            f"the exact rod for a tolerance of {self.tolerance:g}"
        )


@interruptible()
@check_arguments
def choose_fidelity(scene: Scene | str | PathLike[str], tolerance: float | None = None) -> Chosen:
    """Find the cheapest family, elements and terms that meet a tolerance for a scene.

    Every choice is compared with the exact elastic rod in the scene's own static load cases and, for a motion, by its
    natural frequencies. Keys that ``fidelity`` fixes stay. Costs are counted instructions per evaluation or, for a
    motion, per second of explicit simulation, whose step the stiffest mode limits.

    Parameters
    ----------
    scene : Scene or path-like
        The scene, or its YAML file.
    tolerance : float, optional
        Greatest error of position per length, and of frequency where the scene moves; by default the scene's own.

    Returns
    -------
    Chosen

    Raises
    ------
    InputError
        If the tolerance is missing or out of range, or the scene gives its initial state in coordinates of a
        model yet to be chosen.
    SolverError
        If the exact rod is not found, or no choice meets the tolerance; ``result`` is the best choice found.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> scene = cg.Scene(
    ...     finger={
    ...         "rod": {"length": 0.2, "linear_density": 0.03, "bending_stiffness": 0.006},
    ...         "base": {"angle": -1.5708},  # along +x
    ...     },
    ...     gravity=(0.0, -9.81),
    ... )
    >>> chosen = cg.choose_fidelity(scene, 0.01)  # 1 % of the length
    >>> chosen.best.shape <= 0.01
    True
    >>> model = cg.FingerModel(chosen.scene)
    """
    began = perf_counter()
    scene = scene_of(scene)
    asked = scene.fidelity.tolerance if tolerance is None else tolerance
    if asked is None:
        raise InputError("choosing needs a tolerance", key="fidelity.tolerance")
    if not isinstance(asked, int | float) or not 0.0 < asked <= 0.5:
        raise InputError(f"expected a number above 0 and up to 0.5, got {asked!r}", key="tolerance")
    truth = find_truth(scene)
    search = _Search(scene, truth, asked)
    for family in open_families(scene):
        search.through(family)
    if search.best is None:
        raise _none_meets(scene, asked, search.tried)
    return Chosen(search.best, asked, tuple(search.tried), truth, perf_counter() - began)


def allowed_accuracies(scene: Scene, tolerance: float) -> tuple[float, ...]:
    """Accuracies of evaluation that a scene can have, coarse first.

    Equilibria and frequencies do not see the velocity products, so where the scene moves the evaluation has to be about
    as accurate as the tolerance by itself.
    """
    if scene.fidelity.accuracy is not None:
        return (scene.fidelity.accuracy,)
    # 4.0: accuracy of evaluation per tolerance up to which choices are listed where the scene moves: about the
    # tolerance itself, see ``allowed_accuracies``
    limit = 4.0 * tolerance if scene.time is not None else math.inf
    return tuple(accuracy for accuracy in ACCURACIES if accuracy <= limit) or ACCURACIES[-1:]


@dataclass
class _Search:
    """The cheapest choice so far."""

    scene: Scene
    truth: Truth
    tolerance: float
    best: Assessment | None = None
    tried: list[Assessment] = field(default_factory=list)

    def through(self, family: str) -> None:
        """Try the choices of a family, from few to many elements, until they cost more than the best."""
        accuracies = allowed_accuracies(self.scene, self.tolerance)
        # By whether elements are aligned: the two placements converge each on its own.
        stiffness = {False: 0.0, True: 0.0}
        closed: set[bool] = set()
        for coarse in choices(self.scene, self.truth, family, accuracies[0]):
            if coarse.aligned in closed or not coarse.open:
                continue
            if self._costs_more(coarse, stiffness[coarse.aligned]):
                closed.add(coarse.aligned)
                continue
            # First with fine terms: the remaining error comes from the elements, whatever the terms are.
            # 1e-6: relative accuracy of evaluation that shows whether a number of elements can meet the tolerance: its
            # own error is below that of any number of elements on the list
            probing = coarse.finest([min(1e-6, 0.1 * self.tolerance), *accuracies]) or coarse
            probe = self._measured(probing)
            if math.isfinite(probe.radius):
                stiffness[coarse.aligned] = probe.radius
            if probe.within(2.0 * self.tolerance, self.scene.fidelity.frequencies):
                self._cheapest_terms(coarse, accuracies, probe.radius)

    def _cheapest_terms(self, coarse: Choice, accuracies: tuple[float, ...], radius: float) -> None:
        before = 0
        for accuracy in accuracies:
            choice = coarse.with_accuracy(accuracy)
            if not choice.open:  # nor are choices with more terms and nodes
                return
            if choice.instructions == before:  # the same terms and nodes
                continue
            # Coarser terms change the radius a little: 1 % of margin before a choice is given up unmeasured.
            if self._costs_more(choice, 0.99 * radius):
                return
            before = choice.instructions
            measured = self._measured(choice)
            if measured.within(self.tolerance, self.scene.fidelity.frequencies):
                if self.best is None or measured.cost < self.best.cost:
                    self.best = measured
                return

    def _costs_more(self, choice: Choice, radius: float) -> bool:
        """Whether a choice costs more than the best, by a bound of its spectral radius."""
        rate = radius if self.scene.time is not None else 1.0
        return self.best is not None and choice.instructions * rate >= self.best.cost

    def _measured(self, choice: Choice) -> Assessment:
        measured = assess(choice, self.truth, stop_at=2.0 * self.tolerance)
        self.tried.append(measured)
        return measured


def _none_meets(scene: Scene, tolerance: float, tried: list[Assessment]) -> SolverError:
    def worst(assessment: Assessment) -> float:
        return float(np.nanmax([assessment.shape, *assessment.frequencies[: scene.fidelity.frequencies]]))

    closest = min((assessment for assessment in tried if math.isfinite(assessment.shape)), key=worst, default=None)
    none = "no choice has the equilibria of the exact rod within the listed bending ranges"
    fixed = [name for name in ("family", "elements", "accuracy") if getattr(scene.fidelity, name) is not None]
    free = f", or leave fidelity.{' and '.join(fixed)} open" if fixed else ""
    return SolverError(
        f"no choice of fidelity meets the tolerance of {tolerance:g}",
        status="tolerance not reached",
        violated=[none if closest is None else str(closest)],
        advice=f"raise fidelity.tolerance{free}",
        result=closest,
    )
