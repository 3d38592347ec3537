"""The part of ``peers`` in another interpreter, which has do-mpc or acados's Python package.

``python external.py FOLDER`` reads dynamics, outputs, rows and plant of a closed loop (CasADi's files) and
numbers from the folder. do-mpc runs the loop, as it comes (collocation and IPOPT), and writes ``run.npz`` there; of
acados the C of the solver is written to ``FOLDER/solver``. acados renders its templates by a program that it downloads;
jinja2 renders them as well, once three words of their language are explained to it.
"""

from __future__ import annotations

import json
import os
import re
import sys
import time
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np


def main(folder: Path) -> None:
    """Do what the numbers of a folder ask for."""
    data = json.loads((folder / "case.json").read_text(encoding="utf-8"))
    functions = {
        name: ca.Function.load(str(folder / f"{name}.casadi")) for name in ("dynamics", "outputs", "rows", "plant")
    }
    if data["solver"] == "acados":
        from acados_template import AcadosOcpSolver, acados_ocp

        acados_ocp.render_template = rendered
        os.chdir(folder)
        AcadosOcpSolver.generate(problem(data, **functions), verbose=False)
    else:
        run_loop(folder, data, **functions)


def run_loop(
    folder: Path, data: dict[str, Any], dynamics: ca.Function, outputs: ca.Function, rows: ca.Function, plant: Any
) -> None:
    """The closed loop by do-mpc."""
    import do_mpc

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
    low, high = np.full(x.numel(), -np.inf), np.full(x.numel(), np.inf)
    for box in data["boxes"]:
        k = box["state"]
        low[k], high[k] = max(low[k], box["least"]), min(high[k], box["most"])
    controller.bounds["lower", "_x", "x"], controller.bounds["upper", "_x", "x"] = low, high
    for row in data["rows"]:
        value = rows(x, u, p)[row["row"]]
        controller.set_nl_cons(f"row_{row['row']}", value - row["most"], ub=0.0)
        controller.set_nl_cons(f"row_{row['row']}_least", row["least"] - value, ub=0.0)
    now, template = 0, controller.get_tvp_template()
    with np.load(folder / "case.npz") as found:
        references, plant_p = found["references"], found["plant_p"]

    def setpoints(_: float) -> Any:
        for k in range(data["stages"] + 1):
            template["_tvp", k, "r"] = references[now, k]
        return template

    controller.set_tvp_fun(setpoints)
    controller.setup()
    steps, state = len(references), np.array(data["x0"])
    controller.x0, controller.u0 = state, np.array(data["u0"])
    controller.set_initial_guess()
    states, inputs = [state], []
    seconds, good = np.zeros(steps), np.zeros(steps, bool)
    for now in range(steps):
        began = time.process_time()
        command = controller.make_step(state.reshape(-1, 1))
        seconds[now] = time.process_time() - began
        good[now] = bool(controller.solver_stats["success"])
        state = np.array(plant(state, command, plant_p[now])).ravel()
        states.append(state)
        inputs.append(np.array(command).ravel())
    versions = json.dumps({"do-mpc": do_mpc.__version__, "casadi": ca.__version__})
    np.savez(folder / "run.npz", x=states, u=inputs, seconds=seconds, good=good, versions=versions)


