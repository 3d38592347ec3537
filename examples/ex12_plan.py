"""Plan the fastest motion from rest to rest of a finger that a bounded moment at its tip bends.

One arc that bends little is a harmonic oscillator with the square rate 20 EI / (rho A L^4). Its fastest input has one
switch (L. S. Pontryagin and others, The Mathematical Theory of Optimal Processes, 1962, chapter 1), whose instants
follow from two circles in the phase plane.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import continuum_grasp as cg

LENGTH, DENSITY, STIFFNESS, MOMENT = 0.2, 0.03, 6e-3, 3e-3  # m, kg/m, N m2, N m
SHARE = 0.4  # of the bend under the greatest moment at rest


def main(out=None):
    finger = cg.Finger(rod=cg.Rod(length=LENGTH, linear_density=DENSITY, bending_stiffness=STIFFNESS))
    goal = SHARE * MOMENT * LENGTH / STIFFNESS  # rad
    scene = cg.PlanScene(
        finger=finger,
        gravity=(0.0, 0.0),
        fidelity={"family": "arc", "elements": 1},
        input={"moment_max": MOMENT},
        goal={"end": "still", "bending": [goal]},
        objective="least_time",
        smoothing=1e-6,
        duration={"least": 0.02, "most": 0.5},
        intervals=60,
    )
    plan = cg.plan(scene)

    switch = ((1.0 + SHARE) ** 2 - 1.0) / 4.0  # bend there, in units of the bend at rest
    phase = np.arccos(1.0 - switch) + np.arccos((1.0 + switch) / (1.0 + SHARE))  # rad
    expected = phase / np.sqrt(20.0 * STIFFNESS / (DENSITY * LENGTH**4))
    fig, (top, bottom) = plt.subplots(2, 1, figsize=(4.2, 3.4), sharex=True, layout="constrained")
    top.plot(plan.t, np.degrees(plan.x[:, 0]))
    top.set(ylabel="bend [deg]")
    bottom.step(plan.t, 1e3 * plan.u[:, 0], where="post")
    bottom.set(xlabel="time [s]", ylabel="moment [mN m]")
    if out:
        fig.savefig(out)
    found = plan.t[-1]
    print(f"duration {1e3 * found:.2f} ms, expected {1e3 * expected:.2f} ms")
    assert abs(found / expected - 1.0) < 0.01
    return found, expected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
