"""Equilibrium under constant loads, also beyond buckling."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.core.call import real_array
from continuum_grasp.errors import InputError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.loads import Load
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation.search import Equilibrium, Search
from continuum_grasp.simulation.signals import Signals

__all__ = ["Equilibrium", "equilibrium", "equilibrium_path", "equilibrium_under"]

Array = NDArray[np.float64]


def equilibrium(
    scene: Scene,
    *,
    extra_loads: Sequence[Load] = (),
    guess: ArrayLike | None = None,
    stable: bool = True,
    side: int = 1,
    model: FingerModel | None = None,
) -> Equilibrium:
    """Find the equilibrium of a scene without ``fidelity.tolerance``; see `continuum_grasp.equilibrium`."""
    if scene.object is not None:
        raise InputError("statics and modes know no contact: leave the object out", key="object")
    if model is not None and extra_loads:
        raise InputError("give extra_loads, or a model that has them among its loads, not both")
    if model is None:
        model = FingerModel(scene, loads=(*scene.loads, *extra_loads), input_rates=False)
    signals = Signals(scene, model)
    return equilibrium_under(model, signals.u(0.0)[0], signals.w(0.0)[0], guess=guess, stable=stable, side=side)


def equilibrium_under(
    model: FingerModel,
    u: ArrayLike,
    w: ArrayLike,
    *,
    guess: ArrayLike | None = None,
    stable: bool = True,
    side: int = 1,
) -> Equilibrium:
    """Find the equilibrium of a model under constant input and forces.

    Parameters
    ----------
    model : FingerModel
        The model; parameters are nominal.
    u : (nu,) array_like
        Input.
    w : (nw,) array_like
        Forces.
    guess : (n,) array_like, optional
        Coordinates from which the search begins.
    stable : bool
        Whether to leave an unstable equilibrium for a stable one.
    side : {1, -1}
        Side to which it is left.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.simulation import equilibrium_under
    >>> finger = cg.Finger(rod=cg.Rod(length=0.2, linear_density=0.02, bending_stiffness=0.01))
    >>> model = cg.FingerModel(finger, family="arc", elements=1, tip_force=False)
    >>> equilibrium_under(model, [0.05], []).q.round(6).tolist()  # bend = moment L / EI [rad]
    [1.0]
    """
    if side not in (1, -1):
        raise InputError(f"side: expected 1 or -1, got {side!r}")
    search = Search(model, np.asarray(u, dtype=float), np.asarray(w, dtype=float), np.array(model.p_nominal))
    start = search.rest() if guess is None else real_array("guess", guess)
    if start.shape != (model.n,) or not np.all(np.isfinite(start)):
        raise InputError(f"guess: expected {model.n} finite entries, got {start.tolist()}")
    return search.find(start, stable, side)


def equilibrium_path(scene: Scene, factors: Sequence[float], *, side: int = 1) -> list[Equilibrium]:
    """Equilibria while gravity, input and loads grow together.

    Each starts from the one before; where the straight path loses its stability, the buckled one is followed.

    Parameters
    ----------
    scene : Scene
        The scene whose loads at time zero are scaled.
    factors : sequence of float
        Scales, in order.
    side : {1, -1}
        Side to which an unstable equilibrium is left.

    Returns
    -------
    list of Equilibrium

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.simulation import equilibrium_path
    >>> scene = cg.load("configs/simulate/hanging.yaml")
    >>> [found.stable for found in equilibrium_path(scene, [0.5, 1.0])]
    [True, True]
    """
    names = tuple(dict.fromkeys((*scene.parameters, "gravity")))
    model = FingerModel(scene, parameters=names, input_rates=False)
    signals = Signals(scene, model)
    u, w, p = signals.u(0.0)[0], signals.w(0.0)[0], np.array(model.p_nominal)
    gravity = [k for k, label in enumerate(model.p_names) if label.startswith("gravity_")]
    path: list[Equilibrium] = []
    for factor in factors:
        scaled = p.copy()
        scaled[gravity] *= factor
        search = Search(model, factor * u, factor * w, scaled)
        path.append(search.find(path[-1].q if path else search.rest(), True, side))
    return path
