"""Run the predictive controller against your own plant: an oscillator, 20 % stiffer than the controller's finger.

The tip must come to rest on its setpoint: the tendons then pull by EI * bend / (L e), with the stiffness of the plant.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import continuum_grasp as cg

LENGTH, STIFFNESS, OFFSET, PERIOD = 0.2, 6e-3, 0.005, 0.01  # m, N m2, m, s


def tip(bend):
    """Tip of an arc [m]."""
    return LENGTH / bend * np.array([np.cos(bend) - 1.0, np.sin(bend)])


def advanced(bend, rate, pull, tensions):
    """Bend, its rate and the tension difference behind a lag of 40 ms, a period later."""
    for _ in range(20):
        pull += 0.05 * PERIOD * (tensions[0] - tensions[1] - pull) / 0.04
        rate += 0.05 * PERIOD * (1600.0 * (pull * OFFSET * LENGTH / (1.2 * STIFFNESS) - bend) - 12.0 * rate)
        bend += 0.05 * PERIOD * rate
    return bend, rate, pull


def main(out=None):
    tendons = {"offset": OFFSET, "min_tension": 0.5, "max_tension": 20.0, "time_constant": 0.02}
    scene = cg.ControlScene(
        finger={"rod": {"length": LENGTH, "linear_density": 0.03, "bending_stiffness": STIFFNESS}, "tendons": tendons},
        gravity=(0.0, 0.0),
        fidelity={"family": "arc", "elements": 1},
        controller={"horizon": {"stages": 20, "stage": 0.01}, "cost": {"tip": 2e4, "speed": 0.02, "input_rate": 1e-3}},
        reference={"tip": tip(0.8)},
        estimator={"measured": {"tip": 3e-4}, "disturbances": {"tip_moment": 0.01}, "delay": 0.0},
    )
    controller = cg.Controller(scene, deadline=np.inf, steps=200)
    state, commands = (1e-6, 0.0, 0.0), []
    for _ in range(200):
        commands.append(controller.step(tip(state[0])).u)
        state = advanced(*state, commands[-1])
    plt.figure(figsize=(4.2, 2.8), layout="constrained")
    plt.step(PERIOD * np.arange(200), commands, label=["tendon 1", "tendon 2"])
    plt.gca().set(xlabel="time [s]", ylabel="commanded tension [N]")
    plt.legend()
    if out:
        plt.savefig(out)
    found, expected = commands[-1][0] - commands[-1][1], 1.2 * STIFFNESS * 0.8 / (LENGTH * OFFSET)
    print(f"pull {found:.4f} N, expected {expected:.4f} N")
    assert abs(found / expected - 1.0) < 0.005
    return found, expected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
