"""``continuum-grasp compare``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from continuum_grasp.cli.options import verb
from continuum_grasp.cli.output import Output

if TYPE_CHECKING:
    from continuum_grasp.identification.comparison import Predicted
    from continuum_grasp.scene.simulate import Scene


@verb("config", "out", "changes", "pictures", "as_json", "quiet", "verbose")
def compare(
    output: Output,
    data: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[DATA...]", help="Tables of measurements, or folders; none: those that CONFIG names."),
    ] = None,
) -> None:
    """Compare a simulation with measurements. Nothing is estimated."""
    from continuum_grasp.scene.simulate import Scene

    compared(output.scene(Scene), data, output)


def compared(scene: Scene, data: list[Path] | None, output: Output) -> None:
    """Compare a scene with measurements, and save that."""
    output.check_folder()

    from continuum_grasp.identification import compare as run
    from continuum_grasp.identification.read import located

    paths = list(data or located(scene, output.config.parent))
    with output.busy("comparing") as report:
        prediction = run(scene, paths, progress=report)
    files = output.save(prediction)
    show_channels(prediction, output)
    output.warn(prediction.warnings)
    output.pairs(output.saved_in(files))
    output.conclude(prediction, files, **prediction.details())


def show_channels(predicted: Predicted, output: Output) -> None:
    """Print the errors of each channel."""
    from continuum_grasp.identification.comparison import HEADINGS

    output.table(HEADINGS, *(channel.texts for channel in predicted.channels))
