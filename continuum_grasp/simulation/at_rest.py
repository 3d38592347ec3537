"""Equilibrium and modes as a user calls them: a tolerance becomes a model first, a path a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from os import PathLike

from numpy.typing import ArrayLike

from continuum_grasp.base import Array, check_arguments
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Load, Scene, scene_of
from continuum_grasp.simulation.accuracy.resolve import resolve_fidelity
from continuum_grasp.simulation.accuracy.resting import Level, RestCase, level_of, resolved
from continuum_grasp.simulation.resolution import OF_MODES
from continuum_grasp.simulation.rest import RestingShape
from continuum_grasp.simulation.resting import rest_at
from continuum_grasp.simulation.static_shape import Equilibrium
from continuum_grasp.simulation.statics import model_of_statics
from continuum_grasp.simulation.vibration import Modes, modes_of


@check_arguments
def equilibrium(
    scene: Scene | str | PathLike[str],
    *,
    extra_loads: Sequence[Load] = (),
    guess: ArrayLike | None = None,
    stable: bool = True,
    side: int = 1,
    model: FingerModel | None = None,
) -> Equilibrium:
    """Find the equilibrium of a finger under its loads at time zero, also beyond buckling.

    Pseudo-transient continuation (damped motion in the metric of the mass matrix that turns into Newton's method as it
    converges) leads from the guess to an equilibrium. If this is unstable, like the straight finger above its
    buckling load, the search leaves it along its weakest direction and finds the stable equilibrium next to it.

    Parameters
    ----------
    scene : Scene or path-like
        The scene, or its YAML file. Without ``fidelity.elements`` their number rises, up to 16, until the error is
        below 1 % of the length. With ``fidelity.tolerance`` the cheapest model that satisfies it comes first.
    extra_loads : sequence of ForceLoad or MomentLoad
        Constant loads besides the scene's.
    guess : (n,) array_like, optional
        Bending coordinates to start from, angles [rad] or nodal curvatures [1/m] of the first number of elements; by
        default the unloaded shape.
    stable : bool
        Whether to leave an unstable equilibrium. If no stable one is near (flutter under a following load), the result
        has ``stable=False``.
    side : {1, -1}
        Direction in which the search leaves an unstable equilibrium: the sign of the largest component of its weakest
        direction.
    model : FingerModel, optional
        Model to use, which must have the scene's loads.

    Returns
    -------
    Equilibrium
        Bending coordinates ``q`` (n,), ``tip`` (2,) [m] in the world, ``stable``, ``margin`` [rad2/s2], ``residual``,
        and ``space_error`` [1], the error of the elements per length. ``status`` is ``under_resolved`` if no
        number of elements suffices; if stated elements do not, a warning names a number that does. A shape that is
        stable with these elements, but not with more or as an exact rod, is reported unstable.

    Raises
    ------
    InputError
        If guess, side or model do not fit, or if the scene has an object.
    SolverError
        If no equilibrium is reached, or only one that bends an element by more than 40 rad.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> found = cg.equilibrium("configs/simulate/hanging.yaml")
    >>> found.stable, found.tip.shape, found.backbone(points=20).shape
    (True, (2,), (20, 2))
    """
    asked = scene_of(scene)
    chosen = asked if model is not None else resolve_fidelity(asked)[0]
    return _resolved(chosen, asked.fidelity.tolerance, extra_loads, guess, stable, side, model)


def _resolved(
    scene: Scene,
    limit: float | None,
    extra_loads: Sequence[Load] = (),
    guess: ArrayLike | None = None,
    stable: bool = True,
    side: int = 1,
    model: FingerModel | None = None,
    *,
    frequencies: int = 0,
) -> Equilibrium:
    """Find the equilibrium with a number of elements that suffices, for the first natural frequencies too."""

    def search(scene: Scene, model: FingerModel, near: Array | None) -> RestingShape:
        return rest_at(scene, model, guess=guess if near is None else near, stable=stable, side=side)

    first = model_of_statics(scene, extra_loads, model)
    case = RestCase(scene, search, first.loads[len(scene.loads) :])
    stated = model is not None or scene.fidelity.elements is not None
    level, resolution = resolved(Level(scene, first, [case]), limit=limit, stated=stated, frequencies=frequencies)
    rest = next(each for each in level.rests if each is not None)
    return Equilibrium.of(rest, level.scene, resolution)


@check_arguments
def modes(scene: Scene | str | PathLike[str], *, about: Equilibrium | None = None, points: int = 61) -> Modes:
    """Find the natural frequencies and mode shapes of a finger about its equilibrium.

    Parameters
    ----------
    scene : Scene or path-like
        The scene, or its YAML file. Without ``fidelity.elements`` their number rises, up to 16, until the error is
        below 1 % of the length and of the first two frequencies. With ``fidelity.tolerance`` the cheapest model that
        satisfies it comes first.
    about : Equilibrium, optional
        Equilibrium to linearize about; by default it is found first.
    points : int
        Number of points of the shapes.

    Returns
    -------
    Modes
        ``frequencies_hz`` (m,) [Hz], ``damping_ratios`` (m,) [1], ``shapes`` (m, points, 2) [1] and the equilibrium's
        ``backbone`` (points, 2) [m]; ``space_error`` (m,) is the error of the frequencies that the elements
        leave, relative [1]; as many as there are bending coordinates. Under following loads or tendon friction
        the stiffness is not symmetric; modes that flutter then come as two of one frequency, and ``stable`` is false.

    Raises
    ------
    InputError
        If the scene has an object.
    SolverError
        If no equilibrium is found.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> found = cg.modes("configs/simulate/hanging.yaml")
    >>> found.shapes.shape == (len(found.frequencies_hz), 61, 2)
    True
    """
    asked = scene_of(scene)
    note = ""
    if about is None:
        chosen, note = resolve_fidelity(asked, vibrates=True)
        about = _resolved(chosen, asked.fidelity.tolerance, frequencies=OF_MODES)
    elif about.scene is not None:
        level = level_of(about, about.scene)
        _, resolution = resolved(level, limit=asked.fidelity.tolerance, stated=True, frequencies=OF_MODES)
        about = about.judged(resolution)
    found = modes_of(about.scene or asked, about=about, points=points)
    note = note or about.statistics.get("fidelity", "")
    return replace(found, statistics={"fidelity": note}) if note else found
