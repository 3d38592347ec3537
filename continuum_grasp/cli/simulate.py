"""``continuum-grasp simulate``."""

from __future__ import annotations

from dataclasses import replace

from continuum_grasp.cli.options import Animate, Config, Json, Out, Pictures, Quiet, Set, Verbose, simulation_scene
from continuum_grasp.cli.output import Output, run_folder, saved_in
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
    output = Output(as_json, quiet, verbose)
    scene, note = simulation_scene(config, changes, output)
    if scene.time is None:
        raise InputError("a simulation needs time: {duration: ..., step: ...}", file=str(config), key="time")
    folder = run_folder(out, config, "simulate")

    from continuum_grasp.simulation import simulate as run

    with output.computing("simulating", folder) as report:
        trajectory = run(scene, progress=report)
    if note:
        trajectory = replace(trajectory, statistics={**trajectory.statistics, "fidelity": note})
    files = output.save(trajectory, folder, pictures, animation)
    energy = (trajectory.kinetic + trajectory.potential)[[0, -1]]
    x, y = trajectory.tip[-1]
    error, steps = trajectory.time_error, len(trajectory.t) - 1
    output.warn(trajectory.warnings)
    output.pairs({"status": trajectory.status, **trajectory.pairs(), **saved_in(folder, files)})
    values = {"duration": trajectory.t[-1], "steps": steps, "tip": (x, y), "time_error": error, "energy": energy}
    output.conclude(trajectory, folder, files, **values)
