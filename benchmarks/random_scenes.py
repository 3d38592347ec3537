"""Random scenes for which a tolerance chooses a model."""

from __future__ import annotations

from typing import Any

import numpy as np

from continuum_grasp.scene import Scene


def random_scene(seed: int) -> Scene:
    """A finger with random size, masses, rest curvature, loads, contacts and gravity; it moves in half of the cases.

    Loads, weights and rest curvatures bend it by angles of about one radian.
    """
    random = np.random.default_rng(seed)
    length, stiffness = 10 ** random.uniform(-1.2, 0.2), 10 ** random.uniform(-3.0, 0.0)
    force, moment = stiffness / length**2, stiffness / length
    weight = force * 10 ** random.uniform(-2.0, 0.3)
    scene: dict[str, Any] = {
        "finger": {
            "rod": {
                "length": length,
                "linear_density": weight / (9.81 * length),
                "bending_stiffness": stiffness,
            },
            "base": {"position": [0.0, 0.0], "angle": random.uniform(-np.pi, np.pi)},
            "masses": _masses(random, length, weight, force),
            "rest_curvature": _rest(random, length),
        },
        "gravity": [0.0, -9.81] if random.random() < 0.8 else [0.0, 0.0],
        "loads": [_load(random, length, force, moment) for _ in range(random.integers(0, 3))],
        "contacts": [length * random.uniform(0.25, 0.75)] if random.random() < 0.4 else [],
        "initial": {"pose": "equilibrium"},
    }
    if random.random() < 0.5:
        scene["time"] = {"duration": 1.0, "step": 0.01}
    if random.random() < 0.3:
        scene["actuation"] = {"tip_moment": float(random.normal() * moment)}
    return Scene.model_validate(scene)


def _masses(random: np.random.Generator, length: float, weight: float, force: float) -> list[dict[str, float]]:
    masses = []
    if random.random() < 0.5:
        masses.append({"at": length, "mass": min(weight * 10 ** random.uniform(-1.0, 1.0), force) / 9.81})
    if random.random() < 0.3:
        masses.append({"at": length * random.uniform(0.2, 0.9), "mass": weight * random.uniform(0.1, 0.5) / 9.81})
    return masses


def _rest(random: np.random.Generator, length: float) -> Any:
    kind = random.random()
    if kind < 0.25:
        return random.uniform(-1.5, 1.5) / length
    if kind < 0.4:
        values = (random.uniform(-1.5, 1.5, 2) / length).tolist()
        return {"breaks": [length * random.uniform(0.2, 0.8)], "values": values}
    return 0.0


def _load(random: np.random.Generator, length: float, force: float, moment: float) -> dict[str, Any]:
    at = length if random.random() < 0.4 else length * random.uniform(0.1, 0.95)
    if random.random() < 0.3:
        return {"kind": "moment", "at": at, "moment": float(random.normal() * 0.7 * moment)}
    value = (1.2 * force * random.normal(size=2)).tolist()
    return {"kind": "force", "at": at, "force": value, "follows": bool(random.random() < 0.3)}
