"""The error that the elements leave in a motion: the same scene once more with every element halved."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from time import perf_counter

import numpy as np

from continuum_grasp.base import InputError, Interrupted, NumericalError, SolverError
from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Initial, Scene
from continuum_grasp.simulation.accuracy.elements import (
    COUNTS,
    PLACES,
    apart_at_rest,
    refined,
    translated,
    whole_error,
)
from continuum_grasp.simulation.contacts import greatest_motion
from continuum_grasp.simulation.resting import model_at_rest, rest_at
from continuum_grasp.simulation.run import integrate
from continuum_grasp.simulation.signals import Signals
from continuum_grasp.simulation.trajectory import Trajectory, error_text

_MOST = max(COUNTS)
"""Elements of a motion up to which a tolerance is pursued [1], as those among which one is chosen."""
_INSTANTS = 100
"""Instants of a motion that are compared [1]."""
_FEW = 4
"""Elements up to which the error at rest is stated unasked [1]: halves of four clothoids take 0.6 s of processor time,
of eight 12 s."""
_NOTICED = 0.01
"""Error at rest per length beyond which a motion has a warning [1]."""

_LONG = 5.0
"""Time from which on a finer motion is announced [s], which does not change the results."""
_LOG = logging.getLogger(__name__)


def motion_within(scene: Scene, tolerance: float | None, progress: Callable[[float], None] | None = None) -> Trajectory:
    """The motion of a scene, with its ``space_error`` where that is asked for, in as many elements as keep a tolerance.

    A finer motion that was compared with is the next one that is checked. Where no number of elements keeps the
    tolerance, or the finer motion is not found, a warning says so. Ctrl-C raises Interrupted with the motion.
    """
    if scene.time is not None and tolerance is not None:
        # 0.1: error in time per tolerance of the whole: what two motions compared have of it is then small against that
        # 1e-10: least error in time that can be asked for, per length
        steps = min(scene.time.tolerance, max(0.1 * tolerance, 1e-10))
        scene = scene.replaced(time=scene.time.replaced(tolerance=steps))
    started = perf_counter()
    motion = integrate(scene, progress=progress)
    if tolerance is None and not (scene.time and scene.time.space_error):
        return at_both_ends(motion)
    began = perf_counter()
    # 4.0: time of a motion per that with half its elements, where none was measured yet
    last = began - started
    growth = 4.0
    reached = ""
    while True:
        finer: Trajectory | None = None
        error = np.inf
        trouble = ""
        if growth * last > _LONG:
            count = 2 * len(motion.model.lengths)
            _LOG.info("%snext a motion of %d elements, about %.0f s", reached, count, growth * last)
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
        if finer is None or tolerance is None or error <= tolerance:
            break
        if len(finer.model.lengths) > _MOST:
            trouble = (
                f"{len(motion.model.lengths)} elements leave about {error:.2g} of the length (fidelity.tolerance is "
                f"{tolerance:g}): the motion is too sensitive for more; take a shorter duration, or a greater tolerance"
            )
            break
        reached = f"{len(motion.model.lengths)} elements leave {error:.2g} of the length, more than {tolerance:g}: "
        motion = finer
    statistics = {**motion.statistics, "space_error_s": perf_counter() - began}
    return replace(motion, statistics=statistics, warnings=(*motion.warnings, *([trouble] if trouble else [])))


def at_both_ends(motion: Trajectory) -> Trajectory:
    """The motion with its ``static_error``, and with remarks on its shapes at rest.

    That is the error that the elements leave where the finger is at rest under its first, and under its last inputs and
    loads: two equilibria in place of a second motion. It is not known with an object, whose contact forces are not
    forces of a finger that moves alone, and of many elements, whose halves are expensive.
    """
    scene, model = motion.scene, motion.model
    if scene.object is not None or len(model.lengths) > _FEW:
        return motion
    began = perf_counter()
    reached_by = (scene.initial.reached_by or "pulling") if model.friction_names else None
    if reached_by == "state":  # friction states of these elements say nothing of finer ones
        return motion
    held = scene.replaced(initial=Initial(pose="equilibrium", reached_by=reached_by, path=scene.initial.path))
    try:
        finer_scene = refined(held, model)
        finer = FingerModel(finer_scene, loads=model.loads, input_rates=False)
        coarse = model_at_rest(held, model, model.loads)
    except InputError:
        return motion
    ends = [(0.0, "its first", motion.q[0]), (float(motion.t[-1]), "its last", motion.q[-1])]
    if Signals(held, coarse).constant:
        ends = [(0.0, "its", motion.q[-1])]
    errors, warnings = list[float](), list[str]()
    for at, name, q in ends:
        try:
            rest = rest_at(held, coarse, at=at, guess=q)
        except SolverError:
            continue
        try:
            fine = rest_at(finer_scene, finer, at=at, guess=translated(coarse, rest.q, rest.u, finer))
            errors.append(whole_error(model) * apart_at_rest(rest, fine))
        except SolverError:
            errors.append(np.inf)
        where = f"at rest under {name} inputs and loads"
        if errors[-1] > _NOTICED:
            size = error_text(errors[-1], motion.length)
            warnings.append(f"{where} the error that the elements leave is {size}: take more, or fidelity.tolerance")
        known = motion.warnings
        said = [text for text in rest.warnings if not any(other.startswith(text.split(" (")[0]) for other in known)]
        warnings += [f"{where} {text}" for text in said]
    statistics = {**motion.statistics, "static_error_s": perf_counter() - began}
    error = max(errors, default=np.nan)
    return replace(motion, static_error=error, warnings=(*motion.warnings, *warnings), statistics=statistics)


def apart(first: Trajectory, other: Trajectory) -> float:
    """Greatest distance of the finger's places, and of the object's points, of two motions, per length [1]."""
    last = len(first.t) - 1
    some = np.unique(np.linspace(0, last, min(_INSTANTS, last + 1)).round().astype(int))
    # Evaluated without compiling, which would take longer.
    cores = [Core(each.model, compiled=False) for each in (first, other)]
    pairs = zip(cores, (first, other), strict=True)
    shapes = [core.backbones(each.q[some], each.acting[some], PLACES) for core, each in pairs]
    distance = float(np.linalg.norm(shapes[0] - shapes[1], axis=-1).max())
    if first.object_pose is not None and other.object_pose is not None and first.scene.object is not None:
        distance = max(distance, greatest_motion(first.scene.object, first.object_pose, other.object_pose))
    return distance / first.length
