"""Identify the bending stiffness from weights that hang at the tip, and predict a weight that was not fitted.

The measurements are the elastica EI theta'' = F cos(theta), solved by SciPy's solve_bvp for a stiffness that
the identification does not know.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_bvp

import continuum_grasp as cg
from continuum_grasp.addons.identification import Poses, Reading

LENGTH, STIFFNESS = 0.2, 5.4e-3  # m, N m2
WEIGHTS = 9.81e-3 * np.array([5.0, 10.0, 20.0, 40.0])  # N; the last is held out


def measured(weight):
    """Tip of the elastica under a weight [m]: unknowns are angle, its slope, x and y."""

    def slopes(s, v):
        return np.vstack([v[1], weight / STIFFNESS * np.cos(v[0]), np.cos(v[0]), np.sin(v[0])])

    places = np.linspace(0.0, LENGTH, 50)
    ends = solve_bvp(slopes, lambda a, b: [a[0], b[1], a[2], a[3]], places, np.zeros((4, 50)), tol=1e-8).y[:, -1]
    return ends[2:]


def main(out=None):
    rod = cg.Rod(length=LENGTH, linear_density=1e-6, bending_stiffness=7e-3)  # a first guess
    finger = cg.Finger(rod=rod, base={"angle": -np.pi / 2})  # points along +X
    load = cg.ForceLoad(kind="force", at=LENGTH, force=(0.0, 0.0))
    scene = cg.Scene(finger=finger, gravity=(0.0, 0.0), loads=[load], fidelity={"elements": 4})
    tips = np.array([measured(weight) for weight in WEIGHTS])
    readings = [Reading("x", tips[:, 0]), Reading("y", tips[:, 1])]
    poses = Poses(readings, {"load_1_y": -WEIGHTS}, fitted=[True, True, True, False])
    fit = cg.identify(scene, poses, parameters=["bending_stiffness"])

    predicted = np.reshape(fit.predictions, (-1, 2))
    plt.figure(figsize=(4.2, 2.8), layout="constrained")
    plt.plot(*(1e3 * tips[:-1]).T, "o", label="fitted")
    plt.plot(*(1e3 * tips[-1:]).T, "s", label="hold-out")
    plt.plot(*(1e3 * predicted).T, "k+", ms=12, label="predicted")
    plt.legend(loc="upper left")
    plt.gca().set(xlabel="x [mm]", ylabel="y [mm]")
    if out:
        plt.savefig(out)
    found = fit["bending_stiffness"]
    print(f"stiffness {1e3 * found:.4f} mN m2, expected {1e3 * STIFFNESS:.4f} mN m2")
    assert abs(found / STIFFNESS - 1.0) < 1e-3
    return found, STIFFNESS


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
