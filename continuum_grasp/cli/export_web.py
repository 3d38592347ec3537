"""``continuum-grasp export-web``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from continuum_grasp.cli.options import Config, Json, Quiet, Set, out_option
from continuum_grasp.cli.output import Output


def export_web(
    config: Config,
    out: Annotated[
        Path | None,
        out_option("Page to write (default: runs/export-web/NAME-OF-CONFIG.html); an earlier one is replaced.", "FILE"),
    ] = None,
    changes: Set = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Write a page in which a finger, and its controller, run as WebAssembly: one file that needs no network."""
    from continuum_grasp.export import export_web as write
    from continuum_grasp.scene.control import ControlScene
    from continuum_grasp.scene.load import scene_of
    from continuum_grasp.scene.simulate import Scene

    output = Output(as_json, quiet)
    scene = scene_of(config, (Scene, ControlScene), changes or ())
    with output.busy("compiling for the browser"):
        page = write(scene, out if out is not None else Path("runs/export-web") / f"{config.stem}.html")
    modules = ", ".join(f"{name} {size}" for name, size in page.modules.items())
    output.pairs({"page": f"{page.file} ({page.size} bytes; open it in a browser)", "modules [bytes]": modules})
    output.result(file=page.file, size=page.size, modules=page.modules)
