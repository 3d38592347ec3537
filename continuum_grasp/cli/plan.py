"""``continuum-grasp plan``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from continuum_grasp.cli.options import named_path, verb
from continuum_grasp.cli.output import Output
from continuum_grasp.errors import SolverError


@verb("config", "out", "changes", "animation", "pictures", "as_json", "quiet", "verbose")
def plan(
    output: Output,
    warm: Annotated[
        Path | None,
        typer.Option("--warm", metavar="DIR", parser=named_path, help="Run folder of a plan from which to begin."),
    ] = None,
    grasp: Annotated[
        Path | None,
        typer.Option(
            "--grasp", metavar="DIR", parser=named_path, help="Run folder of the grasp that is to be carried out."
        ),
    ] = None,
    speed: Annotated[
        float, typer.Option("--speed", metavar="S", help="Seconds of motion per second of animation.")
    ] = 0.1,
) -> None:
    """Plan a whole motion to a goal: least time, least effort, smoothest input, tracking."""
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
