"""do-mpc as it comes (collocation and IPOPT) in a closed loop; run by another interpreter, see ``mpc_dompc``.

``python mpc_dompc_runner.py FOLDER`` reads dynamics, outputs and plant (CasADi's files) and numbers (JSON) from the
folder, and writes ``run.npz`` there.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import casadi as ca
import do_mpc
import numpy as np


def main(folder: Path) -> None:
    """Run the loop of a folder."""
    data = json.loads((folder / "case.json").read_text(encoding="utf-8"))
    dynamics, outputs, plant = (
        ca.Function.load(str(folder / f"{name}.casadi")) for name in ("dynamics", "outputs", "plant")
    )
    references, plant_p = (np.load(folder / f"{name}.npy") for name in ("references", "plant_p"))
    steps, x = data["steps"], np.array(data["x0"])
    controller, clock = controller_of(data, dynamics, outputs, references)
    controller.x0, controller.u0 = x, np.array(data["u0"])
    controller.set_initial_guess()
    states, inputs = [x], []
    seconds, good = np.zeros(steps), np.zeros(steps, bool)
    for k in range(steps):
        clock[0] = k
        began = time.process_time()
        u = controller.make_step(x.reshape(-1, 1))
        seconds[k] = time.process_time() - began
        good[k] = bool(controller.solver_stats["success"])
        x = np.array(plant(x, u, plant_p[k])).ravel()
        states.append(x)
        inputs.append(np.array(u).ravel())
    versions = json.dumps({"do-mpc": do_mpc.__version__, "casadi": ca.__version__})
    np.savez(folder / "run.npz", x=states, u=inputs, seconds=seconds, good=good, versions=versions)


def controller_of(data: dict[str, Any], dynamics: ca.Function, outputs: ca.Function, references: Any) -> Any:
    """The controller, and the list whose entry is the step that references are looked up for."""
    model = do_mpc.model.Model("continuous")
    x = model.set_variable("_x", "x", (dynamics.size1_in(0), 1))
    u = model.set_variable("_u", "u", (dynamics.size1_in(1), 1))
    r = model.set_variable("_tvp", "r", (outputs.size1_out(0), 1))
    p = ca.DM(data["p"])
    model.set_rhs("x", dynamics(x, u, p))
    model.setup()
    controller = do_mpc.controller.MPC(model)
    controller.set_param(n_horizon=data["stages"], t_step=data["stage"], store_full_solution=False)
    controller.settings.supress_ipopt_output()
    error, weights, last = outputs(x, u, p) - r, ca.DM(data["weights"]), ca.DM(data["terminal_weights"])
    at_end = ca.substitute(error, u, ca.DM.zeros(u.shape))
    controller.set_objective(mterm=0.5 * ca.dot(last, at_end**2), lterm=0.5 * data["stage"] * ca.dot(weights, error**2))
    controller.bounds["lower", "_u", "u"], controller.bounds["upper", "_u", "u"] = data["u_min"], data["u_max"]
    low, high = np.array(data["x_min"]), np.array(data["x_max"])
    controller.bounds["lower", "_x", "x"], controller.bounds["upper", "_x", "x"] = low, high
    for name, row in data["rows"].items():
        value = ca.Function.deserialize(row["function"])(x, u, p)
        controller.set_nl_cons(name, value - row["most"], ub=0.0)
        controller.set_nl_cons(f"{name}_least", row["least"] - value, ub=0.0)
    clock, template = [0], controller.get_tvp_template()

    def setpoints(_: float) -> Any:
        for k in range(data["stages"] + 1):
            template["_tvp", k, "r"] = references[clock[0], k]
        return template

    controller.set_tvp_fun(setpoints)
    controller.setup()
    return controller, clock


if __name__ == "__main__":
    main(Path(sys.argv[1]))
