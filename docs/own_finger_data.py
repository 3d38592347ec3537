"""Sample measurements of first_finger.md, simulated: ``python docs/own_finger_data.py`` in the root of the repository.

Shapes under weights are those of the exact elastic rod, the ring-down that of eight free clothoids with variable steps;
`identify` fits four matched clothoids. Both carry the noise of a camera.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import continuum_grasp as cg
from continuum_grasp.rod import solve_elastica
from continuum_grasp.scene import Scene

FOLDER = Path("configs/identify")
SCENE = FOLDER / "own_finger.yaml"
TRUTH = {"bending_stiffness": 5.93e-3, "material_damping": 4.2e-5, "clamp_angle": 0.02}
"""What the simulated finger has [N m2, N m2 s, rad]; the configuration starts elsewhere."""
WEIGHTS = (0.0, 2.5, 5.0, 7.5, 10.0, 15.0)
"""Hung from the tip [g]."""
READING = 0.3
"""Standard deviation of a position that is read from a picture [mm]."""
PIXEL = 0.25
"""Size of a pixel of the film [mm]."""
BLUR = 0.5
"""Standard deviation of the tip in the film [px]."""
RATE, DURATION = 60, 2.5
"""Pictures per second, and how long it is filmed [s]."""
HEAD = """\
# Simulated, not measured: a finger with bending_stiffness {bending_stiffness:g} N m2, material_damping
# {material_damping:g} N m2 s and a clamp that is turned by {clamp_angle:g} rad, by docs/own_finger_data.py.
"""


def true_scene(*changes: str) -> Scene:
    """The scene of the simulated finger."""
    angle = -0.5 * np.pi + TRUTH["clamp_angle"]
    own = [
        f"finger.rod.bending_stiffness={TRUTH['bending_stiffness']}",
        f"finger.damping.material={TRUTH['material_damping']}",
        f"finger.base.angle={angle}",
    ]
    scene = cg.load(SCENE, [*own, *changes])
    assert isinstance(scene, Scene)
    return scene


def weights(noise: np.random.Generator) -> str:
    """Table of tip positions under weights."""
    lines = ["weight_g,x [mm],y [mm]"]
    for grams in WEIGHTS:
        tip = solve_elastica(true_scene(f"loads[0].force=[0.0, {-9.81e-3 * grams}]")).tip
        x, y = 1e3 * np.asarray(tip) + READING * noise.standard_normal(2)
        lines.append(f"{grams:g},{x:.1f},{y:.1f}")
    return "\n".join(lines) + "\n"


def ring_down(noise: np.random.Generator) -> str:
    """Table of the height of the tip in the film after it was held down by a finger and let go."""
    motion = cg.simulate(
        true_scene(
            "fidelity={family: clothoid, elements: 8}",
            "initial={pose: equilibrium, held_by: [{kind: force, at: 0.2, force: [0.0, -0.05]}]}",
            f"time={{duration: {DURATION}, step: {1.0 / RATE!r}, method: reference}}",
        )
    )
    # Rows of a picture are counted downwards from its upper edge, so that the tip rises with falling numbers.
    pixels = 300.0 - 1e3 * motion.tip[:, 1] / PIXEL + BLUR * noise.standard_normal(len(motion.t))
    rows = [f"{t:.4f},{y:.1f}" for t, y in zip(motion.t, pixels, strict=True)]
    return "\n".join(["t [s],y [px]", *rows]) + "\n"


def main() -> None:
    """Write both files."""
    noise = np.random.default_rng(1)
    for name, table in (("weights", weights(noise)), ("ring_down", ring_down(noise))):
        (FOLDER / f"own_finger_{name}.csv").write_text(HEAD.format(**TRUTH) + table, encoding="utf-8")


if __name__ == "__main__":
    main()
