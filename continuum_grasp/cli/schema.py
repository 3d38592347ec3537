"""``continuum-grasp schema``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from continuum_grasp.cli.options import out_option
from continuum_grasp.cli.output import Output
from continuum_grasp.errors import InputError


def schema(
    kind: Annotated[
        str | None,
        typer.Argument(
            metavar="[simulate|identify|grasp|mpc|mission|plan|sweep|finger]",
            help="Print this schema.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[Path | None, out_option("Write all schemas into this folder.")] = None,
) -> None:
    """JSON Schema of the configurations, for editors."""
    from continuum_grasp.results.atomic import write_text
    from continuum_grasp.scene.load import KINDS
    from continuum_grasp.scene.schema import json_schema, schema_files, schema_text

    output = Output()
    if (kind is None) == (out is None):
        raise InputError(f"expected either one of {', '.join(KINDS)}, or --out DIR")
    if kind is not None:
        output.say(schema_text(json_schema(kind)).rstrip("\n"))
    elif out is not None:
        for name, text in schema_files().items():
            output.say(str(write_text(text, out / name)))
