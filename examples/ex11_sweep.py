"""Vary a key of a grasp and read the table: the squeeze that holds a disc, over the friction coefficient.

A fingertip presses the disc against a palm, and the weight acts out of the plane. Both contacts share it, so the normal
force is m g / (2 mu): the slope of the table in logarithms is -1.
"""

import argparse
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import continuum_grasp as cg

SCENE = """
schema_version: 1
finger:
  rod: {length: 0.2, linear_density: 1.0e-6, bending_stiffness: 0.4}
  half_thickness: 0.006
  tendons: {offset: 0.005, max_tension: 200.0}
  base: {position: [0.0, -0.246]}
  base_free: {x: [-0.02, 0.02], y: [-0.266, -0.226]}
object: {shape: circle, diameter: 0.08, mass: 0.3, position: [0.0, 0.0]}
supports: {palm: {type: palm, point: [0.0, 0.04], normal_angle: -90 deg}}
contacts: {friction: 0.5, normal_force_max: 100.0, middle: off, tip: on}
gravity: [0.0, 0.0, -9.81]
fidelity: {elements: 2}
objective: least_normal_force
"""


def main(out=None):
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "squeeze.yaml").write_text(SCENE)
        vary = {"contacts.friction": {"values": [0.3, 0.4, 0.6, 0.8]}}
        config = {"scene": f"{folder}/squeeze.yaml", "set": {"solver.effort": "quick"}, "vary": vary}
        table = cg.sweep(config, folder=f"{folder}/sweep", workers=1, keep="none")
    friction, forces = table["contacts.friction"], table["normal_force_max"]
    plt.figure(figsize=(4.2, 2.8), layout="constrained")
    plt.plot(friction, forces, "o", label="sweep")
    fine = np.linspace(0.25, 0.85, 50)
    plt.plot(fine, 0.3 * 9.81 / (2.0 * fine), "k:", label="m g / (2 μ)")
    plt.gca().set(xlabel="friction coefficient", ylabel="normal force [N]")
    plt.legend()
    if out:
        plt.savefig(out)
    found, expected = np.polyfit(np.log(friction), np.log(forces), 1)[0], -1.0
    print(f"slope {found:.5f}, expected {expected:.5f}")
    assert abs(found - expected) < 1e-3
    return found, expected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
