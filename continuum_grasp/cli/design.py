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
        optimum = optimize_design(
            output.config, progress=report, raise_on_failure=False, overrides=output.changes or ()
        )
    files = output.save(optimum)
    output.report(
        optimum,
        files,
        set=optimum.values,
        cost=None if optimum.best is None else optimum.best.cost,
        cases=optimum.cases,
        influences=[vars(influence) for influence in optimum.influences],
        active=optimum.active,
    )
    if not optimum.solved:
        raise SolverError(optimum.message, status=optimum.status.value, result=optimum)
