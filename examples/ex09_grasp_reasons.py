"""Ask for a grasp that does not exist, and get the reason with the number that would make it possible.

A fingertip squeezes a disc against a palm, and the weight acts out of the plane. Both contacts bear it by friction,
so that the greatest normal force N holds the mass 2 mu N / g.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import continuum_grasp as cg

FRICTION, FORCE = 0.2, 5.0  # 1; N, greatest normal force


def main(out=None):
    finger = {
        "rod": {"length": 0.2, "linear_density": 1e-6, "bending_stiffness": 0.4},
        "half_thickness": 0.006,
        "tendons": {"offset": 0.005, "max_tension": 200.0},
        "base": {"position": (0.0, -0.246)},
        "base_free": {"x": (-0.02, 0.02), "y": (-0.266, -0.226)},
    }
    scene = cg.GraspScene(
        finger=finger,
        object={"shape": "circle", "diameter": 0.08, "mass": 0.3, "position": (0.0, 0.0)},
        supports={"palm": {"type": "palm", "point": (0.0, 0.04), "normal_angle": -0.5 * np.pi}},
        contacts={"friction": FRICTION, "normal_force_max": FORCE, "middle": "off", "tip": "on"},
        gravity=(0.0, 0.0, -9.81),
        fidelity={"elements": 2},
        objective="least_normal_force",
        solver={"effort": "quick"},
    )
    failed = cg.optimize_grasp(scene, raise_on_failure=False)
    reason = next(reason for reason in failed.reasons if reason.name == "mass")

    plt.figure(figsize=(4.2, 4.2), layout="constrained")
    failed.plot(ax=plt.gca())
    if out:
        plt.savefig(out)
    found, expected = reason.needed, 2.0 * FRICTION * FORCE / 9.81
    print(f"{reason.text}, expected {expected:.4f} kg")
    assert abs(found / expected - 1.0) < 1e-3
    return found, expected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
