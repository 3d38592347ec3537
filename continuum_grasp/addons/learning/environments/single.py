"""A finger as an environment of gymnasium."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from continuum_grasp.addons.learning.environments.vector import FingerVectorEnv
from continuum_grasp.addons.sweeps import Sweep
from continuum_grasp.base import Array, check_arguments
from continuum_grasp.scene import ControlScene

# After the module that states what to install where gymnasium is missing.
# isort: split
import gymnasium
from gymnasium.vector import AutoresetMode


class FingerEnv(gymnasium.Env[Array, Array]):
    """A plant of a closed loop; the same as ``FingerVectorEnv`` with one, without autoreset.

    Parameters
    ----------
    scene : ControlScene, Sweep, path-like or mapping
        As in ``FingerVectorEnv``.
    sensors : str or sequence of str, optional
        Observed quantities, as there.
    substeps : int, optional
        Steps of RK4 per period, as there.

    Attributes
    ----------
    lanes : FingerVectorEnv
        The environment that it runs in, with its attributes.

    Raises
    ------
    InputError
        As in ``FingerVectorEnv``.

    Examples
    --------
    >>> from continuum_grasp.addons.learning import TASKS, FingerEnv
    >>> env = FingerEnv(TASKS["Reach"], sensors="state")
    >>> observation, info = env.reset(seed=0)
    >>> observation, reward, terminated, truncated, info = env.step([1.0, 1.0])  # tensions [N]
    >>> terminated, truncated, env.lanes.x.shape
    (False, False, (1, 8))
    """

    @check_arguments
    def __init__(
        self,
        scene: ControlScene | Sweep | str | os.PathLike[str] | Mapping[str, Any],
        *,
        sensors: str | Sequence[str] | None = None,
        substeps: int | None = None,
    ) -> None:
        mode = AutoresetMode.DISABLED
        self.lanes = FingerVectorEnv(scene, 1, sensors=sensors, substeps=substeps, autoreset_mode=mode)
        self.observation_space = self.lanes.single_observation_space
        self.action_space = self.lanes.single_action_space
        self.metadata = {"render_modes": []}

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin a new episode: observation and info. ``options["scene"]`` is a scene's number (drawn by default)."""
        super().reset(seed=seed)
        self.lanes.np_random = self.np_random
        observation, info = self.lanes.reset(options=options)
        return observation[0], _of_one(info)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Apply a command (nu,) for one control period, each entry in the unit that ``lanes.action_names`` states.

        An action of the wrong shape or that is not finite, and one after the end of the episode, are an InputError.
        """
        observation, reward, terminated, truncated, info = self.lanes.step(np.asarray(action)[None])
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), _of_one(info)


def _of_one(info: dict[str, Any]) -> dict[str, Any]:
    """The info of one of one, without masks."""
    return {name: value[0] for name, value in info.items() if not name.startswith("_")}
