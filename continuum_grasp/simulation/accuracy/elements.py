"""Elements of a finger's models: numbers that are tried, a scene with every element halved, shapes in other elements.

One mechanism for motions, equilibria and modes of every finger: lengths, bending coordinates and damping per element
are translated, everything else of the scene stays.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Consumer, Fidelity, Initial, Scene
from continuum_grasp.simulation.rest import RestingShape
from continuum_grasp.simulation.signals import Signals

COUNTS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16)
"""Numbers of elements that are tried: each of the few, then in steps of a quarter or so, which bound the excess
cost."""
PLACES = 21
"""Places along the finger that are compared [1]."""

_HALVED = Consumer("accuracy in space", {"initial.friction_states": "belongs to these elements"})

Curve = Callable[[Array], Array]


def refined(scene: Scene, model: FingerModel) -> Scene:
    """The scene with every element of its model halved; InputError where the scene is one of that model alone."""
    count = len(model.lengths)
    length = model.finger.rod.length
    _HALVED.check(scene)
    # 0.25: length of an element per the mean up to which it is not halved. Short ones enclose couples, 2 % of the
    # length among two to eight others; their half would be the stiffest by far. Those of a taper of 1:16 differ less
    long = [h > 0.25 * length / count for h in model.lengths]
    lengths = tuple(
        part for h, halved in zip(model.lengths, long, strict=True) for part in ([0.5 * h, 0.5 * h] if halved else [h])
    )
    # A moment per rate of an element's bend is one per rate of curvature times its length.
    damping = scene.finger.damping
    finger = scene.finger.replaced(damping=damping.replaced(per_arc=2.0 * damping.per_arc))
    # The same greatest curvature.
    reach = None if scene.fidelity.bending_range is None else 0.5 * scene.fidelity.bending_range
    fidelity = Fidelity(family=model.family, elements=lengths, bending_range=reach)
    same = scene.replaced(finger=finger, fidelity=fidelity)
    initial = scene.initial
    if initial.q is None:
        return same
    finer = FingerModel(same.replaced(initial=Initial(pose="straight")))  # coordinates are those of the scene's model
    u = Signals(scene, model).u(0.0)[0]
    q = np.array(initial.q)
    at = translated(model, q, u, finer)
    state = {"q": tuple(at.tolist())}
    if initial.qd is not None:
        state["qd"] = tuple((translated(model, q + initial.qd, u, finer) - at).tolist())
    return same.replaced(initial=initial.replaced(**state))


def translated(model: FingerModel, q: Array, u: Array, finer: FingerModel) -> Array:
    """Coordinates (n,) of a finer model near the shape q of a model under an input u."""
    core = Core(model, compiled=False)
    family = finer.structure.family
    # The curvature by differences inside the elements, where the angle is smooth.
    step = 1e-5 * np.diff([0.0, *accumulate(finer.lengths)])

    def angle(s: Array) -> Array:
        return np.asarray(core.batch("orientation", q, u, s[:, None], None)).ravel()

    def curvature(s: Array) -> Array:
        steps = np.repeat(step, family.places.size)
        return (angle(s + steps) - angle(s - steps)) / (2.0 * steps)

    return coordinates_near(finer, angle, curvature, step)


def coordinates_near(model: FingerModel, angle: Curve, curvature: Curve, inset: Array | None = None) -> Array:
    """Coordinates (n,) of a model near a shape, given by its angle [rad] and curvature [1/m] at places (s,) [m].

    The curvature, which jumps at couples, where elements end, is taken ``inset`` (elements,) [m] from there.
    """
    edges = np.concatenate([[0.0], np.cumsum(model.lengths)])
    edges[-1] = model.finger.rod.length  # the sum may be beyond the tip by rounding, where there is no shape
    family = model.structure.family
    first = edges[:-1, None]
    last = edges[1:, None]
    short = 1e-9 * edges[-1] if inset is None else inset[:, None]
    inside = np.clip(first + (last - first) * family.places, first + short, last - short)
    curvatures = curvature(inside.ravel()).reshape(inside.shape)
    return np.asarray(family.coordinates(np.diff(angle(edges)), curvatures)[: model.n])


def whole_error(model: FingerModel) -> float:
    """Error of a model per its difference to elements of half the length [1]."""
    # 0.5: share of a family's order of convergence that is believed: few elements, tapers and friction reach no more.
    # Of random scenes (``benchmarks.bench_space_error``) the whole order covers the true error of 55 to 86 % only
    return float(1.0 / (1.0 - 2.0 ** (-0.5 * model.structure.family.order)))


def apart_at_rest(first: RestingShape, other: RestingShape) -> float:
    """Greatest distance of the finger's places of two equilibria, per length [1]."""
    distance = np.linalg.norm(first.backbone(PLACES) - other.backbone(PLACES), axis=-1).max()
    return float(distance / first.model.finger.rod.length)
