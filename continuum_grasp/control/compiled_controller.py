"""Base of controllers of scenes and solvers of problems: the C of ``control/c``, called once per period."""

from __future__ import annotations

import math
import pickle
from collections.abc import Mapping
from enum import IntEnum
from time import perf_counter_ns
from types import MappingProxyType
from typing import Any, Self, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, CheckedArgument, InputError, Summarized, check_arguments
from continuum_grasp.control.arguments import named
from continuum_grasp.control.command import Command
from continuum_grasp.control.compiled import Compiled, controller_source
from continuum_grasp.control.members import CHANGEABLE, REPORTED
from continuum_grasp.control.ocp.setpoints import Setpoints
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.control.parts import ControlParts, Settings
from continuum_grasp.control.status import Anomaly, CommandStatus, Statistics
from continuum_grasp.core import CodeKind, CReal
from continuum_grasp.model import Remade

_STATUS = tuple(CommandStatus)
_CHUNK = 128
"""Periods for which setpoints are evaluated at once [1]: enough that numpy's overhead per call does not show, and
little to hold (30 stages of 6 setpoints: 190 kB)."""


class _StepFlag(IntEnum):
    """Flags of ``cg_controller_step``."""

    LATE = 1
    APPLIED = 2


class CompiledController(Remade, Summarized):
    """A controller in C: one call per period, setpoints and settings that change between calls, a state to save.

    Subclasses compile by ``_compile``, and have ``nominal_setpoints``, those where ``reference`` sets none, and
    ``cost_terms``, the slice of the weights of each term of the cost by its name.
    """

    parts: ControlParts
    stages: Stages
    period: float
    precision: str
    nominal_setpoints: Setpoints
    cost_terms: Mapping[str, slice]
    measurement_names: tuple[str, ...]
    _what = "the controller"
    _called: Mapping[str, str] = MappingProxyType({})
    """Arguments of a step by another name."""

    def _compile(self, parts: ControlParts, precision: str, deadline: float, steps: float = math.inf) -> None:
        """Compile from parts for a number of steps; commands are late after ``deadline`` [s]."""
        s = parts.stages
        n = parts.stages.stages
        estimation = parts.estimation
        self.parts = parts
        self.stages = s
        self.period = parts.calls.period
        self.precision = CReal.named(precision).name
        self.measurement_names = parts.measurement_names
        # With an infinite deadline no command is late.
        self._deadline_ns = 1e9 * (deadline if deadline == math.inf else CheckedArgument("deadline", deadline).number())
        self._settings = parts.settings_in(self.precision)
        nz, ny = (0, 0) if estimation is None else (estimation.nz, estimation.ny)
        nm = len(self.measurement_names)
        inputs = {"measurement": nm, "p": s.np, "applied": s.nu, "setpoints": (n + 1) * s.nr}
        inputs |= {"elapsed": 1, "age": 1}
        sizes = {number.name: 1 for number in REPORTED} | {"ticks": 3, "u": s.nu, "x": s.nx, "p": s.np, "verdict": nm}
        sizes |= {"excess": s.nc, "then": nz, "upper": nz * nz, "diagonal": nz}
        sizes |= {"innovation": ny, "innovation_variance": ny}
        sizes |= {"plan_x": (n + 1) * s.nx, "plan_u": n * s.nu}
        source = controller_source(parts, self.precision)
        self._c = Compiled(source, self._settings, inputs, sizes, self._what, steps * (n + 1))
        self._measurement, self._p, self._applied, rows, self._elapsed, self._age = self._c.given
        self._setpoints = rows.reshape(n + 1, s.nr)
        self._call = self._c.library.cg_controller_step
        self._nz = max(nz, s.nd)
        self._own: dict[str, tuple[Any, float]] = {}
        self._targets: Setpoints | None = None
        # Names of what a step may take by name, and values of entries that are not given: none for a state.
        unknown = None if estimation is None else np.full(nm, np.nan)
        self._by_name: dict[str, tuple[tuple[str, ...], Array | None]] = {
            "measurement": (self.measurement_names, unknown),
            "p": (s.p_names, s.p_nominal),
            "applied": (s.u_names, None),
        }

    def _start(self, x: Array, u: Array) -> None:
        """Start again from a state (nd) of the model, with an input (nu) before."""
        z = np.zeros(self._nz)
        z[: x.size] = x
        self._c.give("cg_start", z, u, self.stages.p_nominal)
        self._step = 0
        self._late = False
        self._time = math.nan
        self._believed = True
        self._own = {key: (value, 0.0) for key, (value, _) in self._own.items()}
        self._targets = None
        self._counts = Statistics()

    def _advance(
        self,
        measurement: ArrayLike | Mapping[str, float] | None,
        reference: ArrayLike | Mapping[str, Any] | None,
        p: ArrayLike | Mapping[str, float] | None,
        applied: ArrayLike | Mapping[str, float] | None,
        late: bool | None,
        time: float | None,
        age: float | None = None,
    ) -> Command:
        """Compute the next command; see ``Controller.step``."""
        began = perf_counter_ns()
        try:
            # Straight into the memory that the C reads: next to a call of some 50 us (docs/mpc.md), allocations show.
            if measurement is None:
                self._measurement[:] = np.nan
            else:
                self._put("measurement", self._measurement, measurement)
            self._put("p", self._p, self.stages.p_nominal if p is None else p)
            self._follow_clock(time)
            self._age[0] = -1.0 if age is None else CheckedArgument(None, age).doubles().item()
            if reference is None:
                rows: Any = self._scheduled()
            elif isinstance(reference, Mapping):
                # In this step alone.
                asked = self._following().replaced(reference, self._now, self.stages.stage, check=False)
                rows = asked.rows(self._now + self._ahead, check=False)
            else:
                rows = reference
            _copy(self._setpoints, rows, np.ndim(rows) == 1 and np.size(rows) == self.stages.nr)
            is_late = self._late if late is None else CheckedArgument(None, late).doubles().item()
            flags: int = _StepFlag.LATE if is_late else 0
            if applied is not None:
                self._put("applied", self._applied, applied)
                flags |= _StepFlag.APPLIED
        except InputError:
            raise
        except (ValueError, TypeError) as error:
            raise self._shape_error(
                measurement=measurement, reference=reference, p=p, applied=applied, late=late, time=time, age=age
            ) from error
        c = self._c
        status = self._call(c.address, c.input_address, flags, c.output_address)
        if status < 0:
            raise InputError(f"the settings of {self._what} are not valid")
        self._step += 1
        out = c.output.copy()
        command = Command(self.parts, c.parts, _STATUS[status], out)
        self._believed = not int(out[c.parts["anomalies"].start]) & Anomaly.CLOCK
        elapsed = perf_counter_ns() - began
        self._late = elapsed > self._deadline_ns
        self._counts.add(
            status, out[c.parts["anomalies"].start], out[c.parts["ticks"]], elapsed, self._late, command.health
        )
        return command

    def _follow_clock(self, time: float | None) -> None:
        """Take the time since the last call by a clock [s], and the setpoints on over calls that were missed."""
        # To the C: below 0 unknown, as at the first call; 0: it did not advance, or is no time.
        self._elapsed[0] = -1.0
        if time is None:
            self._time = math.nan
            return
        now = CheckedArgument(None, time).doubles().item()
        if not math.isfinite(now):
            self._elapsed[0], self._time = 0.0, math.nan
            return
        if not math.isnan(self._time):
            self._elapsed[0] = max(now - self._time, 0.0)
            # With the bound of ``controller_passed`` in c/controller.c: half a period is jitter.
            if self._believed and self._elapsed[0] > 1.5 * self.period:
                self._step += round(self._elapsed[0] / self.period) - 1
        self._time = now

    def _put(self, key: str, to: Array, value: Any) -> None:
        """Copy an argument of a step, given by name or as an array."""
        if type(value) is not np.ndarray and isinstance(value, Mapping):
            to[:] = named(self._called.get(key, key), value, *self._by_name[key])
        else:
            _copy(to, value)

    def change(self, **settings: ArrayLike | Mapping[str, ArrayLike]) -> None:
        """Change weights, bounds or penalty weights from the next step on; all of the arguments, or none.

        Parameters
        ----------
        **settings : array_like, or mapping of str to float
            Named and sized as in ``stages``: ``weights``, ``terminal_weights`` (nr);
            ``u_min``, ``u_max`` (nu), within the nominal ones; ``c_min``, ``c_max``, ``linear``, ``quadratic`` (nc).
            By name of ``r_names``, ``u_names`` or ``c_names`` of ``stages`` (without unit), weights also by the name
            of a term of the cost; omitted entries stay.

        Raises
        ------
        InputError
            If a name is unknown; a value has another size, is not finite, or is out of range; a lower limit would be
            above its upper one; or neither inputs nor their rates would have a weight, so that inputs are not unique.

        Notes
        -----
        A limit that is moved past the last command is approached at ``controller.input.rate_max``: until a command is
        within it, steps report ``Anomaly.BEYOND_LIMIT``.

        Examples
        --------
        >>> import numpy as np
        >>> import continuum_grasp as cg
        >>> controller = cg.Controller("configs/mpc/steady_tip.yaml", deadline=np.inf)
        >>> controller.change(weights={"tip": 4e3, "effort": 0.1}, u_max={"tension_2": 30.0})
        """
        changed = dict(self._settings)
        of = {member.name: member.of for member in CHANGEABLE}
        for name, setting in settings.items():
            if name not in of:
                raise InputError(f"expected some of {', '.join(of)}, got {name!r:.60}", key=name)
            if isinstance(setting, Mapping):
                names = getattr(self.stages, f"{of[name]}_names")
                groups = self.cost_terms if of[name] == "r" else {}
                setting = named(name, setting, names, changed[f"rti.{name}"], groups)
            value = CheckedArgument(name, setting).vector(getattr(self.stages, name).size)
            if name[:2] not in ("u_", "c_") and np.any(value < 0.0):
                raise InputError(f"expected no negative entry, got {value.tolist()}", key=name)
            # The safe ramp and the supervisor's scales follow the nominal limits.
            if name.startswith("u_") and (np.any(value < self.stages.u_min) or np.any(value > self.stages.u_max)):
                raise InputError("expected entries within the limits of the scene", key=name)
            changed[f"rti.{name}"] = value
        self._check_settings(changed, tuple(settings))
        self._settings = changed
        self._c.configure(changed)

    def _check_settings(self, settings: Settings, changed: tuple[str, ...]) -> None:
        """Refuse crossed limits and a QP without a unique solution."""
        for kind, names in (("u", self.stages.u_names), ("c", self.stages.c_names)):
            low, high = (np.asarray(settings[f"rti.{kind}_{end}"]) for end in ("min", "max"))
            crossed = [f"{n}: {a:g} > {b:g}" for n, a, b in zip(names, low, high, strict=True) if a > b]
            if crossed:
                key = next(name for name in changed if name.startswith(f"{kind}_"))
                raise InputError(f"a lower limit is above its upper one ({'; '.join(crossed)})", key=key)
        of_inputs = slice(self.stages.nt, None)
        # A problem may leave inputs to the dynamics alone: then no weight can be taken away.
        if self.stages.nt < self.stages.nr and not np.any(np.asarray(settings["rti.weights"])[of_inputs] > 0.0):
            asked = ", ".join(self.stages.r_names[of_inputs])
            raise InputError(f"one of {asked} needs a weight above 0, else inputs are not unique", key="weights")

    @property
    def statistics(self) -> dict[str, Any]:
        """Counts of statuses, anomalies, fallbacks and late steps since the last reset; durations of phases [s]."""
        return self._counts.as_dict()

    @property
    def code(self) -> CodeKind:
        """Kind of its code: optimized, or compiled quickly for few steps."""
        return self._c.code

    def save_state(self) -> bytes:
        """Return all that the next command depends on, except settings by ``change`` and ``reference``."""
        return self._c.save(self._step, int(self._late))

    @check_arguments
    def restore(self, saved: bytes) -> None:
        """Continue from a saved state, which must be of the same problem, version and precision."""
        self._step, late = self._c.restore(saved)
        self._late = bool(late)
        self._time = math.nan
        self._believed = True

    def __reduce_ex__(self, protocol: SupportsIndex) -> Any:
        for key, (value, _) in self._own.items():
            _check_sendable(key, value)
        return super().__reduce_ex__(protocol)

    def _copied(self) -> Self:
        """An object of its own in this process, which shares functions of time."""
        make, arguments, state = self.__reduce__()
        copied: Self = make(*arguments)
        copied.__setstate__(state)
        return copied

    def __copy__(self) -> Self:
        return self._copied()

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self._copied()

    def __getstate__(self) -> tuple[Settings, dict[str, tuple[Any, float]], bytes]:
        return dict(self._settings), dict(self._own), self.save_state()

    def __setstate__(self, state: tuple[Settings, dict[str, tuple[Any, float]], bytes]) -> None:
        self._settings, self._own, saved = state
        self._targets = None
        self._c.configure(self._settings)
        self.restore(saved)

    # -- setpoints ---------------------------------------------------------------------------------------------------

    def reference(self, **setpoints: ArrayLike | Any) -> None:
        """Move setpoints by name, from the next step on; all others stay, and all arguments hold, or none.

        Parameters
        ----------
        **setpoints
            Numbers, constant from now on; a function of time since the last reset [s] that returns all entries; an
            array (count, entries) with a row per node from now on, a stage apart, linear between them, the last
            row held; or None: the first one again.

        Raises
        ------
        InputError
            If nothing with a setpoint has the name, the number of entries differs, or numbers are not finite or out of
            reach.

        Notes
        -----
        Functions are asked in every step, for the instants of its horizon. ``current_setpoints`` shows the current
        ones. A step that is given its own ``reference`` follows that one alone.

        Examples
        --------
        >>> import numpy as np
        >>> import continuum_grasp as cg
        >>> controller = cg.Controller("configs/mpc/steady_tip.yaml", deadline=np.inf)
        >>> controller.reference(tip=(-0.06, 0.16))
        >>> controller.current_setpoints["tip"].tolist()
        [-0.06, 0.16]
        >>> controller.reference(tip=lambda t: (-0.06 - 0.01 * t, 0.16))  # a function of time
        >>> controller.reference(tip=np.linspace((-0.06, 0.16), (-0.05, 0.17), 31))  # over the horizon
        >>> controller.reference(tip=None)  # as in the scene
        """
        now = self._now
        requested = {key: (value, now) for key, value in setpoints.items() if value is not None}
        others = {key: value for key, value in self._own.items() if key not in setpoints}
        unknown = dict.fromkeys(set(setpoints) - set(requested), ((), 0.0))
        if not set(unknown) <= set(self.nominal_setpoints.parts):
            self._replaced(unknown)  # raises
        moved = self._replaced({**others, **requested})
        self._own = {**others, **requested}
        self._targets = moved

    @property
    def current_setpoints(self) -> dict[str, Array]:
        """Return the setpoints, by name, at the first node of the next step if it gets no ``reference``."""
        row = self._following().rows(self._now, check=False)[0]
        return {key: row[part] for key, part in self._following().parts.items()}

    @property
    def _now(self) -> float:
        return self.period * self._step

    def _following(self) -> Setpoints:
        if self._targets is None:
            self._targets = self._replaced(self._own)
            self._chunk = -1
        return self._targets

    def _replaced(self, replacements: Mapping[str, tuple[Any, float]]) -> Setpoints:
        setpoints = self.nominal_setpoints
        self._chunk = -1
        for key, (value, since) in replacements.items():
            setpoints = setpoints.replaced({key: value}, since, self.stages.stage)
        return setpoints

    @property
    def _ahead(self) -> Array:
        return self.stages.stage * np.arange(self.stages.stages + 1.0)

    def _scheduled(self) -> Array:
        following = self._following()
        # Functions may be defined up to the horizon only, or return the present value.
        size = 1 if following.by_functions else _CHUNK
        chunk, at = divmod(self._step, size)
        if self._chunk != chunk:
            times = self.period * (chunk * size + np.arange(size))[:, None] + self._ahead
            rows_at = following.rows(times.ravel(), check=False)
            self._rows: Array = rows_at.reshape(size, len(self._ahead), self.stages.nr)
            self._chunk = chunk
        rows: Array = self._rows[at]
        return rows

    def _shape_error(self, **arguments: Any) -> InputError:
        """Name arguments with a wrong shape, or with entries that are no numbers."""
        s = self.stages
        shapes: dict[str, tuple[Any, ...]] = {
            "measurement": (self._measurement.shape,),
            "reference": ((s.nr,), self._setpoints.shape),
            "p": ((s.np,),),
            "applied": ((s.nu,),),
            **dict.fromkeys(("late", "time", "age"), ((),)),
        }
        messages = []
        for name, value in arguments.items():
            shape = _shape(value)
            expected = shapes[name]
            if value is None or isinstance(value, Mapping) or shape in expected:
                continue
            got = CheckedArgument(name, value).shown(80) if shape in (None, ()) else str(shape)
            messages.append(f"{self._called.get(name, name)}: expected {' or '.join(map(str, expected))}, got {got}")
        return InputError("a step takes arrays of numbers; " + "; ".join(messages))


def _check_sendable(key: str, value: Any) -> None:
    """Refuse a setpoint that no other process can be sent."""
    if callable(value):
        try:
            pickle.dumps(value)
        except Exception as error:  # AttributeError, TypeError, PicklingError: as the function has it
            name = getattr(value, "__qualname__", None) or type(value).__qualname__
            words = f"the function {name}, by which it is set over time, cannot be pickled ({error})"
            raise InputError(
                f"{words}: expected a function that is defined at the top level of a module, not a lambda or a "
                "nested function",
                key=f"reference.{key}",
            ) from error


def _shape(value: Any) -> tuple[int, ...] | None:
    """Return the shape of an argument; None if it is ragged, or no array of numbers."""
    try:
        return CheckedArgument(None, value).doubles().shape
    except (ValueError, TypeError):
        return None


def _copy(to: Array, value: ArrayLike, spread: bool = False) -> None:
    """Copy an array of the same shape, or ``spread`` one of another over all entries."""
    array = value if type(value) is np.ndarray and value.dtype == float else CheckedArgument(None, value).doubles()
    if array.shape != to.shape and not spread:
        raise ValueError
    to[:] = array
