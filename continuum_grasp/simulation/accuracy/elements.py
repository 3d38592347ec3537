"""Elements of a finger's models: the numbers to try, a scene in more elements, shapes in other elements.

One mechanism for motions, equilibria and modes of every finger: lengths, bending coordinates and damping per element
are translated, everything else of the scene stays.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.model import FingerModel
from continuum_grasp.rod import DenseRod
from continuum_grasp.scene import Consumer, Fidelity, Initial, Scene
from continuum_grasp.simulation.signals import Signals

COUNTS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16)
"""Numbers of elements that are tried: each of the few, then in steps of a quarter or so, which bound the excess
cost."""
MOST = max(COUNTS)
"""Greatest number of elements that a search tries: forward dynamics of twice as many take four times as long. An
equilibrium that rises from 2 to 8 takes 3 to 7 times the processor time of 2 alone, and one that rises to 16 takes 10
to 13 times (clothoids and arcs under forces of 1 to 150 EI / L^2): the number is the budget, not the time, so that a
result does not depend on the machine."""
PLACES = np.linspace(0.0, 1.0, 21)
"""Compared places along the finger, per length [1]."""
_PANEL = 1 / 40
"""Longest panel of the integration of a shape, per length [1]: five nodes are exact to 1e-9 of the length if the panel
bends by a radian."""

_HALVED = Consumer("accuracy in space", {"initial.friction_states": "belongs to these elements"})

Curve = Callable[[Array], Array]


def refined(scene: Scene, model: FingerModel, lengths: tuple[float, ...] = ()) -> Scene:
    """Return the scene with elements of other lengths [m] than the model's, by default with every element halved.

    InputError if the scene fits that model alone.
    """
    _HALVED.check(scene)
    growth = len(lengths) / len(model.lengths) if lengths else 2.0
    lengths = lengths or _halved(model)
    # A moment per rate of an element's bend is one per rate of curvature times its length.
    damping = scene.finger.damping
    finger = scene.finger.replaced(damping=damping.replaced(per_arc=growth * damping.per_arc))
    # The same greatest curvature.
    reach = None if scene.fidelity.bending_range is None else scene.fidelity.bending_range / growth
    fidelity = Fidelity(family=model.family, elements=lengths, bending_range=reach)
    same = scene.replaced(finger=finger, fidelity=fidelity)
    initial = scene.initial
    if initial.q is None:
        return same
    finer = FingerModel(same.replaced(initial=Initial(pose="straight")))  # with the coordinates of the scene's model
    u = Signals(scene, model).u(0.0)[0]
    q = np.array(initial.q)
    at = translated(model, q, u, finer)
    state = {"q": tuple(at.tolist())}
    if initial.qd is not None:
        state["qd"] = tuple((translated(model, q + initial.qd, u, finer) - at).tolist())
    return same.replaced(initial=initial.replaced(**state))


def _halved(model: FingerModel) -> tuple[float, ...]:
    """Return the lengths after halving all elements."""
    # 0.25: length of an element per the mean up to which it is not halved. Short ones enclose couples, 2 % of the
    # length among two to eight others; their half would be the stiffest by far. Those of a taper of 1:16 differ less
    short = 0.25 * model.finger.rod.length / len(model.lengths)
    return tuple(part for h in model.lengths for part in ([0.5 * h, 0.5 * h] if h > short else [h]))


class ModelShape:
    """Curvature, angle and position along a model's shape, from the shapes of its coordinates."""

    def __init__(self, model: FingerModel, q: Array, u: Array, p: Array | None = None) -> None:
        self._ends = np.array([0.0, *accumulate(model.lengths)])
        self._family = model.structure.family
        self._coordinates = model.full_coordinates(q, u, p)
        self._rod = DenseRod(model.finger, self._ends, _PANEL)
        self._nodal = self.curvature(self._rod.nodes)

    def curvature(self, s: Array) -> Array:
        """Return the curvature [1/m] at places (M,) [m]; at a jump, the value on the far side."""
        elements = np.clip(np.searchsorted(self._ends, s, side="right") - 1, 0, len(self._ends) - 2)
        curvature = np.empty(len(s))
        for k in np.unique(elements).tolist():
            here = elements == k
            *shapes, rest = self._family.shapes_at(k, s[here])
            curvature[here] = rest + self._coordinates[list(self._family.local(k))] @ np.array(shapes)
        return curvature

    def angle(self, s: Array) -> Array:
        """Return the world angles (M,) of the sections at places (M,) [m], in rad."""
        return self._rod.at(self._nodal, s)[1]

    def position(self, s: Array) -> Array:
        """Return the world positions (M, 2) [m] of places (M,) [m]."""
        return self._rod.at(self._nodal, s)[0]


def translated(model: FingerModel, q: Array, u: Array, finer: FingerModel) -> Array:
    """Return coordinates (n,) of a finer model near the shape q of a model under an input u."""
    shape = ModelShape(model, q, u)
    return coordinates_near(finer, shape.angle, shape.curvature)


def coordinates_near(model: FingerModel, angle: Curve, curvature: Curve) -> Array:
    """Return coordinates (n,) of a model near a shape with known angle [rad] and curvature [1/m] at places (s,) [m].

    The curvature may jump at ends of elements, so it is taken inside the elements.
    """
    edges = np.concatenate([[0.0], np.cumsum(model.lengths)])
    edges[-1] = model.finger.rod.length  # by rounding, the sum may lie beyond the tip
    family = model.structure.family
    first = edges[:-1, None]
    last = edges[1:, None]
    short = 1e-9 * edges[-1]
    inside = np.clip(first + (last - first) * family.places, first + short, last - short)
    curvatures = curvature(inside.ravel()).reshape(inside.shape)
    return np.asarray(family.coordinates(np.diff(angle(edges)), curvatures)[: model.n])


def whole_error(model: FingerModel) -> float:
    """Error of a model per its difference to elements of half the length [1]."""
    return 1.0 / (1.0 - left_by_halves(model))


def left_by_halves(model: FingerModel) -> float:
    """Return the share of a model's error that remains with elements of half the length [1]."""
    # 0.5: credited share of a family's order of convergence: few elements, tapers and friction reach no more. In random
    # scenes (``benchmarks.bench_space_error``) the whole order covers the true error of 55 to 86 % only
    return float(2.0 ** (-0.5 * model.structure.family.order))
