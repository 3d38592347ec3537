"""``continuum-grasp simulate``."""

from __future__ import annotations

from continuum_grasp.cli.options import Animate, Config, Json, Out, Pictures, Quiet, Set, Verbose
from continuum_grasp.cli.output import Output, run_folder
from continuum_grasp.errors import InputError


def simulate(
    config: Config,
    out: Out = None,
    changes: Set = None,
    animation: Animate = None,
    pictures: Pictures = True,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Move a finger in time: saves the motion, draws pictures."""
    from continuum_grasp.scene.load import scene_of
    from continuum_grasp.scene.simulate import Scene

    output = Output(as_json, quiet, verbose)
    scene = scene_of(config, Scene, changes or ())
    if scene.time is None:
        raise InputError("a simulation needs time: {duration: ..., step: ...}", file=str(config), key="time")
    folder = run_folder(out, config, "simulate")

    from continuum_grasp.verbs import simulate as run

    with output.computing("simulating", folder) as report:
        trajectory = run(scene, progress=report)
    if note := trajectory.statistics.get("fidelity"):
        output.say(f"fidelity: {note}")
    files = output.save(trajectory, folder, pictures, animation)
    energy = (trajectory.kinetic + trajectory.potential)[[0, -1]]
    values = {
        "duration": trajectory.t[-1],
        "steps": len(trajectory.t) - 1,
        "tip": tuple(trajectory.tip[-1]),
        "energy": energy,
    }
    values |= {"time_error": trajectory.time_error, "space_error": trajectory.space_error}
    output.report(trajectory, folder, files, **values)
