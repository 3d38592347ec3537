"""Hand the finger to another tool: its forward dynamics as the right-hand side of a do-mpc model.

Needs `pip install do-mpc`. The controller bends one arc by one radian; at rest a tendon at the offset e needs the
tension EI * 1 rad / (L e). CasADi's acados template takes the same expression as `f_expl_expr`.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np

import continuum_grasp as cg

try:
    import do_mpc
except ImportError:
    raise SystemExit("this example needs do-mpc: pip install do-mpc") from None


def main(out=None):
    rod = cg.Rod(length=0.2, linear_density=0.03, bending_stiffness=6e-3)  # m, kg/m, N m2
    tendons, damping = cg.Tendons(offset=0.005, max_tension=20.0), cg.Damping(material=4e-5)
    arc = cg.FingerModel(cg.Finger(rod=rod, damping=damping, tendons=tendons), family="arc", elements=1, gravity=(0, 0))
    model = do_mpc.model.Model("continuous", "SX")
    x, u = model.set_variable("_x", "x", (arc.nx, 1)), model.set_variable("_u", "u", (arc.nu, 1))
    model.set_rhs("x", arc.forward_dynamics(x, u, [], []))
    model.setup()
    mpc = do_mpc.controller.MPC(model)
    mpc.set_param(n_horizon=20, t_step=0.02, nlpsol_opts={"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": 0})
    mpc.set_objective(mterm=(x[0] - 1.0) ** 2, lterm=(x[0] - 1.0) ** 2 + 1e-3 * x[1] ** 2)
    mpc.set_rterm(u=1e-3)
    mpc.bounds["lower", "_u", "u"], mpc.bounds["upper", "_u", "u"] = 0.0, 20.0
    mpc.setup()
    plant = do_mpc.simulator.Simulator(model)
    plant.set_param(t_step=0.02)
    plant.setup()
    states, inputs = [np.zeros((arc.nx, 1))], []
    mpc.x0 = plant.x0 = states[0]
    mpc.set_initial_guess()
    for _ in range(40):
        inputs.append(mpc.make_step(states[-1]))
        states.append(plant.make_step(inputs[-1]))
    plt.figure(figsize=(4.2, 2.8), layout="constrained")
    plt.plot(0.02 * np.arange(41), np.array(states)[:, 0], label="bend [rad]")
    plt.step(0.02 * np.arange(40), np.array(inputs)[:, 0] / 10.0, where="post", label="tension [10 N]")
    plt.gca().set(xlabel="time [s]")
    plt.legend()
    if out:
        plt.savefig(out)
    found, expected = float(inputs[-1][0, 0] - inputs[-1][1, 0]), 6e-3 / (0.2 * 0.005)
    print(f"tension {found:.4f} N, expected {expected:.4f} N")
    assert abs(found / expected - 1.0) < 0.005
    return found, expected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