def problem(
    data: dict[str, Any], dynamics: ca.Function, outputs: ca.Function, rows: ca.Function, plant: ca.Function
) -> Any:
    """The problem as a user of acados would pose it: bounds of states apart from other rows, all of them soft.

    With ``hard`` in the numbers they are hard, which leaves acados no slacks; with ``linear`` the residuals are linear
    in states and inputs, and acados does not linearize them at every step.
    """
    from acados_template import AcadosOcp

    del plant
    x, u, p = dynamics.sx_in()
    ocp, rate = AcadosOcp(), ca.SX.sym("rate", x.shape)
    model, cost, limits, options = ocp.model, ocp.cost, ocp.constraints, ocp.solver_options
    ocp.name = model.name = "loop"
    model.x, model.u, model.p, model.xdot = x, u, p, rate
    model.f_expl_expr = dynamics(x, u, p)
    model.f_impl_expr = rate - model.f_expl_expr
    ocp.parameter_values = np.array(data["p"])

    tracked, last = outputs(x, u, p), data["nt"]
    for end, many in (("_0", tracked), ("", tracked), ("_e", tracked[:last])):
        weights = np.array(data["terminal_weights"][:last] if end == "_e" else data["weights"])
        setattr(cost, f"cost_type{end}", "LINEAR_LS" if data["linear"] else "NONLINEAR_LS")
        if data["linear"]:
            for name, of in (("x", x), ("u", u))[: 1 if end == "_e" else 2]:
                setattr(cost, f"V{name}{end}", np.array(ca.evalf(ca.jacobian(many, of))))
        else:
            setattr(model, f"cost_y_expr{end}", many)
        setattr(cost, f"W{end}", np.diag(weights))
        setattr(cost, f"yref{end}", np.zeros(len(weights)))

    limits.x0 = np.array(data["x0"])
    limits.lbu, limits.ubu, limits.idxbu = np.array(data["u_min"]), np.array(data["u_max"]), np.arange(u.numel())
    boxes, value, h = data["boxes"], rows(x, u, p), data["stage"]
    for end in ("", "_e"):
        setattr(limits, f"lbx{end}", np.array([box["least"] for box in boxes]))
        setattr(limits, f"ubx{end}", np.array([box["most"] for box in boxes]))
        setattr(limits, f"idxbx{end}", np.array([box["state"] for box in boxes], int))
        if not data["hard"]:
            setattr(limits, f"idxsbx{end}", np.arange(len(boxes)))
    for end, which in (("_0", "input"), ("", "input"), ("_e", "state")):
        # Rows of the state alone hold at the nodes 1 to N, others at 0 to N - 1.
        own = [row for row in data["rows"] if row["of"] == which or end == ""]
        if own:
            setattr(model, f"con_h_expr{end}", value[[row["row"] for row in own]])
            setattr(limits, f"lh{end}", np.array([row["least"] for row in own]))
            setattr(limits, f"uh{end}", np.array([row["most"] for row in own]))
            if not data["hard"]:
                setattr(limits, f"idxsh{end}", np.arange(len(own)))
        soft = [] if data["hard"] else [*(boxes if end != "_0" else []), *own]
        scale = 1.0 if end == "_e" else h  # acados multiplies the cost of a stage by its length
        for name, key in (("z", "linear"), ("Z", "quadratic")):
            for side in "lu":
                setattr(cost, f"{name}{side}{end}", np.array([row[key] / scale for row in soft]))

    options.N_horizon, options.tf = data["stages"], data["stages"] * h
    options.integrator_type, options.sim_method_num_stages = "ERK", 4
    options.sim_method_num_steps = data["substeps"]
    options.hessian_approx, options.nlp_solver_type = "GAUSS_NEWTON", "SQP_RTI"
    options.qp_solver = data["qp_solver"]
    if data["qp_solver"].startswith("PARTIAL"):
        options.qp_solver_cond_N = data["blocks"]
    ocp.code_gen_options.code_export_directory = "solver"
    ocp.code_gen_options.json_file = "solver.json"
    return ocp


def rendered(source: str, target: str, folder: str, numbers: str, template_glob: str | None = None) -> None:
    """Render a template of acados, in place of its ``render_template``."""
    import acados_template
    import jinja2

    del template_glob
    if source.startswith("main") or not source.endswith((".in.c", ".in.h")):  # no part of a library
        return
    text = (Path(acados_template.__file__).parent / "c_templates_tera" / source).read_text(encoding="utf-8")
    for name in set(re.findall(r"set_global (\w+)", re.sub(r"\w+set_global|set_global\(", "", text))):
        text = re.sub(r"({%-?\s*)set_global " + name, rf"\1set {name}", text)
        text = re.sub(
            r"{[{%].*?[}%]}", lambda tag, name=name: re.sub(rf"(?<![\w.]){name}\b", f"shared.{name}", tag[0]), text
        )
    environment = jinja2.Environment(
        extensions=["jinja2.ext.loopcontrols"],
        undefined=jinja2.StrictUndefined,
        finalize=lambda value: str(value).lower() if isinstance(value, bool) else value,
    )
    environment.tests["containing"] = lambda text, part: part in text
    environment.tests["starting_with"] = lambda text, part: text.startswith(part)
    environment.globals["range"] = lambda start=0, end=0: range(start, end)
    given = json.loads(Path(numbers).read_text(encoding="utf-8"))
    made = environment.from_string("{% set shared = namespace() %}" + text).render(given)
    Path(folder).mkdir(parents=True, exist_ok=True)
    (Path(folder) / target).write_text(made, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
