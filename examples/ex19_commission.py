"""Commission a bench: find out how its camera is mounted, from two seconds of motion.

The bench is simulated, so that the truth is known: its camera is shifted, scaled by 1.05 and turned by 0.1 rad.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import continuum_grasp as cg

SCENE = Path(__file__).parents[1] / "configs" / "mpc" / "steady_tip.yaml"


def main(out=None):
    camera = {"position": [0.008, -0.005], "angle": 0.1, "scale": 1.05}  # m, rad, 1
    scene = cg.load(SCENE, {"plant.mounting": {"camera": camera}, "mounting": {"camera": {"mirrored": False}}})
    found = cg.commission(scene, duration=2.0)

    names = ("camera_x", "camera_y", "camera_angle", "camera_scale")
    truths = np.array([*camera["position"], camera["angle"], camera["scale"]])
    errors = np.array([found[name] for name in names]) - truths
    plt.figure(figsize=(4.2, 2.4), layout="constrained")
    plt.barh(["x [mm]", "y [mm]", "turn [mrad]", "scale [1/1000]"], 1e3 * errors)
    plt.gca().set(xlabel="error of the mounting found")
    if out:
        plt.savefig(out)
    turn = found["camera_angle"]
    print(f"camera turned by {turn:.4f} rad, expected {camera['angle']:.4f} rad")
    assert abs(turn - camera["angle"]) < 0.005
    return turn, camera["angle"]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
