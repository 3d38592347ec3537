"""Releases by this package: families, elements, accuracies and steps, with their errors and times."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import NumericalError
from continuum_grasp.core import Core
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import Signals, initial_state
from continuum_grasp.simulation.accuracy.choice import Choice, choices
from continuum_grasp.simulation.accuracy.motion import TipMotion
from continuum_grasp.simulation.accuracy.truth import Truth

FRAMES = 200
"""Instants of a reference motion in its second."""
STEPS = (25, 40, 50, 80, 100, 120, 160, 200, 240, 320, 400, 600, 800, 1000, 1200, 1600, 2400, 3200, 4800, 6400)
"""Steps per second that are tried, about as densely as MuJoCo's; those that do not run through are left out."""
CANDIDATES = {
    "matched_clothoid": ((1, 2, 3, 4, 6, 8), (1e-2, 1e-4)),
    "clothoid": ((1, 2, 3, 4), (1e-2, 1e-4)),
    "arc": ((2, 3, 4, 5, 8), (1e-4,)),
}
"""Elements and accuracies of evaluation of each family."""
NAMES = {"matched_clothoid": "matched clothoids", "clothoid": "clothoids", "arc": "arcs"}


def rms_error(tip: np.ndarray, reference: TipMotion) -> float:
    """R.m.s. distance [m] of a tip (T, 2) at equally spaced instants from the reference; infinite where it is lost."""
    every = FRAMES // (len(tip) - 1)
    off = np.hypot(*(tip - reference.tip[::every]).T)
    return float(np.sqrt(np.mean(off**2))) if np.all(np.isfinite(off)) else math.inf


def worst(tip: np.ndarray, fine: np.ndarray) -> float:
    """Greatest distance [m] of a tip from the same with finer steps; infinite where it is lost."""
    common = math.gcd(len(tip) - 1, len(fine) - 1)
    off = np.hypot(*(tip[:: (len(tip) - 1) // common] - fine[:: (len(fine) - 1) // common]).T)
    return float(off.max()) if np.all(np.isfinite(off)) else math.inf


@dataclass
class OwnRun:
    """One choice with one number of steps."""

    name: str
    choice: Choice
    core: Core
    x0: np.ndarray
    u: np.ndarray
    """Constant inputs."""
    steps: int
    """Per second."""
    cold: float
    """Time to generate, compile or load the choice, and find its initial state [s]."""
    tip: np.ndarray
    error: float = math.inf
    """R.m.s. against the reference [m]."""

    @property
    def cost(self) -> int:
        """Instructions of a second of motion."""
        return self.steps * self.choice.instructions

    def run(self, seconds: float) -> None:
        """Integrate a span of time in calls of up to a hundred seconds; states are stored as in the reference."""
        frames = math.gcd(FRAMES, self.steps)
        left = max(1, round(seconds * frames))
        while left > 0:
            count = min(left, 100 * frames)
            self.core.rollout(self.x0, count, 1.0 / frames, u=self.u, substeps=self.steps // frames)
            left -= count


def front(runs: Iterable[OwnRun]) -> list[OwnRun]:
    """Those than which no cheaper one is as close, but for a twentieth; cheapest first."""
    retained: list[OwnRun] = []
    for run in sorted(runs, key=lambda one: (one.cost, one.error)):
        if not retained or run.error < 0.95 * retained[-1].error:
            retained.append(run)
    return retained


def own_runs(scene: Scene, truth: Truth, reference: TipMotion) -> Iterator[OwnRun]:
    """All candidates with all numbers of steps with which they run through."""
    for family, (counts, accuracies) in CANDIDATES.items():
        for accuracy in accuracies:
            for choice in choices(scene, truth, family, accuracy):
                if choice.elements in counts and not choice.aligned:
                    yield from _with_steps(choice, reference)


def _with_steps(choice: Choice, reference: TipMotion) -> list[OwnRun]:
    began = time.perf_counter()
    core = Core(choice.model)
    core.prepare_rollout("rk4")
    x0 = initial_state(choice.scene.model_copy(update={"fidelity": choice.fidelity}), choice.model)
    u = Signals(choice.scene, choice.model).u(0.0)[0]
    cold = time.perf_counter() - began
    name = f"{choice.elements} {NAMES[choice.family]}"
    if choice.elements == 1:
        name = name.removesuffix("s")
    runs: list[OwnRun] = []
    for steps in STEPS:
        frames = math.gcd(FRAMES, steps)
        try:
            states = core.rollout(x0, frames, 1.0 / frames, u=u, substeps=steps // frames)
        except NumericalError:
            continue
        tip = np.asarray(core.batch("tip", states[:, : choice.model.n], u, None))
        run = OwnRun(name, choice, core, x0, u, steps, cold, tip, rms_error(tip, reference))
        runs.append(run)
        if len(runs) > 2 and worst(runs[-2].tip, tip) < 1e-6 * choice.scene.finger.rod.length:
            break
    return runs[:-1]
