"""``continuum-grasp grasp``."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import typer

from continuum_grasp.cli.options import option, verb
from continuum_grasp.cli.output import Output
from continuum_grasp.errors import SolverError

if TYPE_CHECKING:
    from continuum_grasp.grasp.values import Reason


_PICTURES = typer.Option("--pictures/--no-pictures", help="Draw a picture and write the HTML report.")


@verb("config", "out", "changes", "pictures", "as_json", "quiet", "verbose", pictures=_PICTURES)
def grasp(
    output: Output,
    seed: int | None = option("Seed of robust grasps' draws (default: as in the configuration).", metavar="N"),
    fine: bool = option(
        "Solve once more with a fine model and report what that changes.", "--fine/--no-fine", default=True
    ),
) -> None:
    """Find how fingers hold an object, or why they cannot."""
    from continuum_grasp.scene.grasp import GraspScene

    seeding = [] if seed is None else [f"solver.random_seed={seed}"]
    output = replace(output, changes=[*(output.changes or ()), *seeding])
    scene, folder = output.scene(GraspScene), output.folder
    output.check_folder()

    from continuum_grasp.grasp import optimize_grasp

    with output.busy("searching") as report:
        result = optimize_grasp(
            scene, raise_on_failure=False, fine=fine, progress=lambda text: report(None, f"searching, {text}")
        )
    with output.saving():  # the grasp is safe before what can be computed again
        result.save(folder, quality=False)
    with output.drawing():
        result.save(folder)
        files = output.drawn(result) if output.pictures else []

    output.say(result.table())  # its first line is the verdict
    output.warn(result.warnings)
    if "fidelity" in result.statistics:
        output.say(f"fidelity: {result.statistics['fidelity']}")
    output.say(f"saved in {folder}" + "".join(f", {path.name}" for path in files))
    written = [folder / "result.yaml", *files]
    output.conclude(result, written, table=result.table(), reasons=[_numbers(reason) for reason in result.reasons])
    if not result.solved:
        raise SolverError(result.message, status=result.status.value, result=result)


def _numbers(reason: Reason) -> dict[str, Any]:
    """The numbers of a reason, and of those that go with it."""
    numbers = {"name": reason.name, "key": reason.key, "limit": reason.limit, "needed": reason.needed}
    return numbers | ({"also": [_numbers(other) for other in reason.also]} if reason.also else {})
