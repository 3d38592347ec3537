"""Simulate motions with a number of elements that suffices at rest, or in motion by comparison with halved elements."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np

from continuum_grasp.base import Array, InputError, Interrupted, NumericalError, SolverError
from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Initial, Scene
from continuum_grasp.simulation.accuracy.elements import MOST, PLACES, left_by_halves, refined, whole_error
from continuum_grasp.simulation.accuracy.resting import Level, RestCase, resolved
from continuum_grasp.simulation.accuracy.truth import frozen
from continuum_grasp.simulation.contacts import greatest_motion
from continuum_grasp.simulation.resolution import ENOUGH, Resolution
from continuum_grasp.simulation.rest import RestingShape
from continuum_grasp.simulation.resting import model_at_rest, rest_under
from continuum_grasp.simulation.run import integrate
from continuum_grasp.simulation.signals import Signals
from continuum_grasp.simulation.trajectory import Trajectory

_INSTANTS = 100
"""Instants of a motion that are compared [1]."""

_LONG = 5.0
"""Least expected time of a finer motion that is announced [s]; it does not change the results."""
_LOG = logging.getLogger(__name__)


def motion_within(scene: Scene, tolerance: float | None, progress: Callable[[float], None] | None = None) -> Trajectory:
    """Simulate the motion of a scene with a sufficient number of elements.

    The number follows from shapes at rest under the first and last inputs or, with a tolerance or ``time.space_error``,
    from motions: each finer motion is a reference first and the next candidate. If no number satisfies the limit, or
    the finer motion fails, the status and a warning say so. Ctrl-C raises Interrupted with the motion.
    """
    if scene.time is None or not (scene.time.space_error or tolerance):
        return _resolved_at_rest(scene, progress)
    if tolerance is not None:
        # 0.1: error in time per tolerance of the whole: what two motions compared have of it is then small against that
        # 1e-10: least error in time that can be asked for, per length
        steps = min(scene.time.tolerance, max(0.1 * tolerance, 1e-10))
        scene = scene.replaced(time=scene.time.replaced(tolerance=steps))
    return _resolved_in_motion(scene, tolerance, progress)


def _resolved_at_rest(scene: Scene, progress: Callable[[float], None] | None) -> Trajectory:
    """Return the motion with a number of elements that suffices at rest, with ``static_error`` and notes on these
    shapes.
    """
    began = perf_counter()
    model = None if scene.time is None else FingerModel(scene)
    rests, resolution = ({}, None) if model is None else at_both_ends(scene, model)
    took = perf_counter() - began
    chosen = next((rest.model.lengths for rest in rests.values() if rest is not None), None)
    if model is not None and chosen is not None and chosen != model.lengths:
        scene = refined(scene, model, chosen)
    motion = integrate(scene, progress=progress)
    if resolution is None:
        return motion
    known, warnings = motion.warnings, list[str]()
    for name, rest in rests.items():
        texts = () if rest is None else rest.warnings
        new = [text for text in texts if not any(other.startswith(text.split(" (")[0]) for other in known)]
        warnings += [f"at rest under {name} inputs and loads {text}" for text in new]
    return motion.judged(resolution, tuple(warnings), static_error_s=took)


def _resolved_in_motion(scene: Scene, tolerance: float | None, progress: Callable[[float], None] | None) -> Trajectory:
    """Return the motion with a number of elements that suffices in motion, with ``space_error``; see
    ``motion_within``.
    """
    limit = ENOUGH if tolerance is None else tolerance
    pursued = tolerance is not None or scene.fidelity.elements is None
    started = perf_counter()
    motion = integrate(scene, progress=progress)
    began = perf_counter()
    # 4.0: time of a motion per time with half its elements, before any measurement
    last = began - started
    growth = 4.0
    reached = ""
    while True:
        finer: Trajectory | None = None
        error = np.inf
        count = len(motion.model.lengths)
        trouble = ""
        if growth * last > _LONG:
            _LOG.info("%snext a motion of %d elements, about %.0f s", reached, 2 * count, growth * last)
        try:
            before = perf_counter()
            finer = integrate(refined(motion.scene, motion.model), progress=progress)
            growth, last = (perf_counter() - before) / last, perf_counter() - before
            error = whole_error(motion.model) * apart(motion, finer)
        except Interrupted as stop:
            raise Interrupted("interrupted after the end of the motion", result=motion) from stop
        except InputError as reason:
            error = np.nan
            trouble = f"the error that the elements leave is not known: {reason}"
        except (NumericalError, SolverError) as reason:
            trouble = f"the error that the elements leave cannot be estimated; with twice as many: {reason}"
        motion = replace(motion, space_error=error)
        if finer is None or not pursued or error <= limit or 2 * count > MOST:
            break
        reached = f"{count} elements leave {error:.2g} of the length, more than {limit:g}: "
        motion = finer
    resolution = Resolution(count, error, limit=limit, stated=not pursued, tried=count, raised=reached.rstrip(": "))
    if finer is not None and not pursued and error > limit:
        # From the credited order of convergence.
        halvings = math.ceil(math.log(error / limit) / -math.log(left_by_halves(motion.model)))
        resolution = replace(resolution, enough=count * 2**halvings)
    said = (trouble,) if trouble else ()
    return motion.judged(resolution, said, space_error_s=perf_counter() - began)


def at_both_ends(scene: Scene, model: FingerModel) -> tuple[dict[str, RestingShape | None], Resolution | None]:
    """Find shapes at rest, with a sufficient number of elements, under the first, last and held inputs of a motion.

    Equilibria and small motions about them replace a second motion. They are unknown with an object, because a finger
    alone has no contact forces, and if friction states belong to these elements alone.
    """
    reached_by = (scene.initial.reached_by or "pulling") if model.friction_names else None
    if scene.object is not None or scene.time is None or reached_by == "state":
        return {}, None
    initial = scene.initial
    start = Initial(pose="equilibrium", reached_by=reached_by, path=initial.path, held_by=initial.held_by)
    held = scene.replaced(initial=start, time=None)
    first, last = frozen(held, 0.0), frozen(held, scene.time.duration)
    scenes = {"its first": first, "its last": last} if last != first else {"its": first}
    if start.held_by:
        scenes["the held"] = frozen(held, 0.0, held=True)
    coarse = model_at_rest(held, model, first.loads)
    cases = [RestCase(each, partial(_at_rest, each)) for each in scenes.values()]
    stated = scene.fidelity.elements is not None
    try:
        level, resolution = resolved(
            Level(held, coarse, cases), limit=None, stated=stated, frequencies=scene.fidelity.frequencies
        )
    except SolverError:
        return {}, None
    return dict(zip(scenes, level.rests, strict=True)), resolution


def _at_rest(case: Scene, _: Scene, model: FingerModel, guess: Array | None) -> RestingShape:
    """Find the shape at rest of a model under the inputs and loads of a load case."""
    signals = Signals(case, model, case.loads)
    friction = model.structure.friction_of(case.initial)
    return rest_under(model, signals.u(0.0)[0], signals.w(0.0)[0], friction, guess=guess)


def apart(first: Trajectory, other: Trajectory) -> float:
    """Greatest distance of the finger's places, and of the object's points, of two motions, per length [1]."""
    last = len(first.t) - 1
    some = np.unique(np.linspace(0, last, min(_INSTANTS, last + 1)).round().astype(int))
    # Evaluated without compiling, which would take longer.
    cores = [Core(each.model, compiled=False) for each in (first, other)]
    pairs = zip(cores, (first, other), strict=True)
    shapes = [core.backbones(each.q[some], each.acting[some], len(PLACES)) for core, each in pairs]
    distance = float(np.linalg.norm(shapes[0] - shapes[1], axis=-1).max())
    if first.object_pose is not None and other.object_pose is not None and first.scene.object is not None:
        distance = max(distance, greatest_motion(first.scene.object, first.object_pose, other.object_pose))
    return distance / first.length
