"""A nonlinear model predictive controller with its estimator: one C function per period."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from os import PathLike
from time import perf_counter_ns
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.arguments import check_arguments, positive, shown
from continuum_grasp.control.arguments import numbers, vector
from continuum_grasp.control.command import Command, Layout
from continuum_grasp.control.compiled import Compiled, controller_source
from continuum_grasp.control.estimation.contact_detector import contact_parts
from continuum_grasp.control.estimation.contact_model import contact_model_of
from continuum_grasp.control.estimation.model import estimation_of
from continuum_grasp.control.field import Field
from continuum_grasp.control.ocp.cost_terms import Outputs
from continuum_grasp.control.ocp.setpoints import Function, Setpoints, setpoints
from continuum_grasp.control.ocp.stages import stages_of
from continuum_grasp.control.prediction import Prediction, first_state, rest_input
from continuum_grasp.control.settings import controller_fields, delay_periods
from continuum_grasp.control.status import Statistics, Status
from continuum_grasp.core.precision import precision_of
from continuum_grasp.errors import InputError
from continuum_grasp.model.remade import Remade
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.load import scene_of
from continuum_grasp.summary import Summarized, quoted

Array = NDArray[np.float64]

_STATUS = tuple(Status)
_CHANGEABLE = ("weights", "terminal_weights", "u_min", "u_max", "c_min", "c_max", "linear", "quadratic")
_CHUNK = 128
"""Periods for which setpoints are evaluated at once [1]: enough that numpy's overhead per call does not show, and
little to hold (30 stages of 6 setpoints: 190 kB)."""
_LATE, _APPLIED = 1, 2
"""Flags of ``cg_controller_step``."""
_NUMBERS = (
    *("anomalies", "iterations", "violation", "residual", "cost"),
    *("health", "sensor", "entry", "reason", "rung", "mismatch", "activity"),
)
"""Scalars of ``cg_controller_step`` in ``c/controller_python.c``, in its order."""


class Controller(Remade, Summarized):
    """Nonlinear model predictive control by real-time iterations, with an estimator, a supervisor and a fallback.

    All of ``step`` runs in one C function that is compiled for the scene, without allocation.

    Parameters
    ----------
    scene : ControlScene or path-like
        The scene, or its YAML file.
    precision : {"double", "float"}
        Floating-point type of the C.
    deadline : float, optional
        Duration of ``step`` after which its command counts as late [s], so that the next one is of the previous plan;
        by default that of the scene, else its period. ``math.inf``: never.

    Attributes
    ----------
    scene, prediction, stages
        The scene, its model (``Prediction``) and its problem (``Stages``).
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
    Where an argument of ``step`` cannot be used, an iteration fails, or the last command was late, the controller
    follows the previous plan to its end (N stages). After that, and where nothing was measured for as long, the command
    ramps to the least tensions (the moment to zero): the whole range in half a second, or slower by ``input.rate_max``.
    A command is always finite and within the scene's limits of the input and of its rate. Narrower limits that
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
    ) -> None:
        self.scene = scene_of(scene, ControlScene)
        # No path for a copy, since its file may change.
        self._arguments = (self.scene,), {"precision": precision, "deadline": deadline}
        self.prediction = Prediction(self.scene)
        self.stages = stages_of(self.scene, self.prediction)
        self.precision = precision_of(precision)
        estimation = None
        if self.scene.estimator is not None:
            estimation = estimation_of(self.scene, self.prediction, self.stages.method)
        self.period = self.scene.controller.step
        if self.period > self.stages.stage * (1.0 + 1e-9):
            raise InputError(
                f"{self.period:g} s is longer than a stage of {self.stages.stage:g} s, over which the plan holds an "
                "input: expected a period of at most a stage",
                key="controller.period",
            )
        self.measurement_names = self.prediction.x_names if estimation is None else estimation.measurement_names
        self.sensor_names = () if estimation is None else estimation.sensor_names
        self.estimated_names = self.prediction.x_names if estimation is None else estimation.z_names
        wanted = self.scene.controller.deadline or self.period if deadline is None else deadline
        # With an infinite deadline no command is late.
        self._deadline_ns = 1e9 * (wanted if wanted == math.inf else positive("deadline", wanted))
        asked = self.scene.estimator
        contact = contact_model_of(self.scene) if asked is not None and asked.contact_detection is not None else None
        fields = controller_fields(self.scene, self.prediction, self.stages, estimation, self.precision, contact)
        self._fields = {field.member: field for field in fields}
        periods = delay_periods(self.scene)
        source = controller_source(self.stages, estimation, periods, fields, self.precision, contact)
        s, n = self.stages, self.stages.stages
        nz, ny = (0, 0) if estimation is None else (estimation.nz, estimation.ny)
        nm = len(self.measurement_names)
        given = {"measurement": nm, "p": s.np, "applied": s.nu, "setpoints": (n + 1) * s.nr, "elapsed": 1}
        parts = dict.fromkeys(_NUMBERS, 1) | {"ticks": 3, "u": s.nu, "x": s.nx, "p": s.np, "verdict": nm}
        parts |= {"variance": nz, "innovation": ny, "innovation_variance": ny}
        parts |= {} if contact is None else contact_parts(contact)
        parts |= {"plan_x": (n + 1) * s.nx, "plan_u": n * s.nu}
        self._c = Compiled(source, fields, given, parts, "the controller")
        places = () if contact is None else contact.finger.places
        self._layout = Layout(self._c.parts, s.nx, s.nu, s.nd, self.measurement_names, self.sensor_names, places)
        self._measurement, self._p, self._applied, rows, self._elapsed = self._c.given
        self._setpoints = rows.reshape(n + 1, s.nr)
        self._call = self._c.library.cg_controller_step
        self.first = first_state(self.scene, self.prediction)
        self._nz = max(nz, s.nd)
        self.reset()

    def headline(self) -> str:
        """Its scene and periods."""
        return quoted(self.scene.name, f"{1e3 * self.period:g} ms, {self.stages.stages} stages")

    def pairs(self) -> dict[str, str]:
        """What it measures, follows and commands, and how its steps ended."""
        counts = ", ".join(f"{count} {name}" for name, count in self.statistics["status"].items() if count)
        return {
            "measures": ", ".join(self.measurement_names),
            "setpoints": ", ".join(self.stages.r_names),
            "commands": ", ".join(self.stages.u_names),
            "steps": counts or "none",
        }

    def reset(self, state: ArrayLike | None = None, u: ArrayLike | None = None) -> None:
        """Start again, at time zero of the scene's reference.

        Parameters
        ----------
        state : (nx,) array_like, optional
            State of the prediction from which the estimator starts; the scene's initial pose where not given.
        u : (nu,) array_like, optional
            Input that was applied before; least tensions or no moment where not given.

        Raises
        ------
        InputError
            If something has another size or is not finite.
        """
        z = np.zeros(self._nz)
        z[: self.prediction.nx] = vector("state", self.first if state is None else state, self.prediction.nx)
        before = vector("u", rest_input(self.scene) if u is None else u, self.stages.nu)
        self._c.start(z, before, self.stages.p_nominal)
        self._step, self._late, self._time = 0, False, math.nan
        self._counts = Statistics()

    def step(
        self,
        measurement: ArrayLike | None,
        reference: ArrayLike | None = None,
        *,
        p: ArrayLike | None = None,
        applied: ArrayLike | None = None,
        late: bool | None = None,
        time: float | None = None,
    ) -> Command:
        """Compute the command for a measurement; call it once per period.

        Parameters
        ----------
        measurement : (ny,) array_like or None
            Measurement in the order of ``measurement_names``, NaN where a sensor has none; None: no sensor has one.
        reference : (nr,) or (N + 1, nr) array_like, optional
            Setpoints in the order of ``stages.r_names``, constant or one row per node from now on; by default those of
            the scene at the number of steps times the period.
        p : (np,) array_like, optional
            Parameters; nominal by default.
        applied : (nu,) array_like, optional
            Input that was applied since the last step; the last command by default.
        late : bool, optional
            Whether the last command was late, so that this one is of the previous plan; by the deadline by default.
        time : float, optional
            When the measurement arrived, on a monotonic clock [s]; the supervisor detects a wrong call rate by it.

        Returns
        -------
        Command

        Raises
        ------
        InputError
            If an argument has the wrong shape. Non-finite and implausible numbers do not raise: they are anomalies of
            the command.
        """
        began = perf_counter_ns()
        try:
            # Straight into the memory that the C reads: next to a call of some 50 us (docs/mpc.md), allocations show.
            _put(self._measurement, np.nan if measurement is None else measurement, measurement is None)
            _put(self._p, self.stages.p_nominal if p is None else p)
            rows = self._scheduled() if reference is None else reference
            _put(self._setpoints, rows, np.ndim(rows) == 1 and np.size(rows) == self.stages.nr)
            flags = _LATE if (self._late if late is None else late) else 0
            if applied is not None:
                _put(self._applied, applied)
                flags |= _APPLIED
            now = math.nan if time is None else float(numbers(time))
            # Below 0 the C takes the time since the last call as unknown: at the first, and where a clock went back.
            self._elapsed[0] = now - self._time if now > self._time else -1.0
            self._time = now if math.isfinite(now) else math.nan
        except (ValueError, TypeError) as error:
            raise self._shape_error(
                measurement=measurement, reference=reference, p=p, applied=applied, time=time
            ) from error
        c = self._c
        status = self._call(c.address, c.input_address, flags, c.output_address)
        if status < 0:
            raise InputError("the settings of the controller are not valid")
        self._step += 1
        out = c.output.copy()
        command = Command(self._layout, _STATUS[status], out)
        elapsed = perf_counter_ns() - began
        self._late = elapsed > self._deadline_ns
        parts = self._layout.parts
        self._counts.add(
            status, out[parts["anomalies"].start], out[parts["ticks"]], elapsed, self._late, command.health
        )
        return command

    def rearm(self) -> bool:
        """Leave a trip.

        Returns
        -------
        bool
            Whether it was left: only where the command rests, sensors and model agree again, and the trip is not the
            second one within 30 s (which only ``reset`` ends). The weight of the command's rate starts 16-fold.
        """
        return bool(self._c.library.cg_rearm(self._c.address))

    def change(self, **settings: ArrayLike) -> None:
        """Change weights, bounds or penalty weights from the next step on; all of the arguments, or none.

        Parameters
        ----------
        **settings : array_like
            Named and sized as in ``stages``: ``weights``, ``terminal_weights`` (nr);
            ``u_min``, ``u_max`` (nu), within those of the scene; ``c_min``, ``c_max``, ``linear``, ``quadratic`` (nc).

        Raises
        ------
        InputError
            If a name is unknown; a value has another size, is not finite, or is out of range; a lower limit would be
            above its upper one; or neither inputs nor their rates would have a weight, so that inputs are not unique.

        Notes
        -----
        A limit that is moved past the last command is approached at ``controller.input.rate_max``: until a command is
        within it, steps report ``Anomaly.BEYOND_LIMIT``.
        """
        fields = dict(self._fields)
        for name, given in settings.items():
            if name not in _CHANGEABLE:
                raise InputError(f"expected some of {', '.join(_CHANGEABLE)}, got {name!r:.60}", key=name)
            nominal = getattr(self.stages, name)
            value = vector(name, given, nominal.size)
            if name[:2] not in ("u_", "c_") and np.any(value < 0.0):
                raise InputError(f"expected no negative entry, got {value.tolist()}", key=name)
            # The safe ramp and the supervisor's scales are those of the scene's limits.
            if name.startswith("u_") and (np.any(value < self.stages.u_min) or np.any(value > self.stages.u_max)):
                raise InputError("expected entries within the limits of the scene", key=name)
            fields[f"rti.{name}"] = Field(f"rti.{name}", value)
        self._check_settings(fields, tuple(settings))
        self._fields = fields
        self._c.configure(tuple(fields.values()))

    def _check_settings(self, fields: Mapping[str, Field], given: tuple[str, ...]) -> None:
        """Refuse crossed limits and a QP without a unique solution."""
        for kind, names in (("u", self.stages.u_names), ("c", self.stages.c_names)):
            low, high = (np.asarray(fields[f"rti.{kind}_{end}"].values) for end in ("min", "max"))
            crossed = [f"{n}: {a:g} > {b:g}" for n, a, b in zip(names, low, high, strict=True) if a > b]
            if crossed:
                key = next(name for name in given if name.startswith(f"{kind}_"))
                raise InputError(f"a lower limit is above its upper one ({'; '.join(crossed)})", key=key)
        of_inputs = slice(self.stages.nt, None)
        if not np.any(np.asarray(fields["rti.weights"].values)[of_inputs] > 0.0):
            asked = ", ".join(self.stages.r_names[of_inputs])
            raise InputError(f"one of {asked} needs a weight above 0, else inputs are not unique", key="weights")

    @property
    def statistics(self) -> dict[str, Any]:
        """Counts of statuses, anomalies, fallbacks and late steps since the last reset; durations of phases [s]."""
        return self._counts.as_dict()

    def save_state(self) -> bytes:
        """Return all that the next command depends on."""
        return self._c.save(self._step, int(self._late))

    @check_arguments
    def restore(self, saved: bytes) -> None:
        """Continue from a saved state, which must be of the same problem, version and precision."""
        self._step, late = self._c.restore(saved)
        self._late, self._time = bool(late), math.nan

    def __getstate__(self) -> tuple[dict[str, Field], bytes]:
        return self._fields, self.save_state()

    def __setstate__(self, state: tuple[dict[str, Field], bytes]) -> None:
        self._fields, saved = state
        self._c.configure(tuple(self._fields.values()))
        self.restore(saved)

    # -- setpoints ---------------------------------------------------------------------------------------------------

    @check_arguments
    def setpoints(self, functions: Mapping[str, Function] | None = None) -> Setpoints:
        """Collect setpoints over time: those of the scene, or functions of time in their place.

        Parameters
        ----------
        functions : mapping of str to callable, optional
            By name of a member of ``reference`` (``tip``, ``input``, ...): functions of time [s], each returning all
            entries of its row.

        Returns
        -------
        Setpoints
            ``rows(times)`` are those at instants (K,) [s]: (K, nr), as ``step`` takes them.

        Raises
        ------
        InputError
            If no cost term tracks what a function is for.

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
        return setpoints(Outputs.of(self.scene.controller.cost, self.prediction), self.scene.reference, functions)

    @cached_property
    def _reference(self) -> Setpoints:
        return self.setpoints()

    def _scheduled(self) -> Array:
        chunk, at = divmod(self._step, _CHUNK)
        if getattr(self, "_chunk", None) != chunk:
            ahead = self.stages.stage * np.arange(self.stages.stages + 1)
            times = self.period * (chunk * _CHUNK + np.arange(_CHUNK))[:, None] + ahead
            self._rows: Array = self._reference.rows(times.ravel()).reshape(_CHUNK, len(ahead), self.stages.nr)
            self._chunk = chunk
        rows: Array = self._rows[at]
        return rows

    def _shape_error(self, **given: Any) -> InputError:
        """Name what has another shape than expected, or everything where the shapes fit but entries are no numbers."""
        s = self.stages
        shapes: dict[str, tuple[Any, ...]] = {
            "measurement": (self._measurement.shape,),
            "reference": ((s.nr,), self._setpoints.shape),
            "p": ((s.np,),),
            "applied": ((s.nu,),),
            "time": ((),),
        }
        present = {name: value for name, value in given.items() if value is not None}
        wrong = [name for name, value in present.items() if _shape(value) not in shapes[name]] or list(present)
        messages = []
        for name in wrong:
            value, shape, expected = present[name], _shape(present[name]), shapes[name]
            got = shown(value, 80) if shape in (None, (), *expected) else str(shape)
            messages.append(f"{name}: expected {' or '.join(map(str, expected))}, got {got}")
        return InputError("a step takes arrays of numbers; " + "; ".join(messages))


def _shape(value: Any) -> tuple[int, ...] | None:
    """Shape of an argument; None where it is ragged."""
    try:
        return tuple(np.shape(value))
    except ValueError:
        return None


def _put(to: Array, value: ArrayLike, spread: bool = False) -> None:
    """Copy an array of the same shape, or ``spread`` one of another over all entries."""
    array = value if type(value) is np.ndarray and value.dtype == float else numbers(value)
    if array.shape != to.shape and not spread:
        raise ValueError
    to[:] = array
