"""``continuum-grasp schema``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from continuum_grasp.errors import InputError

__all__ = ["schema"]


def schema(
    kind: Annotated[
        str | None,
        typer.Argument(
            metavar="[simulate|identify|grasp|mpc|mission|plan|sweep|finger]",
            help="Print this schema.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Write all schemas into this folder.")
    ] = None,
) -> None:
    """JSON Schema of the configurations, for editors."""
    from continuum_grasp.scene.schema import KINDS, schema_text, write_schemas

    if (kind is None) == (out is None):
        raise InputError(f"expected either one of {', '.join(KINDS)}, or --out DIR")
    if kind is not None:
        typer.echo(schema_text(kind), nl=False)
    elif out is not None:
        for path in write_schemas(out):
            typer.echo(str(path))
