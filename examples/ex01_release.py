"""Let a straight rod go under its weight and follow its tip.

The first drop comes from the modal series of the Euler-Bernoulli cantilever under a sudden uniform load
(S. S. Rao, Vibration of Continuous Systems, 2007, chapter 11): w(t) = sum a_n (1 - cos w_n t).
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import continuum_grasp as cg

LENGTH, DENSITY, STIFFNESS = 0.3, 0.02, 0.05  # m, kg/m, N m2
ROOTS = np.array([1.875104, 4.694091, 7.854757, 10.995541])  # of cos(b) cosh(b) = -1


def series(times):
    """Tip drop of the linear rod [m], by its first four modes."""
    sigma = (np.sinh(ROOTS) - np.sin(ROOTS)) / (np.cosh(ROOTS) + np.cos(ROOTS))
    rates = ROOTS**2 * np.sqrt(STIFFNESS / (DENSITY * LENGTH**4))  # rad/s
    tips = 2.0 * np.array([1.0, -1.0, 1.0, -1.0])  # of shapes with unit mean square
    return (tips * 2.0 * sigma / ROOTS * 9.81 / rates**2) @ (1.0 - np.cos(np.outer(rates, times)))


def main(out=None):
    rod = cg.Rod(length=LENGTH, linear_density=DENSITY, bending_stiffness=STIFFNESS)
    finger = cg.Finger(rod=rod, base={"angle": -np.pi / 2})  # points along +X
    scene = cg.Scene(
        finger=finger, gravity=(0.0, -9.81), time={"duration": 0.3, "step": 1e-3}, fidelity={"elements": 4}
    )
    motion = cg.simulate(scene)
    drop, linear = -motion.tip[:, 1], series(motion.t)

    plt.figure(figsize=(4.2, 2.8), layout="constrained")
    plt.plot(motion.t, 1e3 * drop, lw=4, alpha=0.5, label="continuum_grasp")
    plt.plot(motion.t, 1e3 * linear, "k:", label="modal series")
    plt.gca().set(xlabel="time [s]", ylabel="tip drop [mm]", ylim=(-0.5, 10.0))
    plt.legend(ncols=2, loc="upper center")
    if out:
        plt.savefig(out)
    found, expected = drop.max(), linear.max()
    print(f"greatest drop {1e3 * found:.3f} mm, expected {1e3 * expected:.3f} mm")
    assert abs(found / expected - 1.0) < 0.005
    return found, expected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
