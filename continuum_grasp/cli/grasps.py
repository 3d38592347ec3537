"""``continuum-grasp grasp``."""

from __future__ import annotations

from dataclasses import replace

from continuum_grasp.base import SolverError
from continuum_grasp.cli.options import option, run_verb
from continuum_grasp.cli.output import Output


@run_verb(pictures="Draw a picture and write the HTML report.")
def grasp(
    output: Output,
    seed: int | None = option("Seed of robust grasps' draws (default: as in the configuration).", metavar="N"),
    fine: bool = option(
        "Solve once more with a fine model and report what that changes.", "--fine/--no-fine", default=True
    ),
) -> None:
    """Find how fingers hold an object, or why they cannot."""
    from continuum_grasp.scene import GraspScene, HandScene

    seeding = [] if seed is None else [f"solver.random_seed={seed}"]
    output = replace(output, changes=[*(output.changes or ()), *seeding])
    scene = output.scene(GraspScene, HandScene)
    output.check_folder()

    from continuum_grasp.grasp import optimize_grasp

    with output.busy("searching") as report:
        result = optimize_grasp(
            scene, raise_on_failure=False, fine=fine, progress=lambda text: report(None, f"searching, {text}")
        )
    with output.saving():  # the grasp is safe before what can be computed again
        result.save(output.folder, quality=False)
    with output.drawing():
        result.save(output.folder)
        files = output.drawn(result) if output.pictures else []

    output.say(result.table())  # its first line is the verdict
    output.warn(result.warnings)
    output.conclude(result, files, table=result.table(), reasons=[reason.numbers for reason in result.reasons])
    if not result.solved:
        raise SolverError(result.message, status=result.status.value, result=result)
