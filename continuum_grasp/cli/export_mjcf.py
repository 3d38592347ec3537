"""``continuum-grasp export-mjcf``."""

from __future__ import annotations

from typing import Annotated

import typer

from continuum_grasp.cli.options import out_option, verb
from continuum_grasp.cli.output import Output

_OUT = out_option("File to write (default: runs/export-mjcf/NAME-OF-CONFIG.xml); an earlier one is replaced.", "FILE")


@verb("config", "out", "changes", "as_json", "quiet", out=_OUT)
def export_mjcf(
    output: Output,
    hinges: Annotated[int, typer.Option("--hinges", metavar="N", help="How many hinges the finger has.")] = 40,
) -> None:
    """Write a finger as a chain of hinges for MuJoCo, with its tendons and the scene's loads."""
    from continuum_grasp.export import export_mjcf as write
    from continuum_grasp.scene.simulate import Scene

    scene = output.scene(Scene)
    with output.busy("writing the chain"):
        chain = write(scene, output.named(".xml"), hinges=hinges)
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
