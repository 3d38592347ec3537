"""``continuum-grasp simulate``."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from continuum_grasp.cli.options import Animate, Config, Json, Out, Quiet, Set, Verbose
from continuum_grasp.cli.output import Output, run_folder

if TYPE_CHECKING:
    from continuum_grasp.simulation import Trajectory


def simulate(
    config: Config,
    out: Out = None,
    changes: Set = None,
    animation: Animate = None,
    pictures: Annotated[bool, typer.Option("--pictures/--no-pictures", help="Draw pictures.")] = True,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Move a finger in time: saves the motion, draws pictures."""
    from continuum_grasp.cli.options import simulation_scene
    from continuum_grasp.errors import InputError

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
    files = output.save_motion(trajectory, folder, pictures, animation)
    _report(trajectory, folder, files, output)


def _report(trajectory: Trajectory, folder: Path, files: list[Path], output: Output) -> None:
    energy = trajectory.kinetic + trajectory.potential
    x, y = trajectory.tip[-1]
    statistics: dict[str, Any] = dict(getattr(trajectory, "statistics", {}))
    output.warn(trajectory.warnings)
    output.pairs(
        {
            "status": trajectory.status,
            "time": f"{trajectory.t[-1]:g} s in {len(trajectory.t) - 1} steps",
            "tip at the end": f"({x:.4f}, {y:.4f}) m",
            "time error": _time_error(trajectory),
            "energy": f"{energy[0]:.6g} J at the start, {energy[-1]:.6g} J at the end",
            "saved in": f"{folder}",
            "pictures": ", ".join(file.name for file in files) or "none",
        }
    )
    output.statistics(statistics)
    output.result(
        status=trajectory.status,
        folder=str(folder),
        files=[str(file) for file in files],
        duration=float(trajectory.t[-1]),
        steps=len(trajectory.t) - 1,
        tip=[float(x), float(y)],
        time_error=trajectory.time_error,
        energy=[float(energy[0]), float(energy[-1])],
        warnings=list(trajectory.warnings),
        statistics=statistics,
    )


def _time_error(trajectory: Trajectory) -> str:
    """The error that the steps in time leave, in words."""
    error = trajectory.time_error
    if not math.isfinite(error):
        return "not known"
    return f"about {error:.2g} of the length, {1e3 * error * trajectory.length:.2g} mm"
