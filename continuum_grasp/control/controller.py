"""A nonlinear model predictive controller with its estimator: one C function per period."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from os import PathLike
from typing import Any

from numpy.typing import ArrayLike

from continuum_grasp.base import CheckedArgument, InputError, check_arguments
from continuum_grasp.control.command import Command
from continuum_grasp.control.compiled_controller import CompiledController
from continuum_grasp.control.ocp.cost_terms import Outputs
from continuum_grasp.control.ocp.setpoints import Function, Setpoints
from continuum_grasp.control.parts import ControlParts
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.scene import ControlScene, scene_of


class Controller(CompiledController):
    """Nonlinear model predictive control by real-time iterations, with an estimator, a supervisor and a fallback.

    ``step`` runs as one C function, compiled for the scene, without allocation.

    Parameters
    ----------
    scene : ControlScene or path-like
        The scene, or its YAML file.
    precision : {"double", "float"}
        Floating-point type of the C.
    deadline : float, optional
        Duration of ``step`` after which its command counts as late [s], so that the next one is of the previous plan;
        by default the scene's, else its period. ``math.inf``: never.
    steps : float
        Expected number of steps. With many, the compiler optimizes the code; otherwise it compiles quickly.

    Attributes
    ----------
    scene, prediction, stages
        The scene, its model (``Prediction``) and its problem (``Stages``).
    estimation : Estimation or None
        The functions of its filter; None without an estimator.
    period : float
        Time from one command to the next [s].
    first : (nx,) ndarray
        State of the scene's initial pose.
    measurement_names : tuple of str
        Name and unit of each entry of a measurement: tip, tensions (or tip moment), angles of sections; the model's
        state where the scene has no estimator.
    sensor_names : tuple of str
        Supervised devices: tip, tension, bending.
    estimated_names : tuple of str
        Name and unit of each entry of ``Estimate.std``: states, then disturbances.

    Raises
    ------
    InputError
        If the pieces of the scene do not fit together, or there is no C compiler.

    Notes
    -----
    Where an argument of ``step`` is unusable, an iteration fails, or the last command was late, the controller
    follows the previous plan to its end (N stages). After that, and where nothing was measured for as long, the command
    ramps to the least tensions (the moment to zero): the whole range in 6.5 natural times of the finger, 0.5 s of a
    hand's, or slower by ``input.rate_max``. A command is always finite and within the scene's limits of the input and
    of its rate. Narrower limits that
    ``change`` moves past the last command are approached at that rate.

    A supervisor checks whether sensors, model and call rate agree (``Command.health``). Where they do not and the
    command is active, it raises the weight of the command's rate; where that does not help, or a sensor contradicts the
    model by many standard deviations, it trips: the command ramps to the safe input until ``rearm``.

    A copy, or a controller sent to another process, continues with the same commands and new ``statistics``. Use one
    object in one thread at a time.

    Examples
    --------
    >>> import numpy as np
    >>> import continuum_grasp as cg
    >>> controller = cg.Controller("configs/mpc/steady_tip.yaml", deadline=np.inf)
    >>> controller.measurement_names
    ('tip_x [m]', 'tip_y [m]', 'tension_1 [N]', 'tension_2 [N]')
    >>> command = controller.step([0.0, 0.18, 1.0, 1.0])
    >>> command.status.name, command.u.shape
    ('SOLVED', (2,))
    """

    @check_arguments
    def __init__(
        self,
        scene: ControlScene | str | PathLike[str],
        *,
        precision: str = "double",
        deadline: float | None = None,
        steps: float = math.inf,
    ) -> None:
        self.scene = scene_of(scene, ControlScene)
        # No path for a copy, since its file may change.
        self._arguments = (self.scene,), {"precision": precision, "deadline": deadline, "steps": steps}
        self.prediction = Prediction(self.scene)
        self.setpoints()  # refuses wrong ones before anything is compiled
        parts = ControlParts.of_scene(self.scene, self.prediction)
        wanted = self.scene.controller.deadline or self.scene.controller.step if deadline is None else deadline
        self._compile(parts, precision, wanted, steps)
        self.estimation, self.sensor_names, self.estimated_names = (
            parts.estimation,
            parts.sensor_names,
            parts.estimated_names,
        )
        self.cost_terms = self._outputs.slices
        self.first = self.prediction.first_state()
        self.reset()

    def headline(self) -> str:
        """Scene and periods of the controller."""
        return self.quoted(self.scene.name, f"{1e3 * self.period:g} ms, {self.stages.stages} stages")

    def pairs(self) -> dict[str, str]:
        """Measured, followed and commanded quantities, loads that the loop bears, and how steps ended."""
        counts = ", ".join(f"{count} {name}" for name, count in self.statistics["status"].items() if count)
        return {
            "measures": ", ".join(self.measurement_names),
            "setpoints": ", ".join(self.stages.r_names),
            "commands": ", ".join(self.stages.u_names),
            **({"load limit": self.scene.borne_loads} if self.scene.estimator else {}),
            "steps": counts or "none",
        }

    def reset(self, state: ArrayLike | None = None, u: ArrayLike | None = None) -> None:
        """Start again, at time zero of the scene's reference.

        Parameters
        ----------
        state : (nx,) array_like, optional
            Start state of the estimator; by default the scene's initial pose.
        u : (nu,) array_like, optional
            Input that was applied before; by default least tensions or no moment. It may exceed the limits of commands
            up to the limits of the drives.

        Raises
        ------
        InputError
            If something has another size or is not finite, or u is beyond the limits of the drives.
        """
        x = CheckedArgument("state", self.first if state is None else state).vector(self.prediction.nx)
        before = CheckedArgument("u", self.scene.rest_input if u is None else u).vector(self.stages.nu)
        least, most = self.parts.ranges.applied.T
        for name, value, low, high in zip(self.stages.u_names, before, least, most, strict=True):
            if not low <= value <= high:
                raise InputError(f"{name}: {value:g} is outside the drive's range, {low:g} to {high:g}", key="u")
        self._start(x, before)

    def step(
        self,
        measurement: ArrayLike | Mapping[str, float] | None,
        reference: ArrayLike | Mapping[str, Any] | None = None,
        *,
        p: ArrayLike | Mapping[str, float] | None = None,
        applied: ArrayLike | Mapping[str, float] | None = None,
        late: bool | None = None,
        time: float | None = None,
        age: float | None = None,
    ) -> Command:
        """Compute the command for a measurement; call it once per period.

        Parameters
        ----------
        measurement : (ny,) array_like, mapping of str to float, or None
            Measurement in the order of ``measurement_names``, NaN or masked where a sensor has none; or by name
            (without unit), where an omitted quantity is not measured; None: no sensor has one.
        reference : (nr,) or (N + 1, nr) array_like, or mapping, optional
            Setpoints in the order of ``stages.r_names``, constant or one row per node from now on; or by name for this
            step alone, as ``reference`` takes them; by default the setpoints of ``reference`` and of the scene at the
            number of steps, missed ones included, times the period.
        p : (np,) array_like or mapping of str to float, optional
            Parameters; nominal by default, and where a name is left out.
        applied : (nu,) array_like or mapping of str to float, optional
            Input that was applied since the last step; the last command by default.
        late : bool, optional
            Whether the last command was late, so that this one is of the previous plan; by the deadline by default.
        time : float, optional
            Time at which the measurement arrived, on a monotonic clock [s]. Where calls were missed, estimate, plan and
            setpoints go on over the time that passed, with the input that acted; the supervisor detects a wrong call
            rate.
        age : float, optional
            Age of the measurement when it arrived [s]; ``estimator.delay`` by default. A measurement that is no younger
            than the one before is not used. Without an estimator it is without effect.

        Returns
        -------
        Command

        Raises
        ------
        InputError
            If an argument has the wrong shape. Non-finite and implausible numbers, and setpoints out of reach, do not
            raise: they are anomalies of the command.
        """
        return self._advance(measurement, reference, p, applied, late, time, age)

    def rearm(self) -> bool:
        """Leave a trip.

        Returns
        -------
        bool
            Whether it was left: only where the command rests, sensors and model agree again, and the trip is not the
            second one within 30 s (which only ``reset`` ends). The weight of the command's rate starts 64-fold.
        """
        return bool(self._c.library.cg_rearm(self._c.address))

    @check_arguments
    def setpoints(self, functions: Mapping[str, Function] | None = None) -> Setpoints:
        """Collect setpoints over time: the scene's, or functions of time instead of them.

        Parameters
        ----------
        functions : mapping of str to callable, optional
            By name of a member of ``reference`` (``tip``, ``input``, ...): functions of time [s], each returning all
            entries of its row.

        Returns
        -------
        Setpoints
            ``rows(times)`` are the setpoints at instants (K,) [s]: (K, nr), as ``step`` takes them.

        Raises
        ------
        InputError
            If no cost term tracks the quantity of a function.

        Examples
        --------
        >>> import numpy as np
        >>> import continuum_grasp as cg
        >>> controller = cg.Controller("configs/mpc/steady_tip.yaml", deadline=np.inf)
        >>> rising = controller.setpoints({"tip": lambda t: (-0.05, 0.15 + 0.01 * t)})
        >>> ahead = controller.stages.stage * np.arange(controller.stages.stages + 1)  # s
        >>> command = controller.step([0.0, 0.18, 1.0, 1.0], rising.rows(ahead))
        >>> rising.rows([0.0, 1.0])[:, :2].round(3).tolist()
        [[-0.05, 0.15], [-0.05, 0.16]]
        """
        return Setpoints.of(self._outputs, self.scene.reference, functions)

    @cached_property
    def _outputs(self) -> Outputs:
        return Outputs.of(self.scene.controller.cost, self.prediction)

    @cached_property
    def nominal_setpoints(self) -> Setpoints:  # type: ignore[override]
        """Setpoints of the scene."""
        return self.setpoints()
