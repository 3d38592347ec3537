"""``continuum-grasp export --to fmu``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from continuum_grasp.base import ExportTarget

if TYPE_CHECKING:
    from continuum_grasp.addons.fmu.write import FunctionalMockupUnit
    from continuum_grasp.cli import Output


class FmuTarget(ExportTarget):
    """Functional mock-up units in a folder."""

    @property
    def write(self) -> Callable[..., Any]:
        from continuum_grasp.addons.fmu.write import export_fmu

        return export_fmu

    def defaults(self, config: Path, scene: Any) -> dict[str, Any]:
        """Names of files and symbols come from the configuration."""
        from continuum_grasp.addons.fmu.write import identifier_of

        return {"name": identifier_of(config, scene)}

    def check(self, scene: Any, path: Path, **options: Any) -> None:
        """Refuse options that do not fit the scene, and files in the way."""
        from continuum_grasp.addons.fmu.write import units_of

        units_of(scene, path, **options)

    def report(self, written: Sequence[FunctionalMockupUnit], output: Output) -> None:
        """Print each unit's file, step and variables."""
        for unit in written:
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
            units=[{f"{key}_s" if key == "step" else key: value for key, value in vars(u).items()} for u in written]
        )
