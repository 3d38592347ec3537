"""``continuum-grasp validate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from continuum_grasp.cli.options import Json, Quiet, Set
from continuum_grasp.cli.output import Output

__all__ = ["validate"]


def validate(
    files: Annotated[list[Path], typer.Argument(metavar="FILES...", help="YAML configurations.", show_default=False)],
    changes: Set = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Check configurations, any number of them."""
    from continuum_grasp.errors import InputError
    from continuum_grasp.scene.load import load

    output = Output(as_json, quiet)
    kinds = {"Scene": "simulate", "GraspScene": "grasp", "Finger": "finger"}
    checked: list[dict[str, Any]] = []
    for file in files:
        try:
            kind = kinds[type(load(file, changes or ())).__name__]
        except InputError as error:
            checked.append({"file": str(file), "valid": False, "errors": str(error).splitlines()})
            if not as_json:
                typer.echo(str(error), err=True)
        else:
            checked.append({"file": str(file), "valid": True, "kind": kind})
            output.say(f"{file}: valid ({kind})")
    output.result(files=checked)
    if not all(one["valid"] for one in checked):
        raise typer.Exit(2)
