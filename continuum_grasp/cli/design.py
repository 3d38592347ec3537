"""``continuum-grasp design``."""

from __future__ import annotations

from continuum_grasp.cli.options import Config, Json, Out, Pictures, Quiet, Set, Verbose
from continuum_grasp.cli.output import Output, run_folder
from continuum_grasp.errors import SolverError


def design(
    config: Config,
    out: Out = None,
    changes: Set = None,
    pictures: Pictures = True,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Choose numbers of a finger or scene by gradient, so that the grasps of one or many objects are best."""
    output = Output(as_json, quiet, verbose)
    folder = run_folder(out, config, "design")

    from continuum_grasp.design import optimize_design

    with output.computing("designing", folder) as report:
        found = optimize_design(config, progress=report, raise_on_failure=False, overrides=changes or ())
    files = output.save(found, folder, pictures)
    output.report(
        found,
        folder,
        files,
        set=found.values,
        cost=None if found.best is None else found.best.cost,
        cases=found.cases,
        influences=[vars(one) for one in found.influences],
        active=found.active,
    )
    if not found.solved:
        raise SolverError(found.message, status=found.status.value, result=found)
