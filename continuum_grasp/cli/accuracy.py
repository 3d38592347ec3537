"""``continuum-grasp accuracy``."""

from __future__ import annotations

from continuum_grasp.cli.options import option, verb
from continuum_grasp.cli.output import Output


@verb("config", "out", "changes", "as_json", "quiet")
def accuracy(
    output: Output,
    most: int = option("Greatest number of elements.", "--elements", default=16, metavar="N", min=1, max=32),
) -> None:
    """Compare speed and error of every choice of model. A tolerance is answered with its choice."""
    from continuum_grasp.scene.simulate import Scene

    scene, folder = output.scene(Scene), output.folder
    output.check_folder()

    from continuum_grasp.accuracy.report import COUNTS, accuracy_report

    with output.busy("measuring") as report:
        comparison = accuracy_report(scene, counts=[count for count in COUNTS if count <= most], progress=report)
    pictures = output.save(comparison)
    files = [*(folder / text.name for text in comparison.texts), *pictures]
    output.say(comparison.markdown())
    output.say(f"saved in {folder}: {', '.join(file.name for file in files)}")
    output.result(choices=comparison.choices.as_dict(), folder=folder, files=files)
