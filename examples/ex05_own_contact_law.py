"""Press the tip of a finger on a wall by your own contact law: Hertz's, F = k depth^1.5, as one expression.

The force comes from the linear cantilever, M L^2 / 2 EI - F L^3 / 3 EI = gap + (F / k)^(2/3), solved as a scalar
equation. The folder examples/addon gives such a law to all verbs of the command line.
"""

import argparse

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import brentq

import continuum_grasp as cg

LENGTH, STIFFNESS, OFFSET, GAP, HERTZ = 0.2, 6e-3, 0.005, 0.004, 500.0  # m, N m2, m, m, N/m^1.5


def linear_beam(tension):
    """Force on the wall [N] by the linear beam."""

    def too_deep(force):
        bent = tension * OFFSET * LENGTH**2 / 2.0 - force * LENGTH**3 / 3.0
        return bent / STIFFNESS - GAP - (force / HERTZ) ** (2.0 / 3.0)

    return brentq(too_deep, 0.0, 2.0 * tension * OFFSET / LENGTH)


def main(out=None):
    rod = cg.Rod(length=LENGTH, linear_density=0.03, bending_stiffness=STIFFNESS)
    finger = cg.Finger(rod=rod, tendons=cg.Tendons(offset=OFFSET, max_tension=20.0))
    model = cg.FingerModel(finger, family="clothoid", elements=4, gravity=(0.0, 0.0), tip_force=True)
    q, tension = ca.SX.sym("q", model.n), ca.SX.sym("tension")
    u = ca.vertcat(tension, 0.0)  # the wall is at x = -GAP, tendon 1 bends towards it
    force = HERTZ * ca.fmax(1e-12, -GAP - model.tip(q, u, [])[0]) ** 1.5  # your law
    missing, _ = model.statics(q, u, ca.vertcat(force, 0.0), [])
    solve = ca.rootfinder("solve", "newton", {"x": q, "p": tension, "g": missing})
    press = ca.Function("press", [q, tension], [force])

    tensions, rest, forces = np.linspace(1.0, 4.0, 31), np.full(model.n, 0.5), []
    for value in tensions:
        rest = solve(rest, value)
        forces.append(float(press(rest, value)))
    linear = [linear_beam(value) for value in tensions]
    plt.figure(figsize=(4.2, 2.8), layout="constrained")
    plt.plot(tensions, forces, lw=4, alpha=0.5, label="continuum_grasp")
    plt.plot(tensions, linear, "k:", label="linear beam")
    plt.gca().set(xlabel="tension [N]", ylabel="force on the wall [N]")
    plt.legend()
    if out:
        plt.savefig(out)
    print(f"force {forces[-1]:.5f} N, expected {linear[-1]:.5f} N")
    assert abs(forces[-1] / linear[-1] - 1.0) < 0.01
    return forces[-1], linear[-1]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
