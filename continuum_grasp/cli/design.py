"""``continuum-grasp design``."""

from __future__ import annotations

from continuum_grasp.cli.options import verb
from continuum_grasp.cli.output import Output
from continuum_grasp.errors import SolverError


@verb("config", "out", "changes", "pictures", "as_json", "quiet", "verbose")
def design(output: Output) -> None:
    """Choose numbers of a finger or scene by gradient. The grasps of one or many objects become best."""
    from continuum_grasp.design import optimize_design

    with output.computing("designing") as report:
        found = optimize_design(output.config, progress=report, raise_on_failure=False, overrides=output.changes or ())
    files = output.save(found)
    output.report(
        found,
        files,
        set=found.values,
        cost=None if found.best is None else found.best.cost,
        cases=found.cases,
        influences=[vars(one) for one in found.influences],
        active=found.active,
    )
    if not found.solved:
        raise SolverError(found.message, status=found.status.value, result=found)
