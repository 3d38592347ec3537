"""Environments with an id: a shipped closed loop each, with plants and setpoints that are drawn."""

from __future__ import annotations

from typing import Any

from continuum_grasp.examples import shipped_folder

_LOOPS = shipped_folder() / "configs" / "mpc"
_FAST = {"family": "matched_clothoid", "elements": 2}
"""Model of free space: the fewest elements that bend unevenly, at two steps a period."""
_PLANTS = {
    "plant.stiffness": {"log_uniform": [0.8, 1.25]},
    "plant.damping": {"log_uniform": [0.7, 1.4]},
    "plant.time_constant": {"uniform": [0.015, 0.030]},
}
"""Differences between plants of one design, as estimators of the shipped loops tolerate them; times in s."""
_ALONG = [
    *([-0.1158, 0.1125], [-0.0956, 0.1398], [-0.0827, 0.1515], [-0.0441, 0.1726], [-0.0268, 0.1773]),
    *([0.0355, 0.1752], [0.0527, 0.1693], [0.0682, 0.1614], [0.0827, 0.1515]),
]
"""Setpoints of the tip on the curve that it can reach at rest [m]."""

TASKS: dict[str, dict[str, Any]] = {
    "Reach": {
        "scene": str(_LOOPS / "steady_tip.yaml"),
        "set": {"plant.fidelity": _FAST, "duration": 1.0},
        "sample": {"count": 256, "keys": {**_PLANTS, "reference.tip": {"choice": _ALONG}}},
    },
    "Shape": {
        "scene": str(_LOOPS / "three_tendons.yaml"),
        "set": {"plant.fidelity": {**_FAST, "bending_range": 3.0}},
        "sample": {"count": 256, "keys": _PLANTS},
    },
    "Trajectory": {
        "scene": str(_LOOPS / "tip_arc.yaml"),
        "set": {"plant.fidelity": _FAST, "plant.tendon_friction": None},
        "sample": {"count": 256, "keys": _PLANTS},
    },
    "Wrap": {
        "scene": str(_LOOPS / "wrap_post.yaml"),
        "sample": {
            "count": 256,
            "keys": {
                **_PLANTS,
                "contact_law.friction": {"uniform": [0.3, 0.7]},
                "object.position[1]": {"uniform": [-0.003, 0.003]},
            },
        },
    },
}
"""Sweeps by the name in the id ``continuum_grasp/NAME-v0``: what ``FingerVectorEnv`` takes as its scene."""


def register() -> None:
    """Register all with gymnasium, each once."""
    import gymnasium

    for name, task in TASKS.items():
        id = f"continuum_grasp/{name}-v0"
        if id not in gymnasium.registry:
            gymnasium.register(
                id=id,
                entry_point="continuum_grasp.addons.learning.environments.single:FingerEnv",
                vector_entry_point="continuum_grasp.addons.learning.environments.vector:FingerVectorEnv",
                kwargs={"scene": task},
            )
