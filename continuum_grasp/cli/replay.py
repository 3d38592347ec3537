"""``continuum-grasp replay``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from continuum_grasp.cli.options import verb
from continuum_grasp.cli.output import FAILED, Output


@verb("config", "out", "changes", "pictures", "as_json", "quiet", "verbose")
def replay(
    output: Output,
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Table of instants, measurements and commands (CSV).")],
) -> None:
    """Run a log through estimator, supervisor and controller.

    Names the sensor that disagrees, and noise, delay and lag of the log. Exit status 1 if sensors and model disagree.
    """
    from continuum_grasp.scene.control import ControlScene

    scene = output.scene(ControlScene)
    output.check_folder()

    from continuum_grasp.cli.compare import show_channels
    from continuum_grasp.identification.replayed import replay as run

    with output.busy("replaying") as report:
        prediction = run(scene, log, progress=report)
    files = output.save(prediction)
    show_channels(prediction, output)
    output.say("")
    output.report(prediction, files, **prediction.details())
    if prediction.status != "consistent":
        raise typer.Exit(FAILED)
