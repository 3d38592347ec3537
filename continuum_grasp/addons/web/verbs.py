"""``continuum-grasp export --to web``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from continuum_grasp.addons.mission import MissionScene
from continuum_grasp.addons.web.hand import hand_page
from continuum_grasp.addons.web.html_page import Page
from continuum_grasp.addons.web.page import check_one_finger, export_web, page_of_loop, page_of_motion
from continuum_grasp.base import ExportTarget
from continuum_grasp.export import check_file

if TYPE_CHECKING:
    from continuum_grasp.cli import Output


class PageTarget(ExportTarget):
    """A page for a browser; results are shown as pages, too."""

    suffix = ".html"
    takes_hands = True

    @property
    def write(self) -> Callable[..., Any]:
        return export_web

    def check(self, scene: Any, path: Path, **options: Any) -> None:
        """Refuse a mission of several fingers, and a file in the way."""
        check_file(path)
        if isinstance(scene, MissionScene):
            check_one_finger(scene)

    def page_maker(self, kind: str) -> Callable[[Any], Any] | None:
        makers: dict[str, Callable[[Any], Any]] = {
            "motion": page_of_motion,
            "loop": page_of_loop,
            "hand": hand_page,
        }
        return makers.get(kind)

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
