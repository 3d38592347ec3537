"""Put a finger into your own optimization problem: casadi.Opti finds the least tension that lowers the tip.

A tendon at a constant offset bends the weightless finger to an arc. Its tip is at y = 2 L / pi where the arc is a
quarter of a circle, under the tension pi EI / (2 L e).
"""

import argparse

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import continuum_grasp as cg


def main(out=None):
    length, stiffness, offset = 0.2, 6e-3, 0.005  # m, N m2, m
    rod = cg.Rod(length=length, linear_density=0.03, bending_stiffness=stiffness)
    finger = cg.Finger(rod=rod, tendons=cg.Tendons(offset=offset, max_tension=20.0))
    model = cg.FingerModel(finger, family="clothoid", elements=2, gravity=(0.0, 0.0))

    opti = ca.Opti()
    q, tensions = opti.variable(model.n), opti.variable(2)
    missing, _ = model.statics(q, tensions, [], [])  # generalized forces that equilibrium needs
    opti.subject_to(missing == 0.0)
    opti.subject_to(model.tip(q, tensions, [])[1] <= 2.0 * length / np.pi)
    opti.subject_to(opti.bounded(0.0, tensions, 20.0))
    opti.minimize(ca.sumsqr(tensions))
    opti.set_initial(q, 1.0)
    opti.solver("ipopt", {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"})
    solution = opti.solve()
    shape = solution.value(q)

    places = np.linspace(0.0, length, 40)
    points = np.array([model.position(shape, [0.0, 0.0], s, []) for s in places]).reshape(-1, 2)
    turned = np.linspace(0.0, 0.5 * np.pi, 40)
    plt.figure(figsize=(4.2, 3.2), layout="constrained")
    plt.plot(*(1e3 * points).T, lw=4, alpha=0.5, label="solution of Opti")
    plt.plot(2e3 * length / np.pi * (np.cos(turned) - 1.0), 2e3 * length / np.pi * np.sin(turned), "k:", label="circle")
    plt.gca().set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    plt.legend()
    if out:
        plt.savefig(out)
    found, expected = float(solution.value(tensions).max()), 0.5 * np.pi * stiffness / (length * offset)
    print(f"tension {found:.5f} N, expected {expected:.5f} N")
    assert abs(found / expected - 1.0) < 1e-3
    return found, expected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
