"""Work of a worker process: a few scenes, one after the other, and a row for each whatever happens."""

from __future__ import annotations

import math
import threading
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal, TypeAlias

from continuum_grasp.addons.sweeps.folder import SOLVED, encode
from continuum_grasp.addons.sweeps.plan import SweepPoint
from continuum_grasp.base import ContinuumGraspError, InputError, SolverError, clipped
from continuum_grasp.results import Run
from continuum_grasp.scene import GraspScene, HandScene, KeyPath, kinds

Keep: TypeAlias = Literal["all", "failed", "none"]
_ONE_AT_A_TIME = threading.Lock()
"""Solvers share memory, so that the threads of a worker take turns."""


@dataclass(frozen=True)
class Job:
    """Data that all scenes of a sweep share; they travel with every chunk."""

    kind: str
    """Kind of the scene."""
    base: dict[str, Any]
    """The scene as plain data."""
    keys: tuple[str, ...]
    """The varied keys, as the table names them."""
    paths: tuple[KeyPath, ...]
    """Paths of the varied keys in the scene."""
    record: tuple[str, ...]
    """Further columns of the table."""
    keep: Keep
    """Runs whose files are wanted."""
    evaluate: Callable[[Any], Any]
    """Function that computes the result of a scene."""


@dataclass(frozen=True)
class SceneOutcome:
    """Outcome of one scene: its line in the table, and the file of its run."""

    index: int
    status: str
    seconds: float
    line: bytes
    run: bytes = b""


def solve(scene: GraspScene | HandScene) -> Any:
    from continuum_grasp.grasp import optimize_grasp

    return optimize_grasp(scene, raise_on_failure=False)


def run_chunk(job: Job, points: Sequence[SweepPoint]) -> list[SceneOutcome]:
    """Evaluate scenes, one at a time. Raises an InputError where a column is asked for that grasps do not have."""
    with _ONE_AT_A_TIME, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # thousands of rows would repeat them
        return [_run(job, point) for point in points]


def row_of_crash(job: Job, point: SweepPoint, message: str) -> SceneOutcome:
    """The row of a scene that took its worker process with it, twice."""
    return _outcome(job, point, point.scene_data(job.base, job.paths), "crashed", message)


def _run(job: Job, point: SweepPoint) -> SceneOutcome:
    data = point.scene_data(job.base, job.paths)
    began = time.perf_counter()
    result = None
    numbers = dict[str, Any]()
    try:
        result = job.evaluate(kinds()[job.kind].scene_class(**data))
    except ContinuumGraspError as error:
        kind = "invalid" if isinstance(error, InputError) else "error"
        status = error.status if isinstance(error, SolverError) else kind
        message = str(error)
    except Exception as error:
        status = "error"
        message = f"{type(error).__name__}: {error}"
    else:
        # Some numbers are only computed when they are asked for: their time counts.
        status = str(result.status)
        message = result.message
        numbers = quantities(result, job.record)
    numbers["seconds"] = float(f"{time.perf_counter() - began:.6g}")
    reason = result.reasons[0].title if result is not None and result.reasons else ""
    wanted = result is not None and (job.keep == "all" or (job.keep == "failed" and status not in SOLVED))
    return _outcome(job, point, data, status, message, numbers, reason, _packed(result) if wanted else b"")


def _outcome(
    job: Job,
    point: SweepPoint,
    data: dict[str, Any],
    status: str,
    message: str,
    numbers: Mapping[str, Any] = MappingProxyType({}),
    reason: str = "",
    run: bytes = b"",
) -> SceneOutcome:
    row = {
        "index": point.index,
        "scene": Run.digest(data)[:16],
        "values": dict(zip(job.keys, point.labels, strict=True)),
        "status": status,
        "reason": reason,
        # 300: characters of a message in the table: lines stay readable
        "message": clipped(message, 300),
        **numbers,
    }
    return SceneOutcome(point.index, status, float(numbers.get("seconds", 0.0)), encode(row), run)


def _packed(result: Any) -> bytes:
    """The file of a run, for who writes the table; it holds everything."""
    # Without warnings, which the model's error is among: exact rods take some tens of milliseconds.
    meta = {"kind": result.kind, "config": result.scene.model_dump(mode="json"), "status": result.status}
    meta |= {"statistics": dict(result.statistics), **result.details(quality=False)}
    return Run.pack(result.stored_arrays(), meta)


def quantities(result: Any, record: Sequence[str]) -> dict[str, Any]:
    """Numbers of a result by column, ``record`` included; None where there is no grasp to have them.

    A name that grasps do not have raises an InputError.
    """
    solved = str(result.status) in SOLVED
    reason = result.reasons[0] if result.reasons else None
    tensions = [float(t) for finger in result.fingers.values() for t in finger.tensions] if solved else []
    contacts = result.contacts if solved else ()
    numbers = {
        "tension_sum": sum(tensions) if solved else None,
        "tension_max": max(tensions, default=None),
        "normal_force_max": max((c.normal_force for c in contacts), default=None),
        "friction_margin": min((c.friction_margin for c in contacts), default=None),
        "contacts": len(contacts) if solved else None,
        "iterations": result.statistics.get("iterations"),
        "reason_limit": None if reason is None else reason.limit,
        "reason_needed": None if reason is None else reason.needed,
        **{name: _recorded(result, name, solved) for name in record},
    }
    return {name: _number(value) for name, value in numbers.items()}


def _number(value: Any) -> float | int | str | None:
    """A value as it may stand in a row: None for nothing, NaN and infinity, which JSON does not have."""
    value = value.item() if hasattr(value, "item") else value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return int(value) if isinstance(value, bool) else value


def _recorded(result: Any, name: str, solved: bool) -> Any:
    root, *parts = name.split(".")
    # Without a grasp, reading the quality raises; other results than those of `optimize_grasp` have no ``solved``.
    value = None if root == "quality" and not getattr(result, "solved", True) else getattr(result, root)
    for part in parts:
        if value is None:
            return None
        known = part in value if isinstance(value, Mapping) else hasattr(value, part)
        if not known:
            if not solved:  # what failed early has no certificate, and few statistics
                return None
            there = value if isinstance(value, Mapping) else [n for n in dir(value) if not n.startswith("_")]
            raise InputError(f"a grasp has no number of this name: {part!r} is not one of {', '.join(there)}", key=name)
        value = value[part] if isinstance(value, Mapping) else getattr(value, part)
    if value is None or isinstance(value, str | int | float) or getattr(value, "ndim", 1) == 0:
        return value
    raise InputError(f"expected one number, got {type(value).__name__}", key=name)
