"""``continuum-grasp export --to web``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from continuum_grasp.addons.web.page import Page
    from continuum_grasp.cli import Output


def defaults(_config: Path, scene: Any) -> dict[str, Any]:
    """No options; a mission of several fingers is refused before its grasp is optimized."""
    from continuum_grasp.addons.mission import MissionScene
    from continuum_grasp.addons.web.page import check_one_finger

    if isinstance(scene, MissionScene):
        check_one_finger(scene)
    return {}


def report(page: Page, output: Output) -> None:
    """Print where a page is, and the size of its WebAssembly."""
    modules = ", ".join(f"{name} {size}" for name, size in page.modules.items())
    output.pairs({"page": f"{page.file} ({page.size} bytes; open it in a browser)", "modules [bytes]": modules})
    output.result(file=page.file, size=page.size, modules=page.modules)
