"""The settings of a hinge chain in MuJoCo that are tried, and the best of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from benchmarks.baselines.release_ours import rms_error, worst
from benchmarks.baselines.release_peers import ReleasePeers
from continuum_grasp.accuracy.motion import Motion

STEPS = (100, 200, 250, 300, 400, 500, 600, 800, 1000, 1200, 1400, 1600, 2000, 2800, 4000, 5600, 10000)
"""Per second; ``FRAME`` of ``bench_peers`` has a whole number of each."""
METHODS = (("implicitfast", False), ("implicitfast", True), ("Euler", False), ("Euler", True), ("discrete", False))
METHODS += (("RK4", False),)
"""Integrators, and whether the start is staggered."""
_EVALUATIONS = {"RK4": 4}
_AT_ITS_ERROR = 1.5


@dataclass
class ChainRun:
    """One setting and what came of it."""

    settings: dict[str, Any]
    error: float
    """R.m.s. against the reference [m]."""
    step_error: float
    """Greatest distance of the tip from that of the same hinges with the finest steps [m]."""
    cold: float

    @property
    def cost(self) -> int:
        """Evaluations of forces per second of motion."""
        return self.settings["steps"] * _EVALUATIONS.get(self.settings["integrator"], 1)

    @property
    def name(self) -> str:
        """Short and unique."""
        s = self.settings
        text = f"MuJoCo {s['hinges']} hinges ({s['layout']}), {s['integrator']}, {s['steps']}/s"
        return text + (", staggered" if s["staggered"] else "")


def sweep(
    peers: ReleasePeers, rod: Mapping[str, Any], hinges: int, reference: Motion, thin: bool = False
) -> list[ChainRun]:
    """All settings that run through, for one number of hinges; every other time step where ``thin``."""
    found = []
    for layout in ("middle", "clamp") if rod["uniform"] else ("middle",):
        motions = [
            (settings, peers.make("swept", "mujoco", rod, settings))
            for settings in _settings(hinges, layout, STEPS[::2] if thin else STEPS)
        ]
        finest = min((m for s, m in motions if s["steps"] == STEPS[-1]), key=lambda m: rms_error(m.tip, reference))
        for settings, motion in motions:
            error = rms_error(motion.tip, reference)
            if error < 0.1 * rod["length"]:
                found.append(ChainRun(settings, error, worst(motion.tip, finest.tip), motion.cold))
    return found


def _settings(hinges: int, layout: str, steps: tuple[int, ...]) -> Iterator[dict[str, Any]]:
    for integrator, staggered in METHODS:
        for count in steps:
            yield {
                "hinges": hinges,
                "layout": layout,
                "integrator": integrator,
                "steps": count,
                "staggered": staggered,
            }


def best(runs: list[ChainRun], tolerance: float) -> dict[str, ChainRun]:
    """The settings that are compared, of one number of hinges.

    Returns
    -------
    dict
        ``fastest``: the fewest evaluations with at most 1.5 times the error that the better layout has with the finest
        steps, whatever its start; ``plain``: the same without the staggered start; ``rule``: the fewest
        evaluations whose steps by themselves keep a tolerance [m]. Equal ones by error.
    """
    fine = min((r.error for r in runs if r.settings["steps"] == STEPS[-1]), default=math.inf)
    near = [r for r in runs if r.error <= _AT_ITS_ERROR * fine]
    groups = {
        "fastest": near,
        "plain": [r for r in near if not r.settings["staggered"]],
        "rule": [r for r in runs if r.step_error <= tolerance and r.error <= _AT_ITS_ERROR * fine],
    }
    return {key: min(group, key=lambda r: (r.cost, r.error)) for key, group in groups.items() if group}
