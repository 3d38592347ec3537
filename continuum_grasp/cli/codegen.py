"""``continuum-grasp codegen``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from continuum_grasp.cli.options import Config, Json, Quiet, Set
from continuum_grasp.cli.output import Output, run_folder

__all__ = ["codegen"]


def codegen(
    config: Config,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Folder for the files (default: NAME-OF-CONFIG_c); they are replaced.",
        ),
    ] = None,
    changes: Set = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Write the finger's equations as C, with an example that calls them."""
    from continuum_grasp.cli.scenes import simulation_scene

    output = Output(as_json, quiet)
    scene, _ = simulation_scene(config, changes, output)
    folder = run_folder(out if out is not None else Path(f"{config.stem}_c"), config)

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
