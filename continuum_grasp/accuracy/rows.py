"""Rows of the report: what each choice costs and how wrong it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from benchmarks.paper import VARIANTS, PaperModel
from continuum_grasp.accuracy.choice import ACCURACIES, FAMILIES, Choice, choices
from continuum_grasp.accuracy.measure import errors_of, measure
from continuum_grasp.accuracy.motion import INSTANTS, Motion, Runs, pace, rms
from continuum_grasp.accuracy.timing import evaluation_error, evaluation_ns
from continuum_grasp.accuracy.truth import Truth
from continuum_grasp.core import Core
from continuum_grasp.errors import ContinuumGraspError, InputError, NumericalError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.integrators import INTEGRATORS, SIMULATION_METHODS
from continuum_grasp.scene.simulate import Fidelity, Scene

__all__ = ["NOTES", "Measuring", "columns_of"]

COLUMNS = (
    "model",
    "elements",
    "unknowns",
    "instructions",
    "evaluation [ns]",
    "real-time factor",
    "tip / L",
    "shape / L",
    "frequency 1",
    "frequency 2",
    "motion / L",
)
_LONGEST = 10_000
"""Instructions of the forward dynamics up to which a model is compiled and timed."""
_STEPS = tuple(
    (name, count)
    for name in SIMULATION_METHODS
    for count in ((1, 2, 4) if INTEGRATORS[name].stable is None else (1, 2, 4, 8))
)
"""Methods and steps between two instants."""
_FINEST = 64
_EQUAL = 1e-4
"""Error of the time steps, per length, at which real-time factors are compared."""


NOTES = {
    "choices": "Greatest errors over the static poses, and of the natural frequencies about them; r.m.s. error of the "
    f"tip in motion; real-time factor with Runge-Kutta steps whose own error is {_EQUAL:g} of the length.",
    "integrators": "Greatest error of the tip by the steps alone; as called from Python.",
    "terms": "Greatest error of the accelerations by terms and nodes that are left out, per their greatest entry, over "
    "states in the declared range.",
    "precision": "As in the table of terms, by rounding alone.",
    "paper": "The paper's equations, doi:10.1155/2014/308283, as printed and corrected; see docs/errata.md.",
}


def columns_of(title: str) -> tuple[str, ...]:
    if title == "integrators":
        return ("model", "method", "steps per s", "real-time factor", "error of steps / L")
    if title == "terms":
        return ("model", "accuracy", "instructions", "evaluation [ns]", "error of xd")
    if title == "precision":
        return ("model", "real", "evaluation [ns]", "error of xd")
    return COLUMNS


Job = Callable[[], "tuple[Any, ...] | None"]


class Measuring:
    """Rows of the tables, one by one."""

    def __init__(self, scene: Scene, truth: Truth, reference: Motion | None) -> None:
        self.scene, self.truth, self.reference = scene, truth, reference
        bare = FingerModel(scene.model_copy(update={"fidelity": Fidelity()}))
        self.families = FAMILIES if bare.family == "matched_clothoid" else FAMILIES[1:]

    def jobs(self, counts: Sequence[int]) -> Iterator[tuple[str, Job]]:
        """Title of the table and what gives its next row."""
        for family in reversed(self.families):
            for choice in choices(self.scene, self.truth, family, None, counts=counts):
                yield "choices", lambda choice=choice: self._choice(choice)  # type: ignore[misc]
        for family in ("arc", self.families[0]):
            two = [c for c in choices(self.scene, self.truth, family, None) if c.elements >= 2]
            if not two:
                continue
            for accuracy in ACCURACIES:
                yield "terms", lambda c=two[0], a=accuracy: self._terms(c, a)  # type: ignore[misc]
            for real in ("double", "float"):
                yield "precision", lambda c=two[0], r=real: self._precision(c, r)  # type: ignore[misc]
            if self.reference is not None:
                for method, substeps in _STEPS:
                    yield "integrators", lambda c=two[0], m=method, n=substeps: self._integrator(c, m, n)  # type: ignore[misc]
        for variant in VARIANTS:
            yield "paper", lambda v=variant: self._paper(v)  # type: ignore[misc]

    def _choice(self, choice: Choice) -> tuple[Any, ...]:
        found = measure(choice, self.truth)
        name = choice.family + (", aligned" if choice.aligned else "")
        errors = (found.tip, found.shape, *found.frequencies)
        return self._row(name, choice, choice.model, errors)

    def _row(self, name: str, choice: Choice, model: FingerModel, errors: tuple[float, ...]) -> tuple[Any, ...]:
        instructions = int(model.forward_dynamics.n_instructions())
        scene = self.scene.model_copy(update={"fidelity": choice.fidelity})
        moving = self.reference is not None
        time, factor, motion = math.nan, math.nan, math.nan
        if instructions <= _LONGEST:
            time = evaluation_ns(model)
            if self.reference is not None:
                try:
                    run = pace(scene, model, _EQUAL)
                    factor, motion = run.real_time_factor, rms(run.tip - self.reference.tip) / model.finger.rod.length
                except ContinuumGraspError:  # no such start, or no motion that stays finite
                    motion = math.inf
        tip, shape, first, second = errors if moving else (*errors[:2], math.nan, math.nan)
        return (name, len(model.lengths), model.n, instructions, time, factor, tip, shape, first, second, motion)

    def _terms(self, choice: Choice, accuracy: float) -> tuple[Any, ...]:
        model, full = choice.with_accuracy(accuracy).model, choice.with_accuracy(1e-15).model
        name = f"{choice.elements} {choice.family}"
        error = evaluation_error(model.forward_dynamics, full)
        return (name, accuracy, int(model.forward_dynamics.n_instructions()), evaluation_ns(model), error)

    def _precision(self, choice: Choice, real: str) -> tuple[Any, ...] | None:
        core = Core(choice.model, precision="double")
        if not core.compiled:
            return None
        core = Core(choice.model, precision=real)
        error = evaluation_error(lambda *x: core.forward_dynamics(*x), choice.model)
        return (f"{choice.elements} {choice.family}", real, evaluation_ns(choice.model, precision=real), error)

    def _integrator(self, choice: Choice, method: str, substeps: int) -> tuple[Any, ...] | None:
        runs = Runs(self.scene.model_copy(update={"fidelity": choice.fidelity}), choice.model)
        finest, length = runs.tip(_FINEST), choice.model.finger.rod.length
        try:
            off = runs.tip(substeps, method) - finest
        except NumericalError:
            return (f"{choice.elements} {choice.family}", method, round(substeps / runs.step), math.nan, math.inf)
        factor = INSTANTS * runs.step / runs.seconds(substeps, method)
        error = float(np.linalg.norm(off, axis=1).max()) / length
        return (f"{choice.elements} {choice.family}", method, round(substeps / runs.step), factor, error)

    def _paper(self, variant: str) -> tuple[Any, ...] | None:
        two = [c for c in choices(self.scene, self.truth, "arc", None) if c.elements == 2]
        if not two:
            return None
        scene = self.scene.model_copy(update={"fidelity": two[0].fidelity})
        across, held = variant == "appendix_printed", scene.model_copy(update={"loads": self.truth.loads})
        try:
            model = PaperModel(scene, variant, gravity_across=across)
            static = PaperModel(held, variant, gravity_across=across)
        except InputError:
            return None
        found = errors_of(static, self.truth, moves=self.scene.time is not None)
        return self._row(variant, two[0], model, (found.tip, found.shape, *found.frequencies))
