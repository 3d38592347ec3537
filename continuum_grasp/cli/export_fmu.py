"""``continuum-grasp export-fmu``."""

from __future__ import annotations

from typing import Annotated

import typer

from continuum_grasp.cli.export_c import Ranges, Substeps, ranges_of
from continuum_grasp.cli.options import listed, out_option, verb
from continuum_grasp.cli.output import Output
from continuum_grasp.errors import InputError

_OUT = out_option("Folder of the FMUs (default: runs/export-fmu/NAME-OF-CONFIG); earlier ones are replaced.")


@verb("config", "out", "changes", "as_json", "quiet", out=_OUT)
def export_fmu(
    output: Output,
    what: Annotated[
        str | None,
        typer.Option("--what", metavar="PART,...", help="Of a closed loop plant, controller or both (default: both)."),
    ] = None,
    fmi: Annotated[str, typer.Option("--fmi", metavar="2|3|both", help="Version of the standard.")] = "both",
    name: Annotated[
        str | None, typer.Option("--name", metavar="NAME", help="Of files and symbols (default: that of CONFIG).")
    ] = None,
    step: Annotated[
        float | None,
        typer.Option("--step", metavar="SECONDS", help="Internal step of a simulated scene (default: the scene's)."),
    ] = None,
    substeps: Substeps = None,
    ranges: Ranges = None,
    preview: Annotated[
        bool, typer.Option("--preview", help="Give the controller setpoints of every stage of its horizon.")
    ] = False,
    binary: Annotated[
        bool, typer.Option("--binary/--no-binary", help="Add the binary of this machine to the sources.")
    ] = True,
) -> None:
    """Write a plant, or a controller with its estimator, as FMUs for Simulink, Dymola, OpenModelica and others."""
    if fmi not in ("2", "3", "both"):
        raise InputError(f"--fmi: expected 2, 3 or both, got {fmi!r:.60}")
    from continuum_grasp.export import export_fmu as write
    from continuum_grasp.export.fmu.write import identifier_of
    from continuum_grasp.scene.control import ControlScene
    from continuum_grasp.scene.simulate import Scene

    scene = output.scene(Scene, ControlScene)
    with output.busy("writing the FMUs"):
        units = write(
            scene,
            output.named(""),
            what=listed(what),
            fmi=("2", "3") if fmi == "both" else (fmi,),
            name=identifier_of(output.config, scene) if name is None else name,
            step=step,
            substeps=substeps,
            ranges=ranges_of(ranges or ()),
            preview=preview,
            binary=binary,
        )
    for unit in units:
        sizes = f"{len(unit.inputs)} inputs, {len(unit.outputs)} outputs, {len(unit.parameters)} parameters"
        output.pairs(
            {
                "written": unit.file,
                "internal step": f"{unit.step:g} s",
                "variables": sizes,
                "binary": unit.binary or "none, sources alone",
            }
        )
    output.result(
        units=[{f"{key}_s" if key == "step" else key: value for key, value in vars(u).items()} for u in units]
    )
