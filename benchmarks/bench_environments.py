"""Steps per second of the environments for reinforcement learning, on one core.

Run ``python -m benchmarks.bench_environments`` in the root of the repository (1 min, with the extra gym). Each
environment of ``continuum_grasp.addons.learning.TASKS`` takes random commands, drawn beforehand, which hold for some
periods; ``state`` observes the state, other names what the estimator measures, with noise and delay. CPU time of the
thread, medians of rounds, of a step of all plants by ``FingerVectorEnv.step`` with observations, rewards and resets.
"""

from __future__ import annotations

import time

import numpy as np

from benchmarks.harness import one_core
from benchmarks.report import begun
from continuum_grasp.addons.learning import TASKS, FingerVectorEnv

ROUNDS, STEPS, HELD = 9, 40, 10
"""Rounds, steps of all plants in each, and periods for which a random command holds."""
RATES = {"Reach": 1e6, "Shape": 1e6, "Trajectory": 1e6, "Wrap": 1e5}
"""Environment steps per second and core that are asked for [1/s]."""


def rate(env: FingerVectorEnv, seed: int) -> tuple[float, int]:
    """Environment steps per second, and episodes that ended."""
    rng = np.random.default_rng(seed)
    low, high = env.action_space.low, env.action_space.high
    # Up to a third of the range: plants seldom leave that of their model.
    commands = [rng.uniform(low, low + (high - low) / 3.0) for _ in range(STEPS // HELD)]
    env.reset(seed=seed)
    env.step(commands[0])
    whole, ended = [], 0
    for _ in range(ROUNDS):
        began = time.thread_time()
        for k in range(STEPS):
            _, _, terminated, truncated, _ = env.step(commands[k // HELD])
            ended += int(np.count_nonzero(terminated | truncated))
        whole.append(time.thread_time() - began)
    return env.num_envs * STEPS / float(np.median(whole)), ended


def main() -> None:
    asked, report = begun(__doc__, "environments", count=(1024, "plants of an environment"), seed=0)
    columns = ["environment", "sensors", "states", "instructions", "steps of RK4", "time error [1/length]"]
    columns += ["environment steps/s", "episodes"]
    note = f"{asked.count} plants, one core, double precision; CPU time, medians of {ROUNDS} rounds of {STEPS} steps."
    table = report.table("Environments", columns, note=note)
    for name, task in TASKS.items():
        for sensors in ("state", None):
            env = FingerVectorEnv(task, asked.count, sensors=sensors)
            with one_core():
                whole, ended = rate(env, asked.seed)
            words = "state" if sensors else ", ".join(env.sensors)
            instructions = env._plants.model.forward_dynamics.n_instructions()
            table.add(name, words, env.x.shape[1], instructions, env.substeps, env.time_error, whole, ended)
            report.claim(f"{name}, {words}: environment steps/s", whole, ">=", RATES[name])
    report.finish()


if __name__ == "__main__":
    main()
