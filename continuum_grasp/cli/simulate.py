"""``continuum-grasp simulate``."""

from __future__ import annotations

from continuum_grasp.cli.options import verb
from continuum_grasp.cli.output import Output
from continuum_grasp.errors import InputError


@verb("config", "out", "changes", "animation", "pictures", "as_json", "quiet", "verbose")
def simulate(output: Output) -> None:
    """Move a finger in time."""
    from continuum_grasp.scene.simulate import Scene

    scene: Scene = output.scene(Scene)
    if scene.time is None:
        raise InputError("a simulation needs time: {duration: ..., step: ...}", file=str(output.config), key="time")

    from continuum_grasp.verbs import simulate as run

    with output.computing("simulating") as report:
        trajectory = run(scene, progress=report)
    if note := trajectory.statistics.get("fidelity"):
        output.say(f"fidelity: {note}")
    files = output.save(trajectory)
    energy = (trajectory.kinetic + trajectory.potential)[[0, -1]]
    values = {
        "duration": trajectory.t[-1],
        "steps": len(trajectory.t) - 1,
        "tip": tuple(trajectory.tip[-1]),
        "energy": energy,
    }
    values |= {"time_error": trajectory.time_error, "space_error": trajectory.space_error}
    output.report(trajectory, files, **values)
