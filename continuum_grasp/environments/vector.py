"""Many fingers that move at once, as an environment of gymnasium."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.arguments import check_arguments, whole
from continuum_grasp.closed_loop.plant import choose_method, sensor_expressions
from continuum_grasp.closed_loop.readings import tracked_expression
from continuum_grasp.control.estimation.noise import measurement_range, measurement_std
from continuum_grasp.control.ocp.cost_terms import UNLIMITED
from continuum_grasp.environments.period import Periods, function
from continuum_grasp.environments.plants import Plants, plants_of, scenes_of
from continuum_grasp.errors import InputError
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.sweep import Sweep

try:
    import gymnasium
    from gymnasium.spaces import Box
    from gymnasium.vector import AutoresetMode
    from gymnasium.vector.utils import batch_space
except ImportError as error:
    raise InputError("environments need the extra 'gym': pip install 'continuum-grasp[gym]'") from error

Array = NDArray[np.float64]

STATE = "state"
"""Sensor that reads the whole state of the plant, exactly and at once."""
_TOLERANCE = 1e-4
"""Greatest error of the tip's position that steps in time may leave, per length [1]: that of ``time.tolerance``."""
_SUBSTEPS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128)
"""Steps of RK4 per period that are tried [1]."""
_STABLE = 2.7
"""Greatest product of step and fastest rate of RK4 [1]."""
_TRIED_PLANTS, _TRIED_PERIODS, _HELD_PERIODS = 16, 100, 7
"""Plants and periods of the motions that are compared, and how long these hold a random command [1]."""
_LEFT = 4
"""Least number of plants that must be within the range of their model at the end of these motions [1]."""
_FRICTION = 2.0
"""Greatest friction state [1]; one that slides is 1, and a step may overshoot."""
_AWAY = 10.0
"""Greatest distance of an object from the base, in finger lengths [1], as of what its camera may show."""


class Ended(Enum):
    """Why an episode ended."""

    TIME = "time"
    """The scene's duration is over: truncated."""
    RANGE = "range"
    """The plant left the range in which its model is valid: terminated."""
    DIVERGED = "diverged"
    """A number was not finite: terminated. The observation is the last finite one."""


