"""Find natural frequencies and mode shapes of a uniform finger.

A cantilever vibrates at b^2 sqrt(EI / (rho A L^4)), where cos(b) cosh(b) = -1: 3.516, 22.034, 61.697 and so on
(S. S. Rao, Vibration of Continuous Systems, 2007, chapter 11).
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import brentq

import continuum_grasp as cg


def main(out=None):
    length, density, stiffness = 0.2, 0.036, 6.3e-3  # m, kg/m, N m2
    finger = cg.Finger(rod=cg.Rod(length=length, linear_density=density, bending_stiffness=stiffness))
    modes = cg.modes(cg.Scene(finger=finger, gravity=(0.0, 0.0), fidelity={"elements": 8}))
    unit = np.sqrt(stiffness / (density * length**4))  # rad/s
    factors = 2.0 * np.pi * modes.frequencies_hz / unit

    plt.figure(figsize=(4.2, 2.8), layout="constrained")
    for factor, shape in zip(factors[:3], modes.shapes, strict=False):
        across = shape[:, 0] / np.abs(shape[:, 0]).max()
        plt.plot(1e3 * modes.backbone[:, 1], across, label=f"{factor:.3f}")
    plt.gca().set(xlabel="place along the finger [mm]", ylabel="shape [1]", xlim=(-70.0, 205.0))
    plt.legend(title="factor", loc="upper left", fontsize="small")
    if out:
        plt.savefig(out)
    found, expected = factors[1], brentq(lambda b: np.cos(b) * np.cosh(b) + 1.0, 4.0, 5.0) ** 2
    print(f"second frequency factor {found:.3f}, expected {expected:.3f}")
    assert abs(found / expected - 1.0) < 0.002
    return found, expected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
