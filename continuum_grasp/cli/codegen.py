"""``continuum-grasp codegen``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from continuum_grasp.cli.options import Config, Json, Quiet, Set, out_option
from continuum_grasp.cli.output import Output, run_folder

__all__ = ["codegen"]


def codegen(
    config: Config,
    out: Annotated[
        Path | None,
        out_option("Folder for the files (default: runs/codegen/NAME-OF-CONFIG); they are replaced."),
    ] = None,
    changes: Set = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Write the finger's equations as C, with an example that calls them."""
    from continuum_grasp.cli.scenes import simulation_scene

    output = Output(as_json, quiet)
    scene, _ = simulation_scene(config, changes, output)
    folder = run_folder(out, config, "codegen")

    from continuum_grasp.core import codegen as write
    from continuum_grasp.model import FingerModel
    from continuum_grasp.simulation import initial_state
    from continuum_grasp.simulation.signals import Signals
    from continuum_grasp.simulation.spectrum import stable_steps

    with output.busy("generating"):
        model, end = FingerModel(scene), scene.time.duration if scene.time else 0.0
        signals = Signals(scene, model)
        x0, u, w = initial_state(scene, model), signals.u(end)[0], signals.w(end)[0]
        files = write(model, folder, x0=x0, u=u, w=w, steps=max(1000, stable_steps(model, x0, u, w)))
    for file in files:
        output.say(str(file))
    output.result(folder=str(folder), files=[str(file) for file in files])
