"""Let your own drive pull the tendon: a DC motor at a constant voltage winds up an elastic cable.

At rest the motor stalls: tension = torque constant * voltage / (resistance * drum radius), and a tendon at a constant
offset bends the finger to an arc of the angle tension * offset * length / EI.
"""

import argparse

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import continuum_grasp as cg

LENGTH, STIFFNESS, OFFSET = 0.2, 6e-3, 0.005  # m, N m2, m
VOLTAGE, RESISTANCE, CONSTANT, INERTIA = 6.0, 4.0, 0.02, 1e-6  # V, ohm, N m/A, kg m2
DRUM, CABLE = 0.004, 4e3  # m, N/m


def main(out=None):
    rod = cg.Rod(length=LENGTH, linear_density=0.03, bending_stiffness=STIFFNESS)
    tendons = cg.Tendons(offset=OFFSET, max_tension=20.0)
    finger = cg.Finger(rod=rod, damping=cg.Damping(material=4e-5), tendons=tendons)
    model = cg.FingerModel(finger, family="clothoid", elements=2, gravity=(0.0, 0.0))
    x, angle, speed = ca.SX.sym("x", model.nx), ca.SX.sym("angle"), ca.SX.sym("speed")
    bend = ca.sum1(ca.vec(model.bending(x[: model.n], [0.0, 0.0], [])))  # rad
    tension = CABLE * ca.fmax(0.0, DRUM * angle - OFFSET * bend)  # N
    torque = CONSTANT * (VOLTAGE - CONSTANT * speed) / RESISTANCE  # N m
    rates = ca.vertcat(
        model.forward_dynamics(x, ca.vertcat(tension, 0.0), [], []), speed, (torque - DRUM * tension) / INERTIA
    )
    state = ca.vertcat(x, angle, speed)
    times = np.linspace(0.0, 1.0, 201)
    motion = ca.integrator("motion", "cvodes", {"x": state, "ode": rates}, 0.0, times)
    states = motion(x0=np.zeros(model.nx + 2))["xf"]
    bends, tensions = (np.array(v).ravel() for v in ca.Function("f", [state], [bend, tension]).map(201)(states))

    expected = CONSTANT * VOLTAGE / (RESISTANCE * DRUM) * OFFSET * LENGTH / STIFFNESS
    fig, (top, bottom) = plt.subplots(2, 1, figsize=(4.2, 3.4), sharex=True, layout="constrained")
    top.plot(times, tensions)
    top.set(ylabel="tension [N]")
    bottom.plot(times, np.degrees(bends))
    bottom.axhline(np.degrees(expected), color="k", ls=":")
    bottom.set(xlabel="time [s]", ylabel="bend [deg]")
    if out:
        fig.savefig(out)
    print(f"bend at rest {bends[-1]:.5f} rad, expected {expected:.5f} rad")
    assert abs(bends[-1] / expected - 1.0) < 1e-3
    return bends[-1], expected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
