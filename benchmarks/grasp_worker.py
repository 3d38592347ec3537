"""Solves the grasp scenes that it reads, one JSON document a line, and writes a line of JSON on each.

Started by ``benchmarks.grasp_populations`` with the source tree that is measured first on the path; imports no other
part of the benchmarks, which belong to another tree.
"""

from __future__ import annotations

import functools
import json
import os
import resource
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any


def main() -> None:
    """Answer lines until there are none."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # solvers print

    import continuum_grasp as cg

    print(
        json.dumps({"source": str(Path(cg.__file__).parents[1]), "version": cg.__version__}), file=answers, flush=True
    )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.yaml"
        for line in sys.stdin:  # until the benchmark ends
            task = json.loads(line)
            file.write_text(json.dumps(task["document"]), encoding="utf-8")  # JSON is YAML
            print(json.dumps(solved(file, task)), file=answers, flush=True)


def solved(file: Path, task: dict[str, Any]) -> dict[str, Any]:
    """What becomes of a scene; errors are an outcome."""
    import continuum_grasp as cg

    try:
        scene = cg.load(file)
        if task["fresh"]:
            forget_structures()
        signal.signal(signal.SIGPROF, signal.SIG_DFL)  # ends the process, inside of a solver too
        signal.setitimer(signal.ITIMER_PROF, task["limit"])
        children, began = _children(), time.process_time()
        result = cg.optimize_grasp(scene, raise_on_failure=False)
        row = {"cpu": time.process_time() - began, "compilers": _children() - children}
        # Twice the time for what is computed after the search, which none of the figures contains.
        signal.setitimer(signal.ITIMER_PROF, 2.0 * task["limit"])
        return row | _summary(result)
    except Exception as error:
        text = f"{type(error).__name__}: {error}"
        return {"status": "error", "message": " ".join(text.split())[:400]}
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def _summary(result: Any) -> dict[str, Any]:
    """Status, tensions, certificate and exact rods of a result."""
    statistics, certificate = result.statistics, result.certificate
    row = {
        "status": result.status.value,
        "message": result.message[:400],
        "build": statistics.get("build_seconds"),
        "iterations": statistics.get("total_iterations"),
        "reasons": [reason.text[:200] for reason in result.reasons[:4]],
    }
    if result.verified:
        tensions = [float(pull) for finger in result.fingers.values() for pull in finger.tensions]
        row |= {"total": sum(tensions), "greatest": max(tensions), "warnings": len(result.warnings)}
        row["elements"] = max(len(finger.lengths) for finger in result.fingers.values())
    if result.verified and certificate is not None:
        row |= {"passed": certificate.passed, "stable": certificate.stable}
        row["deviation"] = max((error.displacement for error in result.element_errors.values()), default=None)
    return row


def forget_structures() -> None:
    """Empty what this process remembers of the structures of grasp problems, but for compiled kernels."""
    for name, module in list(sys.modules.items()):
        if name.startswith("continuum_grasp.grasp") and "kernel" not in name:
            for value in list(vars(module).values()):
                if isinstance(value, functools._lru_cache_wrapper) and "kernel" not in value.__module__:
                    value.cache_clear()


def _children() -> float:
    """Processor time of processes that this one has started and that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
