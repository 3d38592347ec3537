"""``continuum-grasp grasp``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from continuum_grasp.cli.options import Config, Json, Out, Quiet, Set, Verbose
from continuum_grasp.cli.output import Output, run_folder
from continuum_grasp.errors import SolverError

if TYPE_CHECKING:
    from continuum_grasp.grasp.values import Reason


def grasp(
    config: Config,
    out: Out = None,
    changes: Set = None,
    seed: Annotated[
        int | None,
        typer.Option("--seed", metavar="N", help="Seed of robust grasps' draws (default: as in the configuration)."),
    ] = None,
    pictures: Annotated[bool, typer.Option(help="Draw a picture and write the HTML report.")] = True,
    fine: Annotated[
        bool,
        typer.Option("--fine/--no-fine", help="Solve once more with a fine model and report what that changes."),
    ] = True,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Find how fingers hold an object, or why they cannot: verified, saved, drawn, reported."""
    from continuum_grasp.scene.grasp import GraspScene
    from continuum_grasp.scene.load import scene_of

    output = Output(as_json, quiet, verbose)
    seeding = [] if seed is None else [f"solver.random_seed={seed}"]
    scene = scene_of(config, GraspScene, [*(changes or ()), *seeding])
    folder = run_folder(out, config, "grasp")

    from continuum_grasp.grasp import optimize_grasp

    with output.busy("searching"):
        result = optimize_grasp(scene, raise_on_failure=False, fine=fine)
    with output.saving(folder):  # the grasp is safe before what can be computed again
        result.save(folder, quality=False)
    with output.drawing(folder):
        result.save(folder)
        files = result.save_pictures(folder) if pictures else []

    output.say(result.table())  # its first line is the verdict
    output.warn(result.warnings)
    if "fidelity" in result.statistics:
        output.say(f"fidelity: {result.statistics['fidelity']}")
    output.statistics(result.statistics)
    output.say(f"saved in {folder}" + "".join(f", {path.name}" for path in files))
    output.result(
        status=result.status,
        folder=folder,
        files=[folder / "result.yaml", *files],
        table=result.table(),
        warnings=result.warnings,
        reasons=[_numbers(r) for r in result.reasons],
        statistics=result.statistics,
    )
    if not result.solved:
        raise SolverError(result.message, status=result.status.value, result=result)


def _numbers(reason: Reason) -> dict[str, Any]:
    """The numbers of a reason, and of those that go with it."""
    own = {"name": reason.name, "key": reason.key, "limit": reason.limit, "needed": reason.needed}
    return own | ({"also": [_numbers(other) for other in reason.also]} if reason.also else {})
