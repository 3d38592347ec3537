"""A policy trained by PPO on ``continuum_grasp/Reach-v0``, beside the scene's own controller in the same environment.

Run ``OPENBLAS_NUM_THREADS=1 python -m benchmarks.train_reach`` in the root of the repository (5 min on a quiet core),
with the extra gym and ``pip install stable-baselines3``, which needs torch; no test and no other script needs these.
The policy observes the state; the controller is given what its estimator measures, tip and tensions, noisy and late.
Both act on the first 64 plants of the environment, each of which has a stiffness, damping, drive and setpoint of its
own.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import stable_baselines3
import torch
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

import continuum_grasp as cg
from benchmarks.report import begun
from continuum_grasp.addons.learning import TASKS, FingerEnv, FingerVectorEnv

PLANTS, TRIED = 256, 64
"""Plants that are trained on at once, and those on which costs are compared."""
SPAN = 24.0
"""Range of the policy's tensions above the least one [N]: twice what holds any plant at its setpoint."""
DISCOUNT = 0.96
WITHIN = 1.2
"""Cost of the policy, per that of the controller."""


class Lanes(VecEnv):
    """A vector environment as stable-baselines3 takes it; its actions are from -1 to 1."""

    def __init__(self, envs: FingerVectorEnv) -> None:
        self.envs = envs
        self.least = envs.single_action_space.low
        super().__init__(envs.num_envs, envs.single_observation_space, Box(-1.0, 1.0, self.least.shape, np.float32))

    def command(self, actions: Any) -> Any:
        """Tensions [N]."""
        return self.least + 0.5 * SPAN * (actions + 1.0)

    def reset(self) -> Any:
        return self.envs.reset()[0]

    def step_async(self, actions: Any) -> None:
        self.asked = self.command(actions)

    def step_wait(self) -> Any:
        observation, reward, terminated, truncated, info = self.envs.step(self.asked)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for k in np.flatnonzero(terminated | truncated):
            infos[k] = {"terminal_observation": info["final_obs"][k], "TimeLimit.truncated": bool(truncated[k])}
        return observation, reward, terminated | truncated, infos

    def close(self) -> None: ...

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self.envs, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise NotImplementedError

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False] * self.num_envs


def lanes(count: int) -> Lanes:
    """The environment, with the state observed."""
    return Lanes(FingerVectorEnv(TASKS["Reach"], count, sensors="state", autoreset_mode=AutoresetMode.SAME_STEP))


def learner(seed: int) -> tuple[PPO, VecNormalize]:
    """PPO before its training, on one thread, and the plants that it is trained on."""
    torch.set_num_threads(1)
    env = VecNormalize(lanes(PLANTS), gamma=DISCOUNT)
    model = PPO(
        "MlpPolicy",
        env,
        n_steps=50,
        batch_size=1600,
        gamma=DISCOUNT,
        learning_rate=lambda left: 5e-4 * left + 1e-5,
        policy_kwargs={"net_arch": [64, 64], "log_std_init": -0.5},
        seed=seed,
        device="cpu",
    )
    return model, env


def cost_of_policy(model: PPO, normal: VecNormalize, tried: Lanes) -> Any:
    """Cost of each of the first plants under the policy's mean."""
    observation, _ = tried.envs.reset(seed=0, options={"scene": np.arange(TRIED)})
    cost, over = np.zeros(TRIED), np.zeros(TRIED, dtype=bool)
    while not over.any():
        action, _ = model.predict(normal.normalize_obs(observation), deterministic=True)
        observation, reward, terminated, over, _ = tried.envs.step(tried.command(np.clip(action, -1.0, 1.0)))
        if terminated.any():
            raise RuntimeError("a plant left the range of its model")
        cost -= reward
    return cost


def cost_of_controller() -> Any:
    """The same under the scene's controller, which reads the sensors of its estimator."""
    env = FingerEnv(TASKS["Reach"])
    control = cg.Controller(env.lanes.scenes[0], deadline=np.inf)
    cost = np.zeros(TRIED)
    for k in range(TRIED):
        scene, over = env.lanes.scenes[k], False
        control.reset(u=scene.rest_input)
        measured, _ = env.reset(seed=k, options={"scene": k})
        while not over:
            command = control.step(measured[:4].astype(float), {"tip": scene.reference.tip})
            measured, reward, _, over, _ = env.step(command.u)
            cost[k] -= reward
    return cost


def main() -> None:
    asked, report = begun(__doc__, "train_reach", steps=(2e6, "environment steps of the training"), seed=0)
    model, env = learner(asked.seed)
    began = time.thread_time()
    model.learn(int(asked.steps))
    taken = time.thread_time() - began
    policy, controller = cost_of_policy(model, env, lanes(TRIED)), cost_of_controller()
    report.claim("cost of the policy per that of the controller", policy.mean() / controller.mean(), "<=", WITHIN)
    note = (
        f"PPO of stable-baselines3 {stable_baselines3.__version__}, {model.num_timesteps} environment steps, "
        f"{taken:.0f} s of CPU time; costs of {TRIED} plants over 1 s."
    )
    columns = ["agent", "mean cost", "median", "worst"]
    table = report.table("Reach: a policy beside the controller", columns, note=note)
    for name, cost in (("policy (state)", policy), ("controller (tip, tension)", controller)):
        table.add(name, float(cost.mean()), float(np.median(cost)), float(cost.max()))
    report.finish()


if __name__ == "__main__":
    main()
