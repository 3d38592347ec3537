"""Static load cases that a scene passes: its loads and inputs frozen at the instants at which they turn."""

from __future__ import annotations

from dataclasses import dataclass

from continuum_grasp.scene.loads import Actuation, ForceLoad, Load, Samples, VectorSamples
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation.signals import interpolate

__all__ = ["LoadCase", "load_cases"]

_EVENLY = 7
"""Instants besides time zero and those at which a load or an input is greatest or least: few, as each costs an
equilibrium of the exact rod and one of every choice."""


@dataclass(frozen=True)
class LoadCase:
    """A scene whose loads and inputs are constant.

    Attributes
    ----------
    name : str
    scene : Scene
        With the loads of the scene, then those that hold its initial pose (zero where they do not act), all constant.
    rests : bool
        Whether small motions about its equilibrium are motions of the scene: nothing but its own loads acts.
    """

    name: str
    scene: Scene
    rests: bool = True


def load_cases(scene: Scene) -> list[LoadCase]:
    """List the load case at time zero, those of greatest and least loads and inputs, some between, and the held one.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    list of LoadCase
        That at time zero first.
    """
    sampled = [value for value in _values(scene) if isinstance(value, Samples | VectorSamples)]
    end = scene.time.duration if scene.time is not None else float("inf")
    instants = sorted({t for value in sampled for t in value.times if 0.0 < t <= end})
    chosen = set(instants[:: max(1, -(-len(instants) // _EVENLY))])
    for value in sampled:
        chosen |= {t for t in _extremes(value) if 0.0 < t <= end}
    found = [LoadCase(f"t = {t:g} s", _frozen(scene, t, held=False)) for t in (0.0, *sorted(chosen))]
    if scene.initial.held_by:
        found.append(LoadCase("held", _frozen(scene, 0.0, held=True), rests=False))
    return found


def _extremes(value: Samples | VectorSamples) -> set[float]:
    """Instants at which an entry of a sampled value is greatest or least."""
    rows = [entry if isinstance(entry, tuple) else (entry,) for entry in value.values]
    found = set()
    for column in zip(*rows, strict=True):
        found |= {value.times[column.index(max(column))], value.times[column.index(min(column))]}
    return found


def _values(scene: Scene) -> list[object]:
    values: list[object] = [load.force if isinstance(load, ForceLoad) else load.moment for load in scene.loads]
    if scene.actuation is not None:
        values += [scene.actuation.tip_moment, *(scene.actuation.tensions or ())]
    return values


def _frozen(scene: Scene, t: float, held: bool) -> Scene:
    loads = [_constant(load, t) for load in scene.loads]
    loads += [load if held else _without_value(load) for load in scene.initial.held_by]
    actuation = scene.actuation
    if actuation is not None and actuation.tensions is not None:
        first, second = (_scalar(tension, t) for tension in actuation.tensions)
        actuation = Actuation(tensions=(first, second))
    elif actuation is not None and actuation.tip_moment is not None:
        actuation = Actuation(tip_moment=_scalar(actuation.tip_moment, t))
    return scene.model_copy(update={"loads": tuple(loads), "actuation": actuation})


def _constant(load: Load, t: float) -> Load:
    if isinstance(load, ForceLoad):
        force = load.force
        if isinstance(force, VectorSamples):
            x, y = interpolate(force, [t])[0][0]
            force = (float(x), float(y))
        return load.model_copy(update={"force": force})
    return load.model_copy(update={"moment": _scalar(load.moment, t)})


def _without_value(load: Load) -> Load:
    return load.model_copy(update={"force": (0.0, 0.0)} if isinstance(load, ForceLoad) else {"moment": 0.0})


def _scalar(value: float | Samples, t: float) -> float:
    return float(interpolate(value, [t])[0][0]) if isinstance(value, Samples) else value
