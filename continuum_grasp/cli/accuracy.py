"""``continuum-grasp accuracy``."""

from __future__ import annotations

from typing import Annotated

import typer

from continuum_grasp.cli.options import Config, Json, Out, Quiet, Set
from continuum_grasp.cli.output import Output, run_folder


def accuracy(
    config: Config,
    out: Out = None,
    changes: Set = None,
    most: Annotated[
        int, typer.Option("--elements", metavar="N", min=1, max=32, help="Greatest number of elements.")
    ] = 16,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Speed against error of every choice of model, and what a tolerance would choose."""
    from continuum_grasp.scene.load import scene_of
    from continuum_grasp.scene.simulate import Scene

    output = Output(as_json, quiet)
    scene = scene_of(config, Scene, changes or ())
    folder = run_folder(out, config, "accuracy")

    from continuum_grasp.accuracy.report import COUNTS, accuracy_report

    with output.busy("measuring") as report:
        found = accuracy_report(scene, counts=[count for count in COUNTS if count <= most], progress=report)
    pictures = output.save(found, folder, pictures=True)
    files = [*(folder / text.name for text in found.texts), *pictures]
    output.say(found.markdown())
    output.say(f"saved in {folder}: {', '.join(file.name for file in files)}")
    output.result(tables=[table.as_dict() for table in found.tables], folder=folder, files=files)
