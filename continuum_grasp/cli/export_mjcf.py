"""``continuum-grasp export-mjcf``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from continuum_grasp.cli.options import Config, Json, Quiet, Set, out_option
from continuum_grasp.cli.output import Output


def export_mjcf(
    config: Config,
    out: Annotated[
        Path | None,
        out_option("File to write (default: runs/export-mjcf/NAME-OF-CONFIG.xml); an earlier one is replaced.", "FILE"),
    ] = None,
    hinges: Annotated[int, typer.Option("--hinges", metavar="N", help="How many hinges the finger has.")] = 40,
    changes: Set = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Write a finger as a chain of hinges for MuJoCo, with its tendons and the scene's loads."""
    from continuum_grasp.export import export_mjcf as write
    from continuum_grasp.scene.load import scene_of
    from continuum_grasp.scene.simulate import Scene

    output = Output(as_json, quiet)
    scene = scene_of(config, Scene, changes or ())
    with output.busy("writing the chain"):
        chain = write(scene, out if out is not None else Path("runs/export-mjcf") / f"{config.stem}.xml", hinges=hinges)
    output.warn(f"differs: {text}" for text in chain.differences)
    output.pairs(
        {
            "written": ", ".join(map(str, chain.files)),
            "hinges": chain.hinges,
            "controls": ", ".join(chain.control_names) or "none",
            "first frequency": f"{chain.first_frequency:.6g} Hz, straight and unloaded",
            "timestep": f"{chain.timestep:g} s",
        }
    )
    output.result(
        files=chain.files,
        hinges=chain.hinges,
        controls=chain.control_names,
        first_frequency_hz=chain.first_frequency,
        timestep_s=chain.timestep,
        differences=chain.differences,
    )
