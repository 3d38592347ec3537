"""``continuum-grasp design``."""

from __future__ import annotations

from continuum_grasp.base import SolverError
from continuum_grasp.cli import Output, run_verb


@run_verb()
def design(output: Output) -> None:
    """Choose numbers of a finger or scene by gradient. The grasps of one or many objects become best."""
    from continuum_grasp.addons.design.optimize import optimize_design

    optimum, files = output.run(
        "designing",
        lambda report: optimize_design(
            output.config, progress=report, raise_on_failure=False, overrides=output.changes or ()
        ),
    )
    output.report(optimum, files, set=optimum.values, **optimum.details())
    if not optimum.solved:
        raise SolverError(optimum.message, status=optimum.status.value, result=optimum)
