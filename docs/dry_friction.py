"""The picture of dry friction in docs/simulate.md, a loop and a release: python docs/dry_friction.py."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import continuum_grasp as cg
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import equilibrium_path

LENGTH = 0.3
BRANCHES = [{"stiffness": 0.2, "moment": 0.3}, {"stiffness": 1.0, "moment": 0.1}]


def hanging(branches: list[dict[str, float]], **keys: Any) -> Scene:
    """A rod with 200 g at its tip, hanging where ``keys`` give gravity."""
    finger = {
        "rod": {"length": LENGTH, "linear_density": 0.2, "bending_stiffness": 0.15},
        "damping": {"material": 0.006, "dry_friction": branches},
        "tip_body": {"mass": 0.2, "rotary_inertia": 1e-4},
        "base": {"angle": np.pi},
    }
    return Scene.model_validate({"finger": finger, "fidelity": {"family": "clothoid", "elements": 2}, **keys})


def loop() -> tuple[np.ndarray, np.ndarray]:
    """Tip moments to and fro with inner loops [N m], and the bends [rad]."""
    turns = [0.0, 1.0, -0.3, 0.4, -0.3, -1.0, 0.2, -0.4, 0.2, 1.0]
    parts = [np.linspace(a, b, 25)[1:] for a, b in pairwise(turns)]
    moments = np.concatenate([[0.0], *parts])
    scene = hanging(BRANCHES, gravity=(0.0, 0.0), actuation={"tip_moment": 1.0})
    path = equilibrium_path(scene, moments.tolist())
    return moments, np.array([np.sum(np.array(at.model.bending(at.q, at.u, at.p))) for at in path])


def release(branches: list[dict[str, float]]) -> cg.Trajectory:
    """Let go from an even bend."""
    initial = {"q": [5.0] * 3, **({"reached_by": "pulling"} if branches else {})}
    time = {"duration": 1.5, "step": 0.005}
    return cg.simulate(hanging(branches, gravity=(0.0, -9.81), initial=initial, time=time))


def main() -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 3.8), layout="constrained")
    moments, bends = loop()
    left.plot(bends, moments, linewidth=1.2)
    left.set(xlabel="bend [rad]", ylabel="moment at the tip [N m]", title="Loops close, inner ones too")
    for branches, word in (([], "linear damping alone"), (BRANCHES, "with dry friction")):
        found = release(branches)
        right.plot(found.t, 1e3 * found.tip[:, 0], linewidth=1.2, label=word)
        print(f"{word}: after 1.5 s the tip is at {1e3 * found.tip[-1, 0]:.1f} mm")
    right.set(xlabel="time [s]", ylabel="tip across [mm]", title="Let go: swings die out, and end aside")
    right.legend()
    target = Path(__file__).parent / "pictures" / "dry_friction.webp"
    figure.savefig(target, dpi=110, pil_kwargs={"quality": 85})


if __name__ == "__main__":
    main()
