"""What runs in a worker: a few scenes, one after the other, and a row for each whatever happens.

A Dask cluster may be the pool of workers.
"""

from __future__ import annotations

import copy
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from continuum_grasp.errors import ContinuumGraspError, InputError, SolverError
from continuum_grasp.scene.document import KeyPath, dotted
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.sweeps.plan import Point
from continuum_grasp.sweeps.quantities import SOLVED, encode, quantities
from continuum_grasp.workers import ExecutorPool

if TYPE_CHECKING:
    from continuum_grasp.grasp import GraspResult

Keep: TypeAlias = Literal["all", "failed", "none"]
_ONE_AT_A_TIME = threading.Lock()
_MESSAGE = 300
"""Characters of a message in the table: lines stay readable."""
_MEMORY = Path("/dev/shm")
"""Memory as a folder on Linux: files of a run are put together without touching a disk."""


@dataclass(frozen=True)
class Job:
    """What all scenes of a sweep share; travels with every chunk.

    Attributes
    ----------
    base : dict
        The scene as plain data.
    keys : tuple of str
        The varied keys, as the table names them.
    paths : tuple of tuple
        Where they lie in the scene.
    record : tuple of str
        Further columns of the table.
    keep : {"all", "failed", "none"}
        Of which runs files are wanted.
    evaluate : callable
        From a GraspScene to a GraspResult.
    """

    base: dict[str, Any]
    keys: tuple[str, ...]
    paths: tuple[KeyPath, ...]
    record: tuple[str, ...]
    keep: Keep
    evaluate: Callable[[GraspScene], Any]


@dataclass(frozen=True)
class Outcome:
    """What became of one scene: its line in the table, and the files of its run."""

    index: int
    status: str
    reason: str
    seconds: float
    line: bytes
    files: dict[str, bytes] = field(default_factory=dict)


def solve(scene: GraspScene) -> Any:
    """The grasp of a scene, or why there is none."""
    from continuum_grasp.grasp import optimize_grasp

    return optimize_grasp(scene, raise_on_failure=False)


def run_chunk(job: Job, points: Sequence[Point]) -> list[Outcome]:
    """Evaluate scenes; one at a time, also where a worker has several threads, since solvers share memory.

    Raises
    ------
    InputError
        A column is asked for that grasps do not have.
    OSError
        The files of a run could not be written where they are put together.
    """
    with _ONE_AT_A_TIME, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return [_run(job, point) for point in points]


def row_of_crash(job: Job, point: Point, message: str) -> Outcome:
    """The row of a scene that took its worker process with it, twice."""
    from continuum_grasp.results.plain import digest

    return _outcome(job, point, digest(scene_data(job, point))[:16], "crashed", "", message, None)


def _run(job: Job, point: Point) -> Outcome:
    from continuum_grasp.results.plain import digest

    data = scene_data(job, point)
    key = digest(data)[:16]
    began = time.perf_counter()
    try:
        scene = _scene(data)
    except InputError as error:
        return _outcome(job, point, key, "invalid", "", str(error), None)
    try:
        result = job.evaluate(scene)
    except Exception as error:
        seconds = time.perf_counter() - began
        status = "error"
        if isinstance(error, InputError):
            status = "invalid"
        elif isinstance(error, SolverError):
            status = error.status
        text = str(error) if isinstance(error, ContinuumGraspError) else f"{type(error).__name__}: {error}"
        return _outcome(job, point, key, status, "", text, {"seconds": float(f"{seconds:.6g}")})
    numbers = quantities(result, job.record)  # some are only computed when they are asked for
    numbers["seconds"] = float(f"{time.perf_counter() - began:.6g}")
    status = str(result.status)
    reason = result.reasons[0].name if result.reasons else ""
    wanted = job.keep == "all" or (job.keep == "failed" and status not in SOLVED)
    files = _files(result) if wanted else {}
    return _outcome(job, point, key, status, reason, result.message, numbers, files)


