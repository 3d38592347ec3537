"""Hold a standing can by three fingertips of a hand in space.

The can is on the axis of the hand, so that the tips share its weight by friction alone. With a share r of the friction
in reserve each of them presses with m g / (3 mu (1 - r)) at least.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import continuum_grasp as cg
from continuum_grasp.scene import HandScene


def main(out=None):
    mass, friction, reserve = 0.1, 0.6, 0.2  # kg, 1, 1
    finger = {
        "rod": {"length": 0.12, "bending_stiffness": 6e-3, "linear_density": 0.02},
        "half_thickness": 0.006,
        "section": {"shape": "rectangle", "thickness": 0.001, "width": 0.004},
        "tendons": {"offset": 0.006, "max_tension": 60.0},
    }
    can = {"shape": "cylinder", "diameter": 0.07, "height": 0.1, "edge_radius": 0.004, "mass": mass}
    scene = HandScene(
        hand={"finger": finger, "ring": {"count": 3, "radius": 0.055}},
        object={**can, "position": (0.0, 0.0, -0.1)},
        contacts={"friction": friction, "normal_force_max": 30.0, "reserve": reserve},
        gravity=(0.0, 0.0, -9.81),
    )
    grasp = cg.optimize_grasp(scene)

    turn = np.linspace(0.0, 2.0 * np.pi, 60)
    ax = plt.figure(figsize=(3.6, 3.6), layout="constrained").add_subplot(projection="3d")
    for height in (-150.0, -50.0):
        ax.plot(35.0 * np.cos(turn), 35.0 * np.sin(turn), height, color="0.5")
    for k, frame in enumerate(grasp.frames, 1):
        s, x, y, _ = grasp.arrays[f"finger_{k}.backbone"].T
        ax.plot(*(1e3 * frame.world(np.column_stack([x, y, 0.0 * s]))).T, lw=3)
    for contact in grasp.contacts:
        ax.quiver(*(1e3 * contact.position), *(-40.0 * contact.force), color="k")  # on the can
    ax.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]", aspect="equal")
    ax.set_box_aspect(None, zoom=0.75)
    if out:
        plt.savefig(out)
    found = max(contact.normal_force for contact in grasp.contacts)
    expected = mass * 9.81 / (3.0 * friction * (1.0 - reserve))
    print(f"normal force {found:.5f} N, expected {expected:.5f} N")
    assert abs(found / expected - 1.0) < 1e-3
    return found, expected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
