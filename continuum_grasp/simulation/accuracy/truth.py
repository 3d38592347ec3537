"""Truth about a scene: equilibria and natural frequencies of the exact elastic rod in its load cases.

Load cases are static: the loads and inputs of the scene, frozen at the instants of their greatest and least values.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from continuum_grasp.base import Array, SolverError
from continuum_grasp.rod import Elastica, natural_frequencies, solve_elastica
from continuum_grasp.scene import Actuation, ForceLoad, Load, Samples, Scene, VectorSamples
from continuum_grasp.simulation.signals import interpolate

_HELD = "held"
"""Name of the load case that holds the initial pose."""
STATIONS = 101
"""Number of places along the finger for the comparison of shapes, including base and tip: 1 % of the length apart."""


@dataclass(frozen=True)
class TrueCase:
    """A load case of the exact rod."""

    scene: Scene  # with loads and inputs that are constant
    rod: Elastica
    backbone: Array  # (STATIONS, 2) world positions at equally spaced places [m]
    frequencies_hz: Array | None  # (2,) first natural frequencies about it; None if its holding loads are released


@dataclass(frozen=True)
class Truth:
    """The exact rod of a scene."""

    cases: tuple[TrueCase, ...]  # that at time zero first
    omitted: tuple[str, ...]  # cases without an equilibrium or beyond one and a half turns, and why

    @property
    def loads(self) -> tuple[Load, ...]:
        """Loads of every load case, in order: the scene's loads, then the loads that hold the initial pose."""
        return self.cases[0].scene.loads

    def curvature_reach(self, start: float, end: float, moving: bool) -> float:
        """Greatest curvature [1/m] of a segment of the finger at rest, or swinging about one load case from another.

        An undamped swing goes as far beyond its equilibrium as it starts before it.
        """
        problem = self.cases[0].rod.equations.problem
        short = 1e-9 * problem.length
        jumps = [at for at in problem.length * np.array(problem.breaks) if start + short < at < end - short]
        # Before jumps of the curvature too.
        s = np.sort([*np.linspace(start, end, 9)[:-1], *jumps, *(at - short for at in jumps), np.nextafter(end, start)])
        curvatures = np.array([case.rod.curvature(s) for case in self.cases])
        reach = np.abs(curvatures)
        if moving:
            starts = np.concatenate([curvatures, [np.broadcast_to(self.start_curvature(s), s.shape)]])
            reach = reach + np.abs(starts[:, None] - curvatures[None, :]).max(axis=0)
        return float(reach.max())

    def start_curvature(self, s: Array) -> Array:
        """Curvature [1/m] of the initial pose at places (n,) [m]."""
        scene = self.cases[0].scene
        if scene.initial.pose == "equilibrium":
            return np.asarray(self.cases[-1 if scene.initial.held_by else 0].rod.curvature(s))
        if scene.initial.pose == "rest":
            return scene.finger.profile.rest_curvature(s)
        return np.zeros_like(s)


def find_truth(scene: Scene) -> Truth:
    """Solve the exact rod in every load case of a scene; the equilibrium at time zero must be found."""
    scene.check_for_several_models()
    s = np.linspace(0.0, scene.finger.rod.length, STATIONS)
    cases: list[TrueCase] = []
    omitted: list[str] = []
    for name, case in load_cases(scene):
        rests = name != _HELD  # small motions about it are motions of the scene: nothing but its own loads acts
        try:
            # Far below the errors of models: two matched clothoids have 6e-6 under P L^2 / EI = 1.
            rod = solve_elastica(case, tolerance=1e-9)
        except SolverError as error:
            if not cases and rests:
                raise
            omitted.append(f"{name}: {str(error).splitlines()[0]}")
            continue
        turn = float(abs(rod.angle(s) - scene.finger.base.angle).max())
        # one and a half turns: a load that lasts for a moment does not bend so far
        if cases and turn > 3.0 * np.pi:
            omitted.append(f"{name}: bends the finger by {turn:.3g} rad")
            continue
        frequencies = natural_frequencies(scene.finger, rod) if rests else None
        cases.append(TrueCase(case, rod, rod.position(s), frequencies))
    return Truth(tuple(cases), tuple(omitted))


def load_cases(scene: Scene) -> list[tuple[str, Scene]]:
    """List the load case at time zero, cases of greatest and least loads and inputs, some between, and the held one.

    Each is a name and a scene with constant loads and inputs. Its loads are the scene's, then the loads that hold the
    initial pose (zero if they do not act), so that one model serves all cases. No case has the object of the scene,
    because the exact rod has no contacts.
    """
    values: list[object] = [load.value for load in scene.loads]
    if scene.actuation is not None:
        values += scene.actuation.values
    sampled = [value for value in values if isinstance(value, Samples | VectorSamples)]
    end = scene.time.duration if scene.time is not None else float("inf")
    instants = sorted({t for value in sampled for t in value.times if 0.0 < t <= end})
    # 7: instants besides time zero and those at which a load or an input is greatest or least: few, as each costs an
    # equilibrium of the exact rod and one of every choice
    chosen = set(instants[:: max(1, -(-len(instants) // 7))])
    for value in sampled:
        chosen |= {t for t in _extremes(value) if 0.0 < t <= end}
    if any(value.times[-1] > end for value in sampled):
        chosen.add(end)  # between two samples
    cases = [(f"t = {t:g} s", frozen(scene, t)) for t in (0.0, *sorted(chosen))]
    if scene.initial.held_by:
        cases.append((_HELD, frozen(scene, 0.0, held=True)))
    return cases


def _extremes(value: Samples | VectorSamples) -> set[float]:
    """Return the instants of the greatest and least values of each entry of a sampled value."""
    rows = np.reshape(value.values, (len(value.times), -1))
    return {value.times[k] for k in (*rows.argmax(axis=0), *rows.argmin(axis=0))}


def frozen(scene: Scene, t: float, held: bool = False) -> Scene:
    """Return the scene with the inputs and loads of an instant [s], without its object; see `load_cases`."""
    loads = [_with_value(load, _at(load.value, t)) for load in scene.loads]
    for load in scene.initial.held_by:
        nothing = (0.0, 0.0) if isinstance(load, ForceLoad) else 0.0
        loads.append(load if held else _with_value(load, nothing))
    actuation = scene.actuation
    if actuation is not None:
        actuation = Actuation.of(scene.finger.input_keys, [_at(value, t) for value in actuation.values])
    return scene.model_copy(update={"loads": tuple(loads), "actuation": actuation, "object": None})


def _with_value(load: Load, value: Any) -> Load:
    return load.model_copy(update={"force" if isinstance(load, ForceLoad) else "moment": value})


def _at(value: Any, t: float) -> Any:
    """A force (2 numbers) or another value at an instant."""
    frozen = interpolate(value, [t])[0][0].tolist()
    return tuple(frozen) if isinstance(frozen, list) else frozen