def scene_data(job: Job, point: Point) -> dict[str, Any]:
    """The scene of a point as plain data; shorter paths are set first."""
    data = copy.deepcopy(job.base)
    for path, value in sorted(zip(job.paths, point.values, strict=True), key=lambda pair: len(pair[0])):
        parent: Any = data
        for part in path[:-1]:
            child = parent.get(part) if isinstance(parent, dict) else parent[part]
            if child is None:
                child = {}
                parent[part] = child
            parent = child
        parent[path[-1]] = copy.deepcopy(value)
    return data


def _scene(data: dict[str, Any]) -> GraspScene:
    from pydantic import ValidationError

    from continuum_grasp.scene.problems import explain

    try:
        return GraspScene.model_validate(data)
    except ValidationError as error:
        problems = explain(error, GraspScene, data)
        texts = [f"{dotted(p.path)}: {p.message}" if p.path else p.message for p in problems]
        raise InputError("; ".join(texts)) from None


def _files(result: Any) -> dict[str, bytes]:
    """The files of a run, for who writes the table: of a grasp the one that holds everything."""
    from continuum_grasp.grasp import GraspResult

    if isinstance(result, GraspResult):
        from continuum_grasp.results.run_folder import RESULT, pack_run

        return {RESULT: pack_run(result.arrays, _meta(result))}
    with tempfile.TemporaryDirectory(dir=_MEMORY if _MEMORY.is_dir() else None) as folder:
        result.save(folder)
        return {file.name: file.read_bytes() for file in sorted(Path(folder).iterdir()) if file.is_file()}


def _meta(result: GraspResult) -> dict[str, Any]:
    """All about a result but what would first have to be computed: quality, stability and the model's error."""
    certificate = result.certificate
    return {
        "kind": "grasp",
        "config": result.scene.model_dump(mode="json"),
        "seed": result.scene.solver.random_seed,
        "status": result.status.value,
        "message": result.message,
        "certificate": None
        if certificate is None
        else {"passed": certificate.passed, "checks": [vars(check) for check in certificate.checks]},
        "violated": list(result.violated),
        "reasons": [vars(reason) for reason in result.reasons],
        "advice": result.advice,
        "statistics": dict(result.statistics),
    }


def _outcome(
    job: Job,
    point: Point,
    key: str,
    status: str,
    reason: str,
    message: str,
    numbers: dict[str, Any] | None,
    files: dict[str, bytes] | None = None,
) -> Outcome:
    text = " ".join(message.split())
    row = {
        "index": point.index,
        "scene": key,
        "values": dict(zip(job.keys, point.labels, strict=True)),
        "status": status,
        "reason": reason,
        "message": text if len(text) <= _MESSAGE else text[: _MESSAGE - 3] + "...",
        **(numbers or {}),
    }
    seconds = float((numbers or {}).get("seconds") or 0.0)
    return Outcome(point.index, status, reason, seconds, encode(row), files or {})


_PATIENCE = 10.0
"""How long to wait for an answer of the scheduler [s]."""
_ASK_AGAIN = 2.0
"""How long a count of workers is taken as current [s]: asking is a call over the network."""


@contextmanager
def dask_pool(address: str, patience: float = _PATIENCE) -> Iterator[ExecutorPool]:
    """The workers of a running Dask scheduler.

    Parameters
    ----------
    address : str
        Such as ``tcp://127.0.0.1:8786``.
    patience : float
        How long to wait for an answer [s].

    Raises
    ------
    InputError
        Dask is not installed, or no scheduler answers.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise InputError(
            "a Dask cluster needs the extra 'cluster': pip install 'continuum-grasp[cluster]'", key="scheduler"
        ) from None
    try:
        client: Any = distributed.Client(address, timeout=patience, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:  # TimeoutError is an OSError
        raise InputError(f"no Dask scheduler answers at {address!r}: {error}", key="scheduler") from None
    try:
        yield ExecutorPool(client.get_executor(pure=False), _Count(client))
    finally:
        client.close()


class _Count:
    """How many worker processes there are, asked every two seconds."""

    def __init__(self, client: Any) -> None:
        self._client, self._count, self._asked = client, 0, -_ASK_AGAIN

    def __call__(self) -> int:
        if time.monotonic() - self._asked > _ASK_AGAIN:
            self._count, self._asked = len(self._client.nthreads()), time.monotonic()
        return self._count
