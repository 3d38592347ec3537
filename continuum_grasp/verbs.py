"""What a user asks of a scene: its tolerance, if it has one, becomes a model before a room is entered."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from os import PathLike

from numpy.typing import ArrayLike

from continuum_grasp import simulation
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.load import scene_of
from continuum_grasp.scene.loads import Load
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation import Equilibrium, Modes, Trajectory

__all__ = ["equilibrium", "modes", "simulate"]

Given = Scene | str | PathLike[str]


def simulate(scene: Given, *, progress: Callable[[float], None] | None = None) -> Trajectory:
    resolved, note = _resolved(scene)
    trajectory = simulation.simulate(resolved, progress=progress)
    return replace(trajectory, statistics={**trajectory.statistics, "fidelity": note}) if note else trajectory


def equilibrium(
    scene: Given,
    *,
    extra_loads: Sequence[Load] = (),
    guess: ArrayLike | None = None,
    stable: bool = True,
    side: int = 1,
    model: FingerModel | None = None,
) -> Equilibrium:
    resolved = scene_of(scene) if model is not None else _resolved(scene)[0]
    return simulation.equilibrium(resolved, extra_loads=extra_loads, guess=guess, stable=stable, side=side, model=model)


def modes(scene: Given, *, about: Equilibrium | None = None, points: int = 61) -> Modes:
    resolved = scene_of(scene) if about is not None else _resolved(scene, vibrates=True)[0]
    return simulation.modes(resolved, about=about, points=points)


def _resolved(scene: Given, *, vibrates: bool = False) -> tuple[Scene, str]:
    given = scene_of(scene)
    if given.fidelity.tolerance is None:
        return given, ""
    from continuum_grasp.accuracy.resolve import resolve_fidelity

    return resolve_fidelity(given, vibrates=vibrates)


for _verb in (simulate, equilibrium, modes):
    _verb.__doc__ = getattr(simulation, _verb.__name__).__doc__
