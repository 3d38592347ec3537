"""Steps per second of the environments for reinforcement learning, on one core.

Run ``python -m benchmarks.bench_environments`` in the root of the repository (1 min, with the extra gym). Each
environment of ``continuum_grasp.environments.TASKS`` takes random commands, drawn beforehand, which hold for some
periods; ``state`` observes the state, other names what the estimator measures, with noise and delay. CPU time of the
thread, medians of rounds: a step of all plants by ``FingerVectorEnv.step`` with observations, rewards and resets, and
the compiled periods in it alone.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from benchmarks.harness import one_core
from benchmarks.report import Report, arguments
from continuum_grasp.environments import TASKS, FingerVectorEnv
from continuum_grasp.environments.plants import rows_of

ROUNDS, STEPS, HELD = 9, 40, 10
"""Rounds, steps of all plants in each, and periods for which a random command holds."""
RATES = {"Reach": 1e6, "Shape": 1e6, "Trajectory": 1e6, "Wrap": 1e5}
"""Environment steps per second and core that are asked for [1/s]."""


def rate(env: FingerVectorEnv, seed: int) -> tuple[float, float, int]:
    """Environment steps per second, those of the compiled periods alone, and episodes that ended."""
    rng = np.random.default_rng(seed)
    low, high = env.action_space.low, env.action_space.high
    # Up to a third of the range: plants seldom leave that of their model.
    commands = [rng.uniform(low, low + (high - low) / 3.0) for _ in range(STEPS // HELD)]
    env.reset(seed=seed)
    env.step(commands[0])
    whole, alone, ended = [], [], 0
    for _ in range(ROUNDS):
        began = time.thread_time()
        for k in range(STEPS):
            _, _, terminated, truncated, _ = env.step(commands[k // HELD])
            ended += int(np.count_nonzero(terminated | truncated))
        whole.append(time.thread_time() - began)
        plants, periods = env._plants, env._sensing.periods
        rows = rows_of(plants.setpoints, env.drawn, env._at)
        x, readings = env.x.copy(), env._readings.copy()
        arrays = x, env._u, env._u, env._w, env._p, rows, env._x_bounds, readings
        began = time.thread_time()
        for _ in range(STEPS):
            periods(*arrays, env.substeps, plants.period / env.substeps)
        alone.append(time.thread_time() - began)
    count = env.num_envs * STEPS
    return count / float(np.median(whole)), count / float(np.median(alone)), ended


def main() -> None:
    asked = arguments(__doc__, count=(1024, "plants of an environment"), seed=0)
    report, rows = Report("environments", asked.seed), list[list[Any]]()
    for name, task in TASKS.items():
        for sensors in ("state", None):
            env = FingerVectorEnv(task, asked.count, sensors=sensors)
            with one_core():
                whole, alone, ended = rate(env, asked.seed)
            words = "state" if sensors else ", ".join(env.sensors)
            instructions = env._plants.model.forward_dynamics.n_instructions()
            rows.append([name, words, env.x.shape[1], instructions, env.substeps, env.time_error, alone, whole, ended])
            print(rows[-1], flush=True)
            report.claim(f"{name}, {words}: environment steps/s", whole, ">=", RATES[name])
    columns = ["environment", "sensors", "states", "instructions", "steps of RK4", "time error [1/length]"]
    columns += ["periods/s", "environment steps/s", "episodes"]
    note = f"{asked.count} plants, one core, double precision; CPU time, medians of {ROUNDS} rounds of {STEPS} steps."
    report.table("Environments", columns, rows, note)
    report.finish()


if __name__ == "__main__":
    main()
