"""Plans in run folders."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.planning.check import Deviation
from continuum_grasp.planning.result import Constraint, Plan, PlanStatus
from continuum_grasp.scene.plan import PlanScene

__all__ = ["load_plan", "save_plan"]

_PARTS = ("values", "lower", "upper", "multipliers")


def save_plan(plan: Plan, folder: str | os.PathLike[str]) -> Path:
    """Write a plan; see `Plan.save`."""
    from continuum_grasp.results import write_run

    arrays: dict[str, Any] = {"t": plan.t, "x": plan.x, "u": plan.u, "tip": plan.tip}
    for name, constraint in plan.constraints.items():
        arrays |= {f"constraint {name} {part}": getattr(constraint, part) for part in _PARTS}
    arrays |= {f"solver {name}": value for name, value in plan.solver_state.items()}
    meta = {
        "config": plan.scene.model_dump(mode="json"),
        "status": plan.status.value,
        "warnings": list(plan.warnings),
        "statistics": dict(plan.statistics),
        "kind": "plan",
        "message": plan.message,
        "advice": plan.advice,
        "violated": list(plan.violated),
        "objective": plan.objective,
        "iterations": plan.iterations,
        "times": dict(plan.times),
        "deviation": None if plan.deviation is None else asdict(plan.deviation),
        "finer": None if plan.finer is None else asdict(plan.finer),
        "constraints": {c.name: {"key": c.key, "unit": c.unit} for c in plan.constraints.values()},
        "model": {"x_names": plan.x_names, "u_names": plan.u_names},
    }
    return write_run(folder, arrays, meta)


def load_plan(folder: str | os.PathLike[str]) -> Plan:
    """Read a plan from its run folder.

    Raises
    ------
    InputError
        There is no plan in the folder.
    """
    from continuum_grasp.results import read_run

    run = read_run(folder)
    meta, data = run.meta, run.arrays
    if meta.get("kind") != "plan":
        raise InputError("expected the folder of a plan, got that of another run", file=str(folder))
    constraints = {
        name: Constraint(name, about["key"], about["unit"], *(data[f"constraint {name} {part}"] for part in _PARTS))
        for name, about in meta["constraints"].items()
    }
    deviation, finer = (_deviation(meta[k]) for k in ("deviation", "finer"))
    return Plan(
        scene=PlanScene(**meta["config"]),
        status=PlanStatus(meta["status"]),
        message=meta["message"],
        t=data["t"],
        x=data["x"],
        u=data["u"],
        objective=float(meta["objective"]),
        constraints=constraints,
        iterations=int(meta["iterations"]),
        times=meta["times"],
        violated=tuple(meta["violated"]),
        advice=meta["advice"],
        deviation=deviation,
        finer=finer,
        warnings=tuple(meta["warnings"]),
        statistics=meta["statistics"],
        solver_state={
            name.removeprefix("solver "): np.asarray(value)
            for name, value in data.items()
            if name.startswith("solver ")
        },
    )


def _deviation(found: dict[str, Any] | None) -> Deviation | None:
    return None if found is None else Deviation(**{**found, "contact_forces": tuple(found["contact_forces"])})
