"""Use the estimator alone: it learns the stiffness of a finger from a camera that sees the tip.

A tendon at a constant offset bends a weightless finger to an arc. The readings are the tip of this arc for a finger
that is 15 % softer than the model, with the noise of a camera.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import continuum_grasp as cg

LENGTH, STIFFNESS, OFFSET, TENSION, ERROR = 0.2, 6e-3, 0.005, 4.0, -0.15  # m, N m2, m, N, 1


def main(out=None):
    rod = {"length": LENGTH, "linear_density": 0.03, "bending_stiffness": STIFFNESS}
    tendons = {"offset": OFFSET, "max_tension": 20.0, "time_constant": 0.02}
    scene = cg.ControlScene(
        finger={"rod": rod, "tendons": tendons, "damping": {"material": 4e-5}},
        gravity=(0.0, 0.0),
        fidelity={"family": "clothoid", "elements": 2},
        parameters=["bending_stiffness"],
        controller={"horizon": {"stages": 10, "stage": 0.01}, "cost": {"tip": 1e4, "effort": 1e-3}},
        reference={"tip": (0.0, LENGTH)},
        estimator={"measured": {"tip": 3e-4}, "disturbances": {"bending_stiffness": 0.1}, "delay": 0.0},
    )
    estimator = cg.Estimator(scene)
    bend = TENSION * OFFSET * LENGTH / (STIFFNESS * (1.0 + ERROR))  # rad
    tip = LENGTH / bend * np.array([np.cos(bend) - 1.0, np.sin(bend)])
    noise = np.random.default_rng(0)
    at = next(k for k, name in enumerate(estimator.names) if "stiffness" in name)
    found = [estimator.step(noise.normal(tip, 3e-4), [TENSION, 0.0]) for _ in range(400)]
    errors, deviations = (np.array([getattr(one, name)[at] for one in found]) for name in ("z", "std"))

    times = 0.01 * np.arange(400)
    plt.figure(figsize=(4.2, 2.8), layout="constrained")
    plt.fill_between(times, errors - 2.0 * deviations, errors + 2.0 * deviations, alpha=0.3, label="± 2 deviations")
    plt.plot(times, errors, label="estimate")
    plt.axhline(ERROR, color="k", ls=":")
    plt.gca().set(xlabel="time [s]", ylabel="error of the stiffness [1]", ylim=(-0.5, 0.3))
    plt.legend()
    if out:
        plt.savefig(out)
    found = errors[200:].mean()
    print(f"stiffness error {found:.4f}, expected {ERROR:.4f}")
    assert abs(found - ERROR) < 0.005
    return found, ERROR


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
