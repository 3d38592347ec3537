"""do-mpc on the same closed loop, in the interpreter named in ``CONTINUUM_GRASP_PEERS_PYTHON``."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.baselines import VARIABLE
from benchmarks.machine import one_core
from benchmarks.mpc_cases import Case
from benchmarks.mpc_loop import LoopRun
from benchmarks.mpc_nlp import Nlp

_RUNNER = Path(__file__).with_name("mpc_dompc_runner.py")
_ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}


def dompc(case: Case, steps: int | None = None, *, timeout: float = 900.0) -> tuple[LoopRun, dict[str, str]]:
    """The closed loop by do-mpc's defaults, and its versions.

    Its model is continuous, so the problem must have no state that remembers the input.

    Raises
    ------
    RuntimeError
        With the reason why there is none.
    """
    stages, interpreter = case.stages, os.environ.get(VARIABLE, "")
    if not interpreter:
        raise RuntimeError(f"do-mpc: no interpreter given: set {VARIABLE}")
    if stages.nd < stages.nx:
        raise RuntimeError("do-mpc: its continuous model has no state that remembers the input")
    count = case.steps if steps is None else steps
    with tempfile.TemporaryDirectory(prefix="continuum-grasp-benchmark-") as name:
        folder = Path(name)
        for label, function in (("dynamics", stages.dynamics), ("outputs", stages.outputs), ("plant", case.plant())):
            function.save(str(folder / f"{label}.casadi"))
        np.save(folder / "references.npy", case.references)
        np.save(folder / "plant_p.npy", case.plant_p)
        (folder / "case.json").write_text(json.dumps(_numbers(case, count)), encoding="utf-8")
        command = [interpreter, os.fspath(_RUNNER), name]
        with one_core():
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=timeout, env={**os.environ, **_ONE_THREAD}, check=False
            )
        if done.returncode != 0:
            raise RuntimeError(f"do-mpc: {(done.stderr.strip().splitlines() or ['failed'])[-1]}")
        with np.load(folder / "run.npz") as found:
            run = {key: found[key] for key in found.files}
    seconds = np.column_stack([np.zeros(count), run["seconds"]])
    versions = json.loads(str(run["versions"]))
    return LoopRun(run["x"], run["u"], seconds, float(seconds[0, 1]), run["good"]), versions


def _numbers(case: Case, steps: int) -> dict[str, Any]:
    """What the runner needs beside functions; rows of a single state are its bounds."""
    stages = case.stages
    nlp = Nlp(replace(stages, stages=2), soft=False)
    place = slice(stages.nx + stages.nu, 2 * stages.nx + stages.nu)
    taken = {i for _, i in nlp.row_nodes}
    rows = {}
    for i in sorted(taken):
        x, u, p = stages.rows.sx_in()
        row = ca.Function("row", [x, u, p], [stages.rows(x, u, p)[i]])
        rows[f"row_{i}"] = {
            "function": row.serialize(),
            "least": float(stages.c_min[i]),
            "most": float(stages.c_max[i]),
        }
    return {
        "steps": steps,
        "stages": stages.stages,
        "stage": stages.stage,
        "rows": rows,
        **{name: getattr(case, name).tolist() for name in ("x0", "u0", "p")},
        **{name: getattr(stages, name).tolist() for name in ("weights", "terminal_weights", "u_min", "u_max")},
        "x_min": nlp.bounds["lbx"][place].tolist(),
        "x_max": nlp.bounds["ubx"][place].tolist(),
    }
