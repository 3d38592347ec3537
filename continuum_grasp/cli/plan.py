"""``continuum-grasp plan``."""

from __future__ import annotations

from pathlib import Path

from continuum_grasp.cli.options import named_path, option, verb
from continuum_grasp.cli.output import Output
from continuum_grasp.errors import SolverError


@verb("config", "out", "changes", "animation", "pictures", "as_json", "quiet", "verbose")
def plan(
    output: Output,
    warm: Path | None = option("Run folder of a plan from which to begin.", metavar="DIR", parser=named_path),
    grasp: Path | None = option("Run folder of the grasp that is to be carried out.", metavar="DIR", parser=named_path),
    speed: float = option("Seconds of motion per second of animation.", default=0.1, metavar="S"),
) -> None:
    """Plan a whole motion to a goal. Costs: time, effort, smoothness, tracking."""
    from continuum_grasp.scene.plan import PlanScene

    scene = output.scene(PlanScene)

    from continuum_grasp.planning import plan as run

    with output.computing("planning"):
        motion = run(scene, warm=warm, grasp=grasp, raise_on_failure=False)
    files = output.save(motion, speed)
    output.report(
        motion,
        files,
        {f"{name} [s]": f"{value:.3f}" for name, value in motion.times.items()},
        objective=motion.objective,
        duration=motion.duration,
        tip=tuple(motion.tip[-1]),
        active=motion.active_constraints,
        iterations=motion.iterations,
        times=motion.times,
        violated=motion.violated,
        advice=motion.advice,
    )
    if motion.status not in ("optimal", "feasible"):
        raise SolverError(
            motion.message, status=motion.status.value, violated=motion.violated, advice=motion.advice, result=motion
        )
