"""Bend a weightless cantilever by a force at its tip that keeps its direction, far beyond the linear range.

The tip comes from elliptic integrals: K. E. Bisshopp and D. C. Drucker, Large deflection of cantilever beams,
Quarterly of Applied Mathematics 3 (1945) 272-275, doi:10.1090/qam/13360.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipeinc, ellipkinc

import continuum_grasp as cg

LENGTH, STIFFNESS = 0.2, 6e-3  # m, N m2


def drop(load):
    """Tip drop per length under P L^2 / (E I)."""

    def arguments(modulus):
        return np.array([0.5 * np.pi, np.arcsin(np.sqrt(0.5) / modulus)]), modulus**2

    def arc(modulus):
        first = ellipkinc(*arguments(modulus))
        return first[0] - first[1] - np.sqrt(load)

    second = ellipeinc(*arguments(brentq(arc, np.sqrt(0.5) + 1e-12, 1.0 - 1e-12)))
    return 1.0 - 2.0 / np.sqrt(load) * (second[0] - second[1])


def main(out=None):
    rod = cg.Rod(length=LENGTH, linear_density=0.03, bending_stiffness=STIFFNESS)
    finger = cg.Finger(rod=rod, base={"angle": -np.pi / 2})  # points along +X
    scene = cg.Scene(finger=finger, gravity=(0.0, 0.0), fidelity={"elements": 8})
    plt.figure(figsize=(4.2, 3.0), layout="constrained")
    for load in (1.0, 3.0, 10.0):
        force = (0.0, -load * STIFFNESS / LENGTH**2)  # N
        rest = cg.equilibrium(scene, extra_loads=[cg.ForceLoad(kind="force", at=LENGTH, force=force)])
        plt.plot(*(1e3 * rest.backbone(points=60)).T, label=f"P L²/EI = {load:g}")
        plt.axhline(-1e3 * LENGTH * drop(load), color="k", lw=0.6, ls=":")
    plt.gca().set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal", xlim=(0.0, 330.0))
    plt.legend(loc="upper right")
    if out:
        plt.savefig(out)
    found, expected = -rest.tip[1] / LENGTH, drop(load)
    print(f"drop per length {found:.5f}, expected {expected:.5f}")
    assert abs(found - expected) < 1e-3
    return found, expected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
