"""Motion as a user calls it: a tolerance becomes a model first, a path a scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from os import PathLike

from continuum_grasp.base import check_arguments
from continuum_grasp.results import MotionResult
from continuum_grasp.scene import Scene, scene_of
from continuum_grasp.simulation.accuracy.resolve import resolve_fidelity
from continuum_grasp.simulation.accuracy.space import motion_within
from continuum_grasp.simulation.trajectory import Trajectory


@check_arguments
def simulate(
    scene: Scene | MotionResult | str | PathLike[str], *, progress: Callable[[float], None] | None = None
) -> Trajectory:
    """Simulate the motion of a finger, and of the object that it touches.

    Parameters
    ----------
    scene : Scene, MotionResult or path-like
        The scene, with ``time``, or its YAML file; or a result to repeat: the inputs of a plan, the commands of a
        closed loop on its controller's finger, or the commands of a mission on its plant, with all fingers except the
        first moving as recorded (``simulated`` of the result). Without ``fidelity.elements`` their number rises, up to
        16, until the error is below 1 % of the length at rest under the first, last and held loads, and of the first
        natural frequency there. With ``fidelity.tolerance`` the cheapest model that satisfies it comes first; a motion
        gets more elements if it needs more than its equilibria and frequencies.
    progress : callable, optional
        Called with the completed share of the motion, 0 to 1.

    Returns
    -------
    Trajectory
        T instants ``t`` (T,) [s], states ``x`` (T, nx), inputs ``u`` (T, nu), forces ``w`` (T, nw), tip positions
        ``tip`` (T, 2) [m] and energies ``kinetic`` and ``potential`` (T,) [J]; SI units, world frame. ``x_names``,
        ``u_names`` and ``w_names`` have the unit of each entry, ``time_error`` estimates the error of the steps in
        time, ``space_error`` the error of the elements (``time.space_error``, ``fidelity.tolerance``),
        otherwise ``static_error`` their error at rest under the first and last inputs. ``warnings`` names elements
        beyond their strain limit, too few elements, and overlaps with the object between stations. ``status`` is
        ``under_resolved`` if no number of elements suffices.

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
    asked = scene_of(scene)
    chosen, note = resolve_fidelity(asked)
    trajectory = motion_within(chosen, asked.fidelity.tolerance, progress=progress)
    return replace(trajectory, statistics={**trajectory.statistics, "fidelity": note}) if note else trajectory
