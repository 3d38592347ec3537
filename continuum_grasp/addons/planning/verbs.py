"""``continuum-grasp plan``."""

from __future__ import annotations

from pathlib import Path

from continuum_grasp.base import SolverError
from continuum_grasp.cli import Output, option, run_verb


@run_verb("animation")
def plan(
    output: Output,
    warm: Path | None = option("Run folder of a plan to start from.", metavar="DIR"),
    grasp: Path | None = option("Run folder of the grasp to carry out.", metavar="DIR"),
    speed: float = option("Seconds of motion per second of animation.", default=0.1, metavar="S"),
) -> None:
    """Plan a whole motion to a goal. Costs: time, effort, smoothness, tracking."""
    from continuum_grasp.addons.planning.scene import PlanScene

    scene = output.scene(PlanScene)

    from continuum_grasp.addons.planning.solve import plan as run

    motion, files = output.run("planning", lambda _: run(scene, warm=warm, grasp=grasp, raise_on_failure=False), speed)
    output.report(
        motion,
        files,
        {f"{name} [s]": f"{value:.3f}" for name, value in motion.times.items()},
        duration=motion.duration,
        tip=tuple(motion.tip[-1]),
        active=motion.active_constraints,
        **motion.details(),
    )
    if motion.status not in ("optimal", "feasible"):
        raise SolverError(
            motion.message, status=motion.status.value, violated=motion.violated, advice=motion.advice, result=motion
        )
