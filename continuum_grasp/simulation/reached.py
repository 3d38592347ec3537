"""Find the bends of a finger in its scene, for generated code, which must fix its range in advance."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from continuum_grasp.base import Array, InputError, SolverError, check_arguments
from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Scene
from continuum_grasp.simulation.initial import initial_state
from continuum_grasp.simulation.resting import model_at_rest, rest_at
from continuum_grasp.simulation.signals import Signals


@check_arguments
def bends_of(scene: Scene, model: FingerModel) -> list[float]:
    """Find how far a scene bends the elements of its finger at rest.

    Parameters
    ----------
    scene : Scene
        The scene. With an object, which may hold the finger back, only the start counts.
    model : FingerModel
        The scene's model, or one with other elements.

    Returns
    -------
    list of float
        Greatest bend of each element [rad]: at the start, and at rest under the inputs and loads of every instant at
        which they take a sampled value; at least the model's ``ranges``.
    """
    shares = [np.zeros(len(model.ranges)), *_shares(scene, model)]
    # 1.25: range per bend beyond the range, because a motion continues from there
    bends = np.max(shares, axis=0) * model.ranges
    return [1.25 * bend if bend > reach else reach for bend, reach in zip(bends.tolist(), model.ranges, strict=True)]


def _shares(scene: Scene, model: FingerModel) -> Iterator[Array]:
    """Yield the used shares of the bending ranges (elements,) in each of these shapes that exists."""
    core, signals, p = Core(model, compiled=False), Signals(scene, model), np.array(model.p_nominal)
    unknown = suppress(InputError, SolverError)  # a history of friction that is not stated, or no shape at rest
    with unknown:
        yield np.asarray(core.range_use(initial_state(scene, model)[: model.n], signals.u(0.0)[0], p))
    if scene.object is not None or not (scene.actuation or scene.loads):
        return
    reached_by = scene.initial.reached_by or ("pulling" if model.friction_names else None)
    held = scene.replaced(initial=scene.initial.replaced(pose="equilibrium", q=None, qd=None, reached_by=reached_by))
    at_rest = model_at_rest(held, model, model.loads)
    resting = Core(at_rest, compiled=False)
    for at in signals.instants(np.inf):
        with unknown:
            found = rest_at(held, at_rest, at=at)
            yield np.asarray(resting.range_use(found.q, found.u, found.p))
