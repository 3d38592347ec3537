"""``continuum-grasp export-web``."""

from __future__ import annotations

from continuum_grasp.cli.options import out_option, verb
from continuum_grasp.cli.output import Output

_OUT = out_option("Page to write (default: runs/export-web/NAME-OF-CONFIG.html); an earlier one is replaced.", "FILE")


@verb("config", "out", "changes", "as_json", "quiet", out=_OUT)
def export_web(output: Output) -> None:
    """Write a page in which a finger, and its controller, run as WebAssembly: one file that needs no network."""
    from continuum_grasp.export import export_web as write
    from continuum_grasp.scene.control import ControlScene
    from continuum_grasp.scene.simulate import Scene

    scene = output.scene(Scene, ControlScene)
    with output.busy("compiling for the browser"):
        page = write(scene, output.named(".html"))
    modules = ", ".join(f"{name} {size}" for name, size in page.modules.items())
    output.pairs({"page": f"{page.file} ({page.size} bytes; open it in a browser)", "modules [bytes]": modules})
    output.result(file=page.file, size=page.size, modules=page.modules)
