"""``continuum-grasp export --to fmu``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from continuum_grasp.addons.fmu.write import FunctionalMockupUnit, identifier_of

if TYPE_CHECKING:
    from continuum_grasp.cli import Output


def defaults(config: Path, scene: Any) -> dict[str, Any]:
    """Names of files and symbols are those of the configuration."""
    return {"name": identifier_of(config, scene)}


def report(units: Sequence[FunctionalMockupUnit], output: Output) -> None:
    """Print each unit's file, step and variables."""
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