class FingerVectorEnv(gymnasium.vector.VectorEnv[Array, Array, Array]):
    """Many plants of a closed loop, which move at once in the vector lanes of compiled C.

    An episode is that of ``run_closed_loop``: it starts where the scene does, a step is a control period under a
    constant command, and it is truncated after the scene's ``duration``. The reward of a step is the negative running
    cost of the controller in that period, so that the return of an episode is the negative ``metrics.cost`` of a closed
    loop with the same commands. Commands saturate at the limits of the input and its rate, as those of the controller
    are. An episode that leaves the range of the model is terminated, and charged as if the cost of its last step
    recurred until its end.

    Parameters
    ----------
    scene : ControlScene, Sweep, path-like or mapping
        A closed loop or its YAML file; or a sweep of one, its file, or the same as a mapping: each episode draws one of
        its scenes.
    num_envs : int
        Number of plants.
    sensors : str or sequence of str, optional
        What is observed: names in ``estimator.measured`` with the noise and delay that the plant has, and ``state``,
        the whole state without either. All of ``estimator.measured`` where not given, the state where there is none.
    substeps : int, optional
        Steps of RK4 per period; as many as the tolerance of ``simulate`` requires where not given.
    autoreset_mode : gymnasium.vector.AutoresetMode
        When plants whose episode ended are reset.

    Attributes
    ----------
    observation_names, action_names : tuple of str
        Name and unit of each entry.
    scenes : tuple of ControlScene
        Those that are drawn from; ``keys`` are the varied keys, ``values`` what each scene has there.
    drawn : (num_envs,) ndarray of int
        Which scene each plant has.
    x : (num_envs, nx) ndarray
        States, named by ``x_names``.
    substeps : int
    time_error : float
        Estimated error that these leave, per length of the finger [1]; NaN where ``substeps`` are given.
    contact_names : tuple of str
        Contacts whose normal forces [N] are in ``info["contact_force"]``, (num_envs, contacts).

    Notes
    -----
    An observation has the sensors, the command before, and setpoints: now, and where they vary within an episode also
    half a horizon and a horizon ahead. Readings beyond the bounds of the observation space saturate there.

    ``info["ended"]`` has the value of ``Ended`` where an episode ended, with the mask ``_ended``; ``info["scene"]``
    which scene was drawn where one began.

    Raises
    ------
    InputError
        If the scene is no closed loop, differs between draws by more than parameters, or is too stiff for RK4.

    Examples
    --------
    >>> import numpy as np
    >>> from continuum_grasp.environments import FingerVectorEnv
    >>> stiffness = {"count": 8, "keys": {"plant.stiffness": {"uniform": [0.8, 1.2]}}}
    >>> envs = FingerVectorEnv(
    ...     {"scene": "configs/mpc/steady_tip.yaml", "set": {"plant.fidelity.elements": 2,
    ...      "plant.fidelity.family": "matched_clothoid"}, "sample": stiffness},
    ...     num_envs=16,
    ... )
    >>> observation, info = envs.reset(seed=0)
    >>> observation.shape, envs.action_names
    ((16, 8), ('tension_1 [N]', 'tension_2 [N]'))
    >>> observation, reward, *_ = envs.step(np.ones((16, 2)))  # least tensions [N]
    >>> bool((reward < 0.0).all())
    True
    """

    @check_arguments
    def __init__(
        self,
        scene: ControlScene | Sweep | str | os.PathLike[str] | Mapping[str, Any],
        num_envs: int = 1,
        *,
        sensors: str | Sequence[str] | None = None,
        substeps: int | None = None,
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
    ) -> None:
        self.num_envs = whole("num_envs", num_envs)
        self._plants: Plants = plants_of(*scenes_of(scene))
        plants, first = self._plants, self._plants.scenes[0]
        self.scenes, self.keys, self.values = plants.scenes, plants.keys, plants.values
        self.metadata = {"autoreset_mode": AutoresetMode(autoreset_mode), "render_modes": []}
        self._mode = self.metadata["autoreset_mode"]
        self._period = first.controller.step
        limits = np.array(first.input_limits)
        self._low, self._high = limits
        most = first.controller.input.rate_max
        self._change = math.inf if most is None else most * self._period
        model = plants.model
        self.x_names, self.action_names = model.x_names, model.u_names
        self._radius = choose_method(model, self._period).radius
        if substeps is None and self._radius * self._period > _STABLE * _SUBSTEPS[-1]:
            raise self._too_stiff(f"more than {_SUBSTEPS[-1]} steps of RK4 in a period of {self._period:g} s")
        self._sense(sensors)
        self._prepare_setpoints()
        self._make_spaces()
        self.substeps, self.time_error = self._steps() if substeps is None else (whole("substeps", substeps), math.nan)
        # Readings at the start, with the command at rest.
        rest = np.tile(model.rest_input, (len(plants.p), 1))
        self._first = np.empty((len(plants.p), self._periods.sizes["y"]))
        rows = self._rows(np.arange(len(plants.p)), np.zeros(len(plants.p), dtype=np.int64))
        self._periods(plants.start.copy(), rest, rest, plants.forces, plants.p, rows, self._first, 0, 0.0)
        count = self.num_envs
        self.drawn = np.zeros(count, dtype=np.int64)
        self.x, self._u = np.empty((count, model.nx)), np.empty((count, model.nu))
        self._p, self._w = np.empty((count, plants.p.shape[1])), np.empty((count, model.nw))
        self._at = np.zeros(count, dtype=np.int64)
        self._readings = np.empty((count, self._first.shape[1]))
        self._past = np.empty((self._late + 1, count, len(self._std)))
        self._done = np.ones(count, dtype=np.bool_)
        self._begun = False

    # -- what is compiled ---------------------------------------------------------------------------------------------

    def _sense(self, sensors: str | Sequence[str] | None) -> None:
        """Compile a period, with readings: sensors, contact forces, range use."""
        plants = self._plants
        model, scene = plants.model, plants.scenes[0]
        x, u, w, p = model.symbols
        known = {STATE: dict(zip(model.x_names, ca.vertsplit(x), strict=True)), **sensor_expressions(scene, model)}
        if sensors is None:
            asked: tuple[str, ...] = tuple(known)[1:] or (STATE,)
        else:
            asked = (sensors,) if isinstance(sensors, str) else tuple(sensors)
        for name in asked:
            if name not in known or asked.count(name) > 1:
                raise InputError(
                    f"expected each once of {', '.join(known)} (what estimator.measured has), got {list(asked)}",
                    key="sensors",
                )
        self.sensors = asked
        read = {name: value for sensor in asked for name, value in known[sensor].items()}
        exact = set(model.x_names) if STATE in asked else set()
        self.sensor_names = tuple(read)
        self._std = np.array([0.0 if name in exact else measurement_std(scene, name) for name in read])
        self._std *= scene.plant.noise
        self._noisy = bool(self._std.any())
        delay = 0.0
        if scene.estimator is not None and asked != (STATE,):
            delay = scene.estimator.delay if scene.plant.delay is None else scene.plant.delay
        self._late = round(delay / self._period)
        if abs(self._late * self._period - delay) > 1e-6 * self._period:
            raise InputError(
                f"expected a whole number of periods of {self._period:g} s, got {delay:g} s", key="plant.delay"
            )
        if self._late and STATE in asked:
            raise InputError("state is observed at once, other sensors late: give one or the other", key="sensors")
        touched = [k for k, name in enumerate(model.system.touch_names) if name.startswith("finger.")]
        self.contact_names = tuple(model.system.touch_names[k] for k in touched)
        forces = [model.touch["normal_force"][k] for k in touched]
        self._parts = np.cumsum([len(read), len(touched)])
        held, r = ca.SX.sym("held", model.nu), ca.SX.sym("r", len(plants.outputs.names))
        error = tracked_expression(model, plants.prediction, held, scene.controller.horizon.stage) - r
        cost = 0.5 * self._period * ca.dot(ca.DM(plants.outputs.weights[:, 0]), error**2)
        given = {"x": x, "u": u, "w": w, "p": p}
        readings = ca.vertcat(*read.values(), *forces, ca.mmax(ca.fabs(model.range_use)), model.tip)
        slope = function("slope", given, model.forward_dynamics(x, u, w, p))
        self._periods = Periods(
            slope,
            function("cost", {"x": x, "u": u, "held": held, "w": w, "p": p, "r": r}, cost),
            function("readings", given, readings),
        )

    def _prepare_setpoints(self) -> None:
        """Note where setpoints of scene and period are in their table, and which of them are observed."""
        table = self._plants.setpoints
        scenes, times, width = table.shape
        self._table = table.reshape(-1, width)
        self._per_scene, self._per_time = times * (scenes > 1), int(times > 1)
        self._shown = self._plants.outputs.of_state
        terms = [term for term in self._plants.outputs.terms if term.of_state]
        cost, model = self._plants.outputs.cost, self._plants.prediction
        # Rates have no setpoint but zero, of which nothing is to be seen.
        given = [bool(term.reference) for term in terms for _ in term.names(cost, model)]
        self._columns = np.flatnonzero(given)
        horizon = self._plants.scenes[0].controller.horizon
        length = round(horizon.stages * horizon.stage / self._period)
        self._ahead = (0, length // 2, length) if self._per_time else (0,)

    def _rows(self, drawn: NDArray[np.int64], at: NDArray[np.int64]) -> Array:
        """Setpoints (count, nr) of scenes at periods."""
        if len(self._table) == 1:
            return np.repeat(self._table, len(drawn), axis=0)
        at = np.minimum(at, self._plants.periods)
        found: Array = np.take(self._table, drawn * self._per_scene + at * self._per_time, axis=0)
        return found

    # -- spaces -------------------------------------------------------------------------------------------------------

    def _make_spaces(self) -> None:
        plants = self._plants
        scene, prediction = plants.scenes[0], plants.prediction
        self._x_bounds = self._state_bounds()
        of_state = dict(zip(self.x_names, self._x_bounds, strict=True))
        sensed = [
            of_state[name] if STATE in self.sensors and name in of_state else measurement_range(scene, prediction, name)
            for name in self.sensor_names
        ]
        shown = self._table[:, self._columns]
        setpoints = np.stack([shown.min(axis=0), shown.max(axis=0)], axis=1)
        names = [plants.outputs.names[k] for k in self._columns]
        ahead = [f"{k * self._period:g} s ahead" for k in self._ahead]
        self.observation_names = (
            *self.sensor_names,
            *(f"command_{name}" for name in self.action_names),
            *(f"setpoint_{name}" + (f" {when}" if k else "") for k, when in enumerate(ahead) for name in names),
        )
        command = np.stack([self._low, self._high], axis=1)
        bounds = np.vstack([np.reshape(sensed, (-1, 2)), command, np.tile(setpoints, (len(ahead), 1))])
        # Of single precision, as observations are; rounded outwards.
        low, high = bounds.T.astype(np.float32)
        low = np.where(low > bounds[:, 0], np.nextafter(low, np.float32(-np.inf)), low)
        high = np.where(high < bounds[:, 1], np.nextafter(high, np.float32(np.inf)), high)
        self.single_observation_space = Box(low, high, dtype=np.float32)
        self.single_action_space = Box(self._low, self._high, dtype=np.float64)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._least, self._most = low, high

    def _state_bounds(self) -> Array:
        """Least and greatest value of each state (nx, 2), beyond which the model is not valid."""
        plants, model = self._plants, self._plants.model
        n, system = model.system.n, model.system
        reach = np.array(system.finger_model.structure.coordinate_limits())
        centers = plants.start[:, :n].min(axis=0), plants.start[:, :n].max(axis=0)
        bounds = np.tile([-UNLIMITED, UNLIMITED], (model.nx, 1))
        # Above the shape at rest, which is zero of a finger that is straight; a start may be bent.
        bounds[:n] = np.stack([np.minimum(centers[0], 0.0) - reach, np.maximum(centers[1], 0.0) + reach], axis=1)
        # Rates of the fastest mode at that amplitude, as the estimator has it.
        bounds[n : 2 * n] = self._radius * np.stack([-reach, reach], axis=1)
        base, length = np.array(model.scene.finger.base.position), model.scene.finger.rod.length
        pose = system.object_states
        for k in range(min(2, pose.stop - pose.start)):
            bounds[pose.start + k] = base[k] - _AWAY * length, base[k] + _AWAY * length
        bounds[system.friction_states] = -_FRICTION, _FRICTION
        scenes = plants.scenes
        lags = [t.time_constant for s in scenes for t in s.finger.tendon_list if t.time_constant is not None]
        lags += [s.plant.time_constant for s in scenes if s.plant.time_constant is not None]
        for k, name in enumerate(model.x_names):
            if name.startswith(("length_", "motor_angle_")) and "_rate" not in name:
                bounds[k] = measurement_range(scenes[0], plants.prediction, name)
        for k, name in enumerate(self.action_names):
            if name not in model.x_names[system.nx :]:
                continue
            at = system.nx + model.x_names[system.nx :].index(name)
            bounds[at] = self._low[k], self._high[k]  # a lag without overshoot
            if at + model.nu < model.nx and lags:
                # Of a critically damped lag of time T under commands that jump: range / (e T), at most.
                bounds[at + model.nu, 1] = (self._high[k] - self._low[k]) / (math.e * min(lags))
                bounds[at + model.nu, 0] = -bounds[at + model.nu, 1]
        return bounds

    # -- steps in time ------------------------------------------------------------------------------------------------

    def _steps(self) -> tuple[int, float]:
        """Fewest steps per period that satisfy the tolerance in random motions, and the error that they leave."""
        plants = self._plants
        count = len(plants.p)
        chosen = np.resize(np.unique(np.linspace(0, count - 1, min(count, _TRIED_PLANTS)).astype(int)), _TRIED_PLANTS)
        rng = np.random.default_rng(0)
        length = max(scene.finger.rod.length for scene in plants.scenes)
        commands = rng.uniform(self._low, self._high, (_TRIED_PERIODS, _TRIED_PLANTS, len(self._low)))
        commands = np.repeat(commands[::_HELD_PERIODS], _HELD_PERIODS, axis=0)
        # From gentle motions to those of the whole range of commands, in which a plant may leave that of its model.
        share = np.linspace(0.1, 1.0, _TRIED_PLANTS)[:, None]
        rest = plants.model.rest_input
        commands = rest + share * (commands - rest)
        ends: dict[int, Array] = {}
        error = math.inf
        for substeps in _SUBSTEPS:
            for k in (substeps, 2 * substeps):
                if k not in ends:
                    ends[k] = self._tips(chosen, commands, k)
            coarse, fine = ends[substeps], ends[2 * substeps]
            within = np.isfinite(fine).all(axis=2)
            # Steps that are too long for all plants lose them at once.
            if within[-1].sum() >= _LEFT and np.isfinite(coarse[within]).all():
                # Of order 4: 16/15 of the difference to half the step.
                error = 16.0 / 15.0 * float(np.linalg.norm((coarse - fine)[within], axis=1).max()) / length
                if error <= _TOLERANCE:
                    return substeps, error
        raise self._too_stiff(
            f"more than {_SUBSTEPS[-1]} steps of RK4 in a period of {self._period:g} s, which leave an error of "
            f"{error:.2g} of the length (expected {_TOLERANCE:g})"
        )

    def _too_stiff(self, needs: str) -> InputError:
        return InputError(
            f"this plant needs {needs}; its fastest rate is {self._radius:.3g} 1/s: take fewer elements "
            "({family: matched_clothoid, elements: 2}), a softer contact_law or slower commands",
            key="plant.fidelity",
        )

    def _tips(self, chosen: NDArray[np.int64], commands: Array, substeps: int) -> Array:
        """Tips (periods, count, 2) [m] of plants under commands; NaN from where one leaves the range of its model."""
        plants, count = self._plants, len(chosen)
        x, held = plants.start[chosen], np.tile(plants.model.rest_input, (count, 1))
        p, w = plants.p[chosen], plants.forces[chosen]
        rows, readings = (
            self._rows(chosen, np.zeros(count, dtype=np.int64)),
            np.zeros((count, self._periods.sizes["y"])),
        )
        found, lost = np.full((len(commands), count, 2), np.nan), np.zeros(count, dtype=np.bool_)
        for k, asked in enumerate(commands):
            u = np.ascontiguousarray(np.clip(asked, held - self._change, held + self._change))
            _, stopped = self._periods(x, u, held, w, p, rows, readings, substeps, self._period / substeps)
            lost |= stopped | (readings[:, self._parts[1]] > 1.0)
            found[k, ~lost] = readings[~lost, -2:]
            x[lost], held = plants.start[chosen][lost], u
        return found

    # -- episodes -----------------------------------------------------------------------------------------------------

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes.

        Parameters
        ----------
        seed : int, optional
            Of all draws and noise from now on.
        options : dict, optional
            ``reset_mask``: which plants are reset, (num_envs,) of bool; all where not given. ``scene``: number of the
            scene of these, one or (num_envs,); drawn where not given.

        Returns
        -------
        (num_envs, observations) ndarray, dict
            Observation and info.

        Raises
        ------
        InputError
            If an option is unknown or does not fit.
        """
        super().reset(seed=seed)
        asked = dict(options or {})
        mask, number = asked.pop("reset_mask", None), asked.pop("scene", None)
        if asked:
            raise InputError(f"expected reset_mask or scene, got {', '.join(map(repr, asked))}", key="options")
        lanes = np.ones(self.num_envs, dtype=np.bool_) if mask is None else np.asarray(mask)
        if lanes.shape != (self.num_envs,) or lanes.dtype != np.bool_ or not lanes.any():
            raise InputError(f"expected ({self.num_envs},) of bool, some of them true", key="options.reset_mask")
        if not self._begun and not lanes.all():
            raise InputError("the first reset is of all plants", key="options.reset_mask")
        self._begun = True
        self._begin(np.flatnonzero(lanes), number)
        info: dict[str, Any] = {"scene": self.drawn.copy(), "_scene": lanes.copy(), **self._contact_info()}
        return self._observation(), info

    def _begin(self, lanes: NDArray[np.int64], number: Any = None) -> None:
        """Start episodes of some plants."""
        plants, count = self._plants, len(self.scenes)
        if number is None:
            drawn = self.np_random.integers(count, size=len(lanes)) if count > 1 else np.zeros(len(lanes), np.int64)
        else:
            given = np.asarray(number)
            if given.dtype.kind not in "iu" or given.shape not in ((), (self.num_envs,)):
                raise InputError(f"expected one number or ({self.num_envs},), got {number!r:.60}", key="options.scene")
            drawn = np.broadcast_to(given, self.num_envs)[lanes].astype(np.int64)
            if not np.all((drawn >= 0) & (drawn < count)):
                raise InputError(f"expected numbers from 0 to {count - 1}, got {number!r:.60}", key="options.scene")
        self.drawn[lanes], self._at[lanes], self._done[lanes] = drawn, 0, False
        self.x[lanes], self._p[lanes], self._w[lanes] = plants.start[drawn], plants.p[drawn], plants.forces[drawn]
        self._u[lanes], self._readings[lanes] = plants.model.rest_input, self._first[drawn]
        self._past[:, lanes] = self._first[drawn, : self._parts[0]]

    def step(self, actions: Any) -> tuple[Any, Array, Any, Any, dict[str, Any]]:
        """Apply a command to each plant for one control period.

        Parameters
        ----------
        actions : (num_envs, nu) array_like
            Commands, each in the unit that ``action_names`` states.

        Returns
        -------
        observation, reward, terminated, truncated, info
            As of ``gymnasium.vector.VectorEnv``.

        Raises
        ------
        InputError
            If actions have the wrong shape or are not finite, or there was no reset.
        """
        asked = np.asarray(actions, dtype=np.float64)
        if asked.shape != self._u.shape or not np.isfinite(asked).all():
            raise InputError(f"expected {self._u.shape} finite numbers, got shape {asked.shape}", key="actions")
        if not self._begun:
            raise InputError("an episode begins with reset()")
        waiting = self._done.copy()
        if self._mode is AutoresetMode.DISABLED and waiting.any():
            raise InputError("episodes have ended: reset these plants before the next step", key="options.reset_mask")
        held = self._u
        u = np.clip(asked, np.maximum(self._low, held - self._change), np.minimum(self._high, held + self._change))
        rows = self._rows(self.drawn, self._at)
        cost, stopped = self._periods(
            self.x, u, held, self._w, self._p, rows, self._readings, self.substeps, self._period / self.substeps
        )
        self._u = u
        self._at += 1
        if self._late:
            self._past[:-1] = self._past[1:]
        self._past[-1] = self._readings[:, : self._parts[0]]
        beyond = self._readings[:, self._parts[1]] > 1.0
        beyond |= ((self.x < self._x_bounds[:, 0]) | (self.x > self._x_bounds[:, 1])).any(axis=1)
        terminated = stopped | beyond
        reward = -cost
        info: dict[str, Any] = {}
        if terminated.any() or (self._at >= self._plants.periods).any() or waiting.any():
            terminated &= ~waiting
            self._end(reward, stopped, terminated, waiting, info)
        truncated = self._done & ~terminated & ~waiting
        if waiting.any():
            self._begin(np.flatnonzero(waiting))
            info |= {"scene": self.drawn.copy(), "_scene": waiting}
        if self._mode is AutoresetMode.SAME_STEP and self._done.any():
            self._begin_at_once(info)
        info |= self._contact_info()
        return self._observation(), reward, terminated, truncated, info

    def _end(
        self,
        reward: Array,
        stopped: NDArray[np.bool_],
        terminated: NDArray[np.bool_],
        waiting: NDArray[np.bool_],
        info: dict[str, Any],
    ) -> None:
        """Note which episodes end in this step, why, and what that costs."""
        left = self._plants.periods - self._at
        over = (left <= 0) & ~waiting
        # As if the plant stayed where it is: an episode that fails must not be cheaper than one that goes on.
        reward[terminated] *= 1.0 + np.maximum(left[terminated], 0)
        reward[waiting] = 0.0
        self._done = (terminated | over) & ~waiting
        if self._done.any():
            why = np.full(self.num_envs, None, dtype=object)
            why[over], why[terminated] = Ended.TIME.value, Ended.RANGE.value
            why[terminated & stopped] = Ended.DIVERGED.value
            info |= {"ended": why, "_ended": self._done.copy()}

    def _begin_at_once(self, info: dict[str, Any]) -> None:
        """Reset in the step in which episodes end; the last observation and info of these are in ``info``."""
        done, last = self._done.copy(), self._observation()
        final = np.full(self.num_envs, None, dtype=object)
        for lane in np.flatnonzero(done):
            final[lane] = last[lane].copy()
        of_end = {name: info.pop(name) for name in ("ended", "_ended")}
        of_end |= self._contact_info()
        self._begin(np.flatnonzero(done))
        info |= {"final_obs": final, "_final_obs": done, "final_info": of_end, "_final_info": done.copy()}
        info |= {"scene": self.drawn.copy(), "_scene": done.copy()}

    def _contact_info(self) -> dict[str, Any]:
        first, last = self._parts
        if first == last:
            return {}
        everywhere = np.ones(self.num_envs, dtype=np.bool_)
        return {"contact_force": self._readings[:, first:last].copy(), "_contact_force": everywhere}

    def _observation(self) -> NDArray[np.float32]:
        sensed = self._past[0]
        if self._noisy:
            sensed = sensed + self._std * self.np_random.standard_normal(sensed.shape)
        a, b = sensed.shape[1], sensed.shape[1] + self._u.shape[1]
        found = np.empty((self.num_envs, len(self._least)), dtype=np.float32)
        found[:, :a], found[:, a:b] = sensed, self._u
        width = len(self._columns)
        for k, ahead in enumerate(self._ahead):
            rows = self._rows(self.drawn, self._at + ahead)
            found[:, b + k * width : b + (k + 1) * width] = rows[:, self._columns]
        return np.clip(found, self._least, self._most, out=found)
