"""Closing on an object: from a grasp to the goal of a plan."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import InputError, Interrupted, SolverError
from continuum_grasp.planning.guess import Hint
from continuum_grasp.scene.finger import BasePose
from continuum_grasp.scene.plan import PlanScene, RowAim

__all__ = ["closing"]

Array = NDArray[np.float64]


def closing(scene: PlanScene, given: Any = None) -> tuple[PlanScene, Hint | None]:
    """The same plan with the goal of its grasp, and the posture there.

    Parameters
    ----------
    scene : PlanScene
        A plan; one without a grasp is given back as it is.
    given : GraspResult or path-like, optional
        The grasp, or its run folder, where it was found already.

    Raises
    ------
    SolverError
        There is no verified grasp.
    InputError
        The grasp does not fit the plan.
    """
    if scene.grasp is None:
        if given is not None:
            raise InputError("the plan has no grasp to carry out", key="grasp")
        return scene, None
    name = scene.grasp.setups[0].name
    data = _numbers(scene, given)
    if f"{name}.backbone" not in data or "object.pose" not in data:
        raise InputError(f"expected the grasp of a finger called {name!r}", key="grasp")
    of_finger = {
        str(contact): (float(station), float(force[0]))
        for contact, station, force in zip(
            data["contact_names"], data["contact_stations"], data["contact_forces"], strict=True
        )
        if str(contact).startswith(f"{name}.")
    }
    tip = of_finger.pop(f"{name}.tip", (0.0, 0.0))[1]
    middle = sorted(of_finger.values())
    backbone, base, pose = data[f"{name}.backbone"], data[f"{name}.base"], data["object.pose"]
    aim = RowAim(value=(*(force for _, force in middle), tip), weight=scene.goal.grasp_weight)
    touched = scene.object
    found = scene.replaced(
        grasp=None,
        finger=scene.finger.replaced(base=BasePose(position=(float(base[0]), float(base[1])), angle=float(base[2]))),
        object=touched and touched.replaced(position=(float(pose[0]), float(pose[1])), angle=float(pose[2])),
        contacts=tuple(at for at, _ in middle),
        goal=scene.goal.replaced(contact_force=aim),
    )
    tensions = np.clip(data[f"{name}.tensions"], *found.input_limits)
    return found, Hint(_bends(found, backbone), tensions)


def _numbers(scene: PlanScene, given: Any) -> Mapping[str, Any]:
    """Arrays of the grasp."""
    from continuum_grasp.grasp import optimize_grasp

    if isinstance(given, (str, os.PathLike)):
        from continuum_grasp.results import read_run

        run = read_run(given)
        if run.meta.get("kind") != "grasp" or run.meta.get("status") not in ("optimal", "feasible"):
            raise InputError("there is no verified grasp in this folder", file=os.fspath(given))
        return run.arrays
    if scene.grasp is None:
        return {}
    result = optimize_grasp(scene.grasp, raise_on_failure=False) if given is None else given
    if given is None and result.statistics["interrupted"]:
        raise Interrupted("interrupted while the grasp was optimized")
    if not result.solved:
        raise SolverError("no grasp to close to", status=str(result.status), advice=result.advice, result=result)
    arrays: Mapping[str, Any] = result.arrays
    return arrays


def _bends(scene: PlanScene, backbone: Array) -> Array:
    """Bending angles of the plan's elements in the grasp [rad]."""
    from continuum_grasp.control.prediction import Prediction

    lengths = Prediction(scene).system.finger_model.lengths
    edges = np.concatenate([[0.0], np.cumsum(lengths)])
    return np.diff(np.interp(edges, backbone[:, 0], np.unwrap(backbone[:, 3])))
