"""``continuum-grasp export --to web``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from continuum_grasp.base import ExportTarget, named_value

if TYPE_CHECKING:
    from continuum_grasp.addons.web.html_page import Page
    from continuum_grasp.cli import Output

_MAKERS = {
    "motion": "continuum_grasp.addons.web.page:page_of_motion",
    "loop": "continuum_grasp.addons.web.page:page_of_loop",
    "hand": "continuum_grasp.addons.web.hand:hand_page",
}


class PageTarget(ExportTarget):
    """A page for a browser; results are shown as pages, too."""

    suffix = ".html"
    takes_hands = True

    @property
    def write(self) -> Callable[..., Any]:
        from continuum_grasp.addons.web.page import export_web

        return export_web

    def check(self, scene: Any, path: Path, **options: Any) -> None:
        """Refuse a mission of several fingers, and a file in the way."""
        from continuum_grasp.addons.mission import MissionScene
        from continuum_grasp.addons.web.page import check_one_finger
        from continuum_grasp.export import check_file

        check_file(path)
        if isinstance(scene, MissionScene):
            check_one_finger(scene)

    def page_maker(self, kind: str) -> Callable[[Any], Any] | None:
        return named_value(_MAKERS[kind]) if kind in _MAKERS else None

    def report(self, written: Page, output: Output) -> None:
        """Print where a page is, and the size of its WebAssembly."""
        modules = ", ".join(f"{name} {size}" for name, size in written.modules.items())
        output.pairs(
            {
                "page": f"{written.file} ({written.size} bytes; open it in a browser)",
                **({"modules [bytes]": modules} if modules else {}),
            }
        )
        output.result(file=written.file, size=written.size, modules=written.modules)
