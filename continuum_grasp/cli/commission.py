"""``continuum-grasp commission``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from continuum_grasp.cli.options import verb
from continuum_grasp.cli.output import FAILED, Output
from continuum_grasp.errors import InputError


@verb("config", "out", "changes", "pictures", "as_json", "quiet", "verbose")
def commission(
    output: Output,
    log: Annotated[
        Path | None,
        typer.Argument(metavar="[LOG]", help="Table of commands and readings (CSV); none: plan the commands."),
    ] = None,
    plant: Annotated[
        bool, typer.Option("--plant", help="Play the plan on the configuration's simulated plant, and read its log.")
    ] = False,
    duration: Annotated[float, typer.Option("--duration", help="Duration of the plan [s].")] = 10.0,
    reach: Annotated[float, typer.Option("--reach", help="Share of bending range and tensions that is used.")] = 0.6,
) -> None:
    """Find how a bench is mounted and connected.

    Camera, order, signs and zeros of drives and load cells, lag and delay.

    Without LOG it writes the commands that a bench plays; with one, the corrected configuration. Exit status 1 where
    the log does not tell all.
    """
    from continuum_grasp.scene.control import ControlScene

    scene = output.scene(ControlScene)
    if plant and log is not None:
        raise InputError("--plant plays the plan itself: give no LOG, or no --plant")

    from continuum_grasp.cli.identify import show_parameters, show_plan
    from continuum_grasp.identification.commissioning import commission as run
    from continuum_grasp.identification.commissioning import design_commissioning

    if log is None and not plant:
        design = replace(output, verb="experiments")
        show_plan(lambda _: design_commissioning(scene, duration=duration, reach=reach), design)
        return
    output.check_folder()
    with output.busy("commissioning") as report:
        commissioning = run(scene, log, duration=duration, reach=reach, progress=report)
    files = output.save(commissioning)
    output.pairs(
        {
            "status": commissioning.status,
            **{f"way {k}": alternative.what for k, alternative in enumerate(commissioning.alternatives, 1)},
        }
    )
    show_parameters(commissioning, files, output)
    output.warn(commissioning.undetermined)
    if not commissioning.usable:
        raise typer.Exit(FAILED)
