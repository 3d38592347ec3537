"""Motion, equilibrium and modes as a user calls them: a tolerance becomes a model first, a path a scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from os import PathLike

from numpy.typing import ArrayLike

from continuum_grasp.base import check_arguments
from continuum_grasp.model import FingerModel
from continuum_grasp.results import MotionResult
from continuum_grasp.scene import Load, Scene, scene_of
from continuum_grasp.simulation.static_shape import Equilibrium
from continuum_grasp.simulation.statics import equilibrium_of
from continuum_grasp.simulation.trajectory import Trajectory
from continuum_grasp.simulation.vibration import Modes, modes_of


@check_arguments
def simulate(
    scene: Scene | MotionResult | str | PathLike[str], *, progress: Callable[[float], None] | None = None
) -> Trajectory:
    """Simulate the motion of a finger, and of the object that it touches.

    Parameters
    ----------
    scene : Scene, MotionResult or path-like
        The scene, with ``time``, or its YAML file; or a result, whose motion is repeated by the inputs of a plan, or
        the commands of a closed loop on the finger that its controller knows, or of a mission on its plant, on which
        all fingers but the first move as recorded (``simulated`` of the result).
        With ``fidelity.tolerance`` the cheapest model that satisfies it is found first; where the motion needs more
        elements than its equilibria and frequencies, it gets them.
    progress : callable, optional
        Called with the completed share of the motion, 0 to 1.

    Returns
    -------
    Trajectory
        T instants ``t`` (T,) [s], states ``x`` (T, nx), inputs ``u`` (T, nu), forces ``w`` (T, nw), tip positions
        ``tip`` (T, 2) [m] and energies ``kinetic`` and ``potential`` (T,) [J]; SI units, world frame. ``x_names``,
        ``u_names`` and ``w_names`` have the unit of each entry, ``time_error`` estimates the error of the steps in
        time, ``space_error`` the error of the elements (``time.space_error``, ``fidelity.tolerance``),
        ``static_error`` their error at rest under the first and the last inputs otherwise, ``warnings`` names elements
        beyond their bending range or strain limit, and overlaps with the object between stations.

    Raises
    ------
    InputError
        If the scene has no time, or a state that does not fit, or if no scene repeats the result.
    NumericalError
        If the motion does not stay finite, or is too stiff for the requested method; ``result`` is the trajectory
        until then.
    SolverError
        If an initial equilibrium is not found.
    Interrupted
        On Ctrl-C; ``result`` is the trajectory until then.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> motion = cg.simulate(cg.load("configs/simulate/hanging.yaml", ["time.duration=0.05"]))
    >>> motion.t.shape, motion.tip.shape, motion.x_names[0]
    ((51,), (51, 2), 'kappa_0 [1/m]')
    """
    from continuum_grasp.simulation.accuracy.space import motion_within

    asked = scene_of(scene)
    chosen, note = _resolved(asked)
    trajectory = motion_within(chosen, asked.fidelity.tolerance, progress=progress)
    return replace(trajectory, statistics={**trajectory.statistics, "fidelity": note}) if note else trajectory


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
    converges) leads from the guess to an equilibrium. If that one is unstable, as the straight finger is under more
    than its buckling load, the search leaves it along its weakest direction and finds the stable one beside it.

    Parameters
    ----------
    scene : Scene or path-like
        The scene, or its YAML file. With ``fidelity.tolerance`` the cheapest model that satisfies it is found first.
    extra_loads : sequence of ForceLoad or MomentLoad
        Constant loads besides the scene's.
    guess : (n,) array_like, optional
        Bending coordinates to start from, angles [rad] or nodal curvatures [1/m]; by default the unloaded shape.
    stable : bool
        Whether to leave an unstable equilibrium. Where there is no stable one beside it (flutter under a following
        load), the result has ``stable=False``.
    side : {1, -1}
        Side to which an unstable equilibrium is left: the sign of the largest component of its weakest direction.
    model : FingerModel, optional
        Model to use, which must have the scene's loads.

    Returns
    -------
    Equilibrium
        Bending coordinates ``q`` (n,), ``tip`` (2,) [m] in the world, ``stable``, ``margin`` [rad2/s2], ``residual``,
        and ``space_error`` [1], the estimated error by the elements, per length.

    Raises
    ------
    InputError
        If guess, side or model do not fit, or if the scene has an object.
    SolverError
        If no equilibrium is reached, or only one that is bent far beyond the declared range.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> found = cg.equilibrium("configs/simulate/hanging.yaml")
    >>> found.stable, found.tip.shape, found.backbone(points=20).shape
    (True, (2,), (20, 2))
    """
    chosen = scene_of(scene) if model is not None else _resolved(scene)[0]
    return equilibrium_of(chosen, extra_loads=extra_loads, guess=guess, stable=stable, side=side, model=model)


@check_arguments
def modes(scene: Scene | str | PathLike[str], *, about: Equilibrium | None = None, points: int = 61) -> Modes:
    """Find the natural frequencies and mode shapes of a finger about its equilibrium.

    Parameters
    ----------
    scene : Scene or path-like
        The scene, or its YAML file. With ``fidelity.tolerance`` the cheapest model that satisfies it is found first.
    about : Equilibrium, optional
        Equilibrium to linearize about; by default it is found first.
    points : int
        Number of points of the shapes.

    Returns
    -------
    Modes
        ``frequencies_hz`` (m,) [Hz], ``damping_ratios`` (m,) [1], ``shapes`` (m, points, 2) [1] and the equilibrium's
        ``backbone`` (points, 2) [m]; ``space_error`` (m,) estimates the error of the frequencies by the
        elements, relative [1]; as many as there are bending coordinates. Under following loads or tendon friction
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
    chosen = scene_of(scene) if about is not None else _resolved(scene, vibrates=True)[0]
    return modes_of(chosen, about=about, points=points)


def _resolved(given: Scene | str | PathLike[str], *, vibrates: bool = False) -> tuple[Scene, str]:
    """The scene with its tolerance turned into a model, and why that one; what measures models loads where needed."""
    scene = scene_of(given)
    if scene.fidelity.tolerance is None:
        return scene, ""
    from continuum_grasp.simulation.accuracy.choose import resolve_fidelity

    return resolve_fidelity(scene, vibrates=vibrates)
