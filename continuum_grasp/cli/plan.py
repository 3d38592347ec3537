"""``continuum-grasp plan``."""

from __future__ import annotations

from pathlib import Path

from continuum_grasp.cli.options import named_path, option, verb
from continuum_grasp.cli.output import Output
from continuum_grasp.errors import SolverError


@verb("config", "out", "changes", "animation", "pictures", "as_json", "quiet", "verbose")
def plan(
    output: Output,
    warm: Path | None = option("Run folder of a plan from which to begin.", metavar="DIR", parser=named_path),
    grasp: Path | None = option("Run folder of the grasp that is to be carried out.", metavar="DIR", parser=named_path),
    speed: float = option("Seconds of motion per second of animation.", default=0.1, metavar="S"),
) -> None:
    """Plan a whole motion to a goal. Costs: time, effort, smoothness, tracking."""
    from continuum_grasp.scene.plan import PlanScene

    scene = output.scene(PlanScene)

    from continuum_grasp.planning import plan as run

    with output.computing("planning"):
        found = run(scene, warm=warm, grasp=grasp, raise_on_failure=False)
    files = output.save(found, speed)
    output.report(
        found,
        files,
        {f"{name} [s]": f"{value:.3f}" for name, value in found.times.items()},
        objective=found.objective,
        duration=found.duration,
        tip=tuple(found.tip[-1]),
        active=found.active_constraints,
        iterations=found.iterations,
        times=found.times,
        violated=found.violated,
        advice=found.advice,
    )
    if found.status not in ("optimal", "feasible"):
        raise SolverError(
            found.message, status=found.status.value, violated=found.violated, advice=found.advice, result=found
        )
