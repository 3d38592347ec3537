"""Many fingers that move at once, as an environment of gymnasium."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.learning.environments.plants import Plants, plants_of, rows_of, scenes_of
from continuum_grasp.addons.learning.environments.sensing import observed_of, sensing_of, single_precision, state_bounds
from continuum_grasp.addons.learning.environments.substeps import check_stiffness, choose_substeps
from continuum_grasp.addons.sweeps import Sweep
from continuum_grasp.base import Array, CheckedArgument, InputError, check_arguments, install_line
from continuum_grasp.scene import ControlScene

try:
    import gymnasium
    from gymnasium.spaces import Box
    from gymnasium.vector import AutoresetMode
    from gymnasium.vector.utils import batch_space
except ImportError as error:
    raise InputError(f"environments need the extra 'gym': {install_line('gym')}") from error


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

    An episode runs like ``run_closed_loop``: it starts where the scene does, a step is a control period under a
    constant command, and it is truncated after the scene's ``duration``. The reward of a step is the negative running
    cost of the controller in that period, so that the return of an episode is the negative ``metrics.cost`` of a closed
    loop with the same commands. Commands saturate at the limits of the input and its rate, like the controller's
    commands. An episode that leaves the range of the model is terminated, and charged as if the cost of its last step
    recurred until its end.

    Parameters
    ----------
    scene : ControlScene, Sweep, path-like or mapping
        A closed loop or its YAML file; or a sweep of one, its file, or the same as a mapping: each episode draws one of
        its scenes.
    num_envs : int
        Number of plants.
    sensors : str or sequence of str, optional
        Observed quantities: names in ``estimator.measured`` with the noise and delay of the plant, and ``state``,
        the whole state without either. By default all of ``estimator.measured``, or the state without an estimator.
    substeps : int, optional
        Steps of RK4 per period; by default as many as the tolerance of ``simulate`` requires.
    autoreset_mode : gymnasium.vector.AutoresetMode
        Time at which plants whose episode ended are reset.

    Attributes
    ----------
    observation_names, action_names : tuple of str
        Name and unit of each entry.
    scenes : tuple of ControlScene
        Scenes to draw from; ``keys`` are the varied keys, ``values`` each scene's values there.
    drawn : (num_envs,) ndarray of int
        Number of each plant's scene.
    x : (num_envs, nx) ndarray
        States, named by ``x_names``.
    substeps : int
    time_error : float
        Estimated error of these steps, per length of the finger [1]; NaN where ``substeps`` are given.
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
    >>> from continuum_grasp.addons.learning import FingerVectorEnv
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
        self.num_envs = CheckedArgument("num_envs", num_envs).whole()
        self._plants: Plants = plants_of(*scenes_of(scene))
        plants = self._plants
        first = self._plants.scenes[0]
        self.scenes = plants.scenes
        self.keys = plants.keys
        self.values = plants.values
        self.metadata = {"autoreset_mode": AutoresetMode(autoreset_mode), "render_modes": []}
        self._mode = self.metadata["autoreset_mode"]
        self._low, self._high = np.array(first.input_limits)
        rate_limit = first.controller.input.rate_max
        self._change = math.inf if rate_limit is None else rate_limit * plants.period
        model = plants.model
        self.x_names = model.x_names
        self.action_names = model.u_names
        radius = model.method_for(plants.period).radius
        if substeps is None:
            check_stiffness(radius, plants.period)
        self._sensing = sensing_of(plants, sensors)
        self.sensors, self.contact_names = self._sensing.sensors, self._sensing.contacts
        of_state = state_bounds(plants, radius)
        self._x_bounds = np.ascontiguousarray(of_state.T)
        self._observed = observed_of(plants, self._sensing, of_state)
        self.observation_names = self._observed.names
        self._least, self._most = single_precision(self._observed.bounds)
        self.single_observation_space = Box(self._least, self._most, dtype=np.float32)
        self.single_action_space = Box(self._low, self._high, dtype=np.float64)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.substeps = CheckedArgument("substeps", 1 if substeps is None else substeps).whole()
        self.time_error = math.nan
        if substeps is None:
            self.substeps, self.time_error = choose_substeps(plants, self._sensing, self._change, radius)
        # Readings at the start, with the command at rest.
        rest = np.tile(model.rest_input, (len(plants.p), 1))
        self._first = np.empty((len(plants.p), self._sensing.periods.sizes["y"]))
        rows = rows_of(plants.setpoints, np.arange(len(plants.p)), np.zeros(len(plants.p), dtype=np.int64))
        at_rest = plants.start.copy(), rest, rest, plants.forces, plants.p, rows
        self._sensing.periods(*at_rest, self._x_bounds, self._first, 0, 0.0)
        count = self.num_envs
        self.drawn = np.zeros(count, dtype=np.int64)
        self.x = np.empty((count, model.nx))
        self._u = np.empty((count, model.nu))
        self._p = np.empty((count, plants.p.shape[1]))
        self._w = np.empty((count, model.nw))
        self._at = np.zeros(count, dtype=np.int64)
        self._readings = np.empty((count, self._first.shape[1]))
        # What is observed is in single precision.
        self._past = np.empty((self._sensing.late + 1, count, len(self._sensing.names)), dtype=np.float32)
        self._std = self._sensing.std.astype(np.float32)
        self._noisy = bool(self._std.any())
        self._done = np.ones(count, dtype=np.bool_)
        self._begun = False

    # -- episodes -----------------------------------------------------------------------------------------------------

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes.

        Parameters
        ----------
        seed : int, optional
            Seed of all draws and noise from now on.
        options : dict, optional
            ``reset_mask``: which plants are reset, (num_envs,) of bool; by default all. ``scene``: number of the
            scene of these, one or (num_envs,); by default drawn.

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
            expected = f"a boolean array of shape ({self.num_envs},) with at least one true entry"
            raise InputError(f"expected {expected}", key="options.reset_mask")
        if not self._begun and not lanes.all():
            raise InputError("the first reset must include all plants", key="options.reset_mask")
        self._begun = True
        self._begin(np.flatnonzero(lanes), number)
        info: dict[str, Any] = {"scene": self.drawn.copy(), "_scene": lanes.copy(), **self._contact_info()}
        return self._observation(), info

    def _begin(self, lanes: NDArray[np.int64], number: Any = None) -> None:
        """Start episodes of some plants."""
        plants = self._plants
        count = len(self.scenes)
        if number is None:
            drawn = self.np_random.integers(count, size=len(lanes)) if count > 1 else np.zeros(len(lanes), np.int64)
        else:
            numbers = np.asarray(number)
            if numbers.dtype.kind not in "iu" or numbers.shape not in ((), (self.num_envs,)):
                raise InputError(f"expected one number or ({self.num_envs},), got {number!r:.60}", key="options.scene")
            drawn = np.broadcast_to(numbers, self.num_envs)[lanes].astype(np.int64)
            if not np.all((drawn >= 0) & (drawn < count)):
                raise InputError(f"expected numbers from 0 to {count - 1}, got {number!r:.60}", key="options.scene")
        self.drawn[lanes], self._at[lanes], self._done[lanes] = drawn, 0, False
        self.x[lanes], self._p[lanes], self._w[lanes] = plants.start[drawn], plants.p[drawn], plants.forces[drawn]
        first = self._first[drawn]
        self._u[lanes], self._readings[lanes] = plants.model.rest_input, first
        self._past[:, lanes] = first[:, : len(self._sensing.names)]

    def step(self, actions: Any) -> tuple[Any, Array, Any, Any, dict[str, Any]]:
        """Apply a command to each plant for one control period.

        Parameters
        ----------
        actions : (num_envs, nu) array_like
            Commands, each in the unit that ``action_names`` states.

        Returns
        -------
        observation, reward, terminated, truncated, info
            As in ``gymnasium.vector.VectorEnv``.

        Raises
        ------
        InputError
            If actions have the wrong shape or are not finite, or there was no reset.
        """
        asked = self._commands(actions)
        if not self._begun:
            raise InputError("call reset() before the first step")
        waiting = self._done.copy()
        if self._mode is AutoresetMode.DISABLED and waiting.any():
            raise InputError("episodes have ended: reset these plants before the next step", key="options.reset_mask")
        held = self._u
        low, high = self._low, self._high
        if self._change < math.inf:
            low = np.maximum(low, held - self._change)
            high = np.minimum(high, held + self._change)
        u = np.clip(asked, low, high)
        plants = self._plants
        rows = rows_of(plants.setpoints, self.drawn, self._at)
        arrays = self.x, u, held, self._w, self._p, rows, self._x_bounds, self._readings
        cost, stopped = self._sensing.periods(*arrays, self.substeps, plants.period / self.substeps)
        self._u = u
        self._at += 1
        if self._sensing.late:
            self._past[:-1] = self._past[1:]
        self._past[-1] = self._readings[:, : len(self._sensing.names)]
        self._past[0][:, self._sensing.at_once] = self._past[-1][:, self._sensing.at_once]
        terminated = stopped > 0
        reward = -cost
        info: dict[str, Any] = {}
        any_waits = waiting.any()
        if any_waits or terminated.any() or (self._at >= self._plants.periods).any():
            terminated &= ~waiting
            self._end(reward, stopped, terminated, waiting, info)
        truncated = self._done & ~terminated & ~waiting
        if any_waits:
            self._begin(np.flatnonzero(waiting))
            info |= {"scene": self.drawn.copy(), "_scene": waiting}
        if self._mode is AutoresetMode.SAME_STEP and self._done.any():
            self._begin_at_once(info)
        info |= self._contact_info()
        return self._observation(), reward, terminated, truncated, info

    def _commands(self, actions: Any) -> Array:
        """Commands (num_envs, nu) that are asked for, all of them finite."""
        try:
            asked = np.asarray(actions, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"expected {self._u.shape} numbers: {error}", key="actions") from error
        if asked.shape != self._u.shape:
            raise InputError(f"expected {self._u.shape} numbers, got shape {asked.shape}", key="actions")
        if not np.isfinite(asked).all():
            lane, entry = np.argwhere(~np.isfinite(asked))[0]
            words = f"{self.action_names[entry]} of plant {lane} is {asked[lane, entry]}"
            raise InputError(f"expected finite numbers, but {words}", key="actions")
        return asked

    def _end(
        self,
        reward: Array,
        stopped: NDArray[np.int8],
        terminated: NDArray[np.bool_],
        waiting: NDArray[np.bool_],
        info: dict[str, Any],
    ) -> None:
        """Note which episodes end in this step, why, and what that costs."""
        left = self._plants.periods - self._at
        over = (left <= 0) & ~waiting
        # As if the plant stayed where it is: an episode that fails must not be cheaper than one that goes on.
        failed = np.flatnonzero(terminated)
        reward[failed] *= 1.0 + np.maximum(left[failed], 0)
        reward[waiting] = 0.0
        self._done = (terminated | over) & ~waiting
        if self._done.any():
            why = np.empty(self.num_envs, dtype=object)  # None
            why[np.flatnonzero(over)], why[failed] = Ended.TIME.value, Ended.RANGE.value
            why[failed[stopped[failed] == 1]] = Ended.DIVERGED.value
            info |= {"ended": why, "_ended": self._done.copy()}

    def _begin_at_once(self, info: dict[str, Any]) -> None:
        """Reset in the step in which episodes end; the last observation and info of these are in ``info``."""
        done = self._done.copy()
        last = self._observation()
        final = np.full(self.num_envs, None, dtype=object)
        for lane in np.flatnonzero(done):
            final[lane] = last[lane].copy()
        of_end = {name: info.pop(name) for name in ("ended", "_ended")}
        of_end |= self._contact_info()
        self._begin(np.flatnonzero(done))
        info |= {"final_obs": final, "_final_obs": done, "final_info": of_end, "_final_info": done.copy()}
        info |= {"scene": self.drawn.copy(), "_scene": done.copy()}

    def _contact_info(self) -> dict[str, Any]:
        if not self.contact_names:
            return {}
        everywhere = np.ones(self.num_envs, dtype=np.bool_)
        return {"contact_force": self._readings[:, self._sensing.forces].copy(), "_contact_force": everywhere}

    def _observation(self) -> NDArray[np.float32]:
        a = self._past.shape[2]
        b = self._past.shape[2] + self._u.shape[1]
        observation = np.empty((self.num_envs, len(self._least)), dtype=np.float32)
        sensed = self._past[0]
        if self._noisy:
            noise = self.np_random.standard_normal(sensed.shape, dtype=np.float32)
            noise *= self._std
            noise += sensed
            sensed = noise
        np.clip(sensed, self._least[:a], self._most[:a], out=observation[:, :a])
        observation[:, a:b] = self._u
        observation[:, b:] = rows_of(self._observed.setpoints, self.drawn, self._at)
        return observation
