"""The errors that the elements leave in equilibria and modes, by every element halved."""

from __future__ import annotations

import numpy as np

from continuum_grasp.base import Array, InputError, SolverError
from continuum_grasp.model import FingerModel
from continuum_grasp.simulation.accuracy.elements import apart_at_rest, refined, translated, whole_error
from continuum_grasp.simulation.static_shape import Equilibrium
from continuum_grasp.simulation.statics import equilibrium_of
from continuum_grasp.simulation.vibration import Modes, modes_of, relative_errors


def finer_equilibrium(coarse: Equilibrium) -> Equilibrium | float:
    """Solve for an equilibrium in elements of half the length; nan where none can be had, infinity where it is lost."""
    if coarse.scene is None:
        return np.nan
    try:
        scene = refined(coarse.scene, coarse.model)
        finer = FingerModel(scene, loads=coarse.model.loads, input_rates=False)
        guess = translated(coarse.model, coarse.q, coarse.u, finer)
        return equilibrium_of(scene, guess=guess, stable=coarse.stable, model=finer)
    except InputError:
        return np.nan
    except SolverError:
        return np.inf


def error_of_equilibrium(equilibrium: Equilibrium) -> float:
    """`Equilibrium.space_error`."""
    finer = finer_equilibrium(equilibrium)
    if not isinstance(finer, Equilibrium):
        return finer
    return whole_error(equilibrium.model) * apart_at_rest(equilibrium, finer)


def error_of_modes(coarse: Modes) -> Array:
    """`Modes.space_error`."""
    finer = finer_equilibrium(coarse.equilibrium)
    frequencies = coarse.frequencies_hz
    if not isinstance(finer, Equilibrium) or finer.scene is None:
        return np.full(len(frequencies), finer)
    true = modes_of(finer.scene, about=finer).frequencies_hz[: len(frequencies)]
    return relative_errors(frequencies, true, whole_error(coarse.equilibrium.model))
