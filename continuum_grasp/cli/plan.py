"""``continuum-grasp plan``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from continuum_grasp.cli.options import Animate, Config, Json, Out, Pictures, Quiet, Set, Verbose, named_path
from continuum_grasp.cli.output import Output, run_folder
from continuum_grasp.errors import SolverError


def plan(
    config: Config,
    out: Out = None,
    changes: Set = None,
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
    animation: Animate = None,
    speed: Annotated[
        float, typer.Option("--speed", metavar="S", help="Seconds of motion per second of animation.")
    ] = 0.1,
    pictures: Pictures = True,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Plan a whole motion to a goal: least time, least effort, smoothest input, tracking."""
    from continuum_grasp.scene.load import scene_of
    from continuum_grasp.scene.plan import PlanScene

    output = Output(as_json, quiet, verbose)
    scene = scene_of(config, PlanScene, changes or ())
    folder = run_folder(out, config, "plan")

    from continuum_grasp.planning import plan as run

    with output.computing("planning", folder):
        found = run(scene, warm=warm, grasp=grasp, raise_on_failure=False)
    files = output.save(found, folder, pictures, animation, speed)
    output.report(
        found,
        folder,
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
