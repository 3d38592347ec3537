"""Error and cost of one choice of fidelity."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.accuracy.choice import Choice
from continuum_grasp.accuracy.truth import STATIONS, TrueCase, Truth
from continuum_grasp.core import Core
from continuum_grasp.errors import InputError, SolverError
from continuum_grasp.model import FingerModel
from continuum_grasp.simulation.modes import modes
from continuum_grasp.simulation.signals import Signals
from continuum_grasp.simulation.spectrum import spectral_radius
from continuum_grasp.simulation.statics import Equilibrium, equilibrium_under

__all__ = ["Assessment", "Errors", "assess", "errors_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Errors:
    """Errors of a model against the exact rod.

    Attributes
    ----------
    tip : float
        Greatest error of the tip's position over the load cases, per length; infinite where one is not found.
    shape : float
        The same of any place along the finger.
    frequencies : (2,) ndarray
        Greatest relative error of the first and of the second natural frequency; NaN where there is none.
    radius : float
        Spectral radius about the equilibria [1/s], by which explicit steps are limited.
    """

    tip: float
    shape: float
    frequencies: Array
    radius: float


@dataclass(frozen=True)
class Assessment(Errors):
    """Errors of a choice, and its cost.

    Attributes
    ----------
    choice : Choice
    instructions : int
        Of the forward dynamics.
    """

    choice: Choice
    instructions: int

    @property
    def cost(self) -> float:
        """Instructions: per evaluation, and per second of explicit simulation where the scene moves."""
        return self.instructions * (self.radius if self.choice.scene.time is not None else 1.0)

    def within(self, tolerance: float, frequencies: int) -> bool:
        """Whether shape, and of a scene that moves the first frequencies, meet a tolerance."""
        asked = self.frequencies[: frequencies if self.choice.scene.time is not None else 0]
        return self.shape <= tolerance and bool(np.all(asked <= tolerance))


def assess(choice: Choice, truth: Truth, *, stop_at: float = math.inf) -> Assessment:
    """Measure errors and cost of a choice.

    Parameters
    ----------
    choice : Choice
    truth : Truth
        Of the choice's scene.
    stop_at : float
        Error of shape at which to stop and leave the rest unmeasured (NaN).
    """
    scene = choice.scene.model_copy(update={"fidelity": choice.fidelity, "loads": truth.loads})
    found = errors_of(FingerModel(scene, input_rates=False), truth, moves=scene.time is not None, stop_at=stop_at)
    return Assessment(**vars(found), choice=choice, instructions=choice.instructions)


def errors_of(model: FingerModel, truth: Truth, *, moves: bool, stop_at: float = math.inf) -> Errors:
    """Errors of any model that has the loads of a scene's load cases.

    Parameters
    ----------
    model : FingerModel
        With ``truth.loads``.
    truth : Truth
    moves : bool
        Whether frequencies are asked for.
    stop_at : float
        Error of shape at which to stop and leave the rest unmeasured (NaN).
    """
    core, length = Core(model, compiled=False), model.finger.rod.length
    tip = shape = radius = 0.0
    frequencies = np.zeros(2)
    for true in truth.cases:
        try:
            found = _at_rest(true, model)
        except (SolverError, InputError):
            return Errors(math.inf, math.inf, np.full(2, np.nan), math.inf)
        off = np.linalg.norm(found.backbone(STATIONS) - true.backbone, axis=1) / length
        tip, shape = max(tip, float(off[-1])), max(shape, float(off.max()))
        if shape > stop_at:
            return Errors(tip, shape, np.full(2, np.nan), math.nan)
        if true.frequencies_hz is not None and moves:
            frequencies = np.fmax(frequencies, _frequency_errors(true, true.frequencies_hz, found))
            radius = max(radius, spectral_radius(core, found.q[None], found.u, found.w, found.p))
    if model.n < 2:
        frequencies[1] = np.nan
    return Errors(tip, shape, frequencies, radius)


def _at_rest(true: TrueCase, model: FingerModel) -> Equilibrium:
    """The model's equilibrium, sought from the exact shape."""
    edges = np.concatenate([[0.0], np.cumsum(model.lengths)])
    edges[-1] = model.finger.rod.length  # the sum may be beyond the tip by rounding, where the exact rod is not
    family, short = model.structure.family, 1e-9 * edges[-1]
    first, last = edges[:-1, None], edges[1:, None]
    inside = np.clip(first + (last - first) * family.places, first + short, last - short)
    curvatures = true.rod.curvature(inside.ravel()).reshape(inside.shape)
    guess = family.coordinates(np.diff(true.rod.angle(edges)), curvatures)[: model.n]
    signals = Signals(true.case.scene, model, true.case.scene.loads)
    return equilibrium_under(model, signals.u(0.0)[0], signals.w(0.0)[0], guess=guess)


def _frequency_errors(true: TrueCase, truth: Array, found: Equilibrium) -> Array:
    """Relative errors of the first two frequencies; of one that is unstable in truth, per the second."""
    model = np.full(2, np.nan)
    own = modes(true.case.scene, about=found).frequencies_hz[:2]
    model[: len(own)] = own
    return np.asarray(np.abs(model - truth) / np.where(truth > 0.0, truth, max(float(truth.max()), 1e-300)))
