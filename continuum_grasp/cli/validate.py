"""``continuum-grasp validate``."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from continuum_grasp.cli.options import Json, Quiet, Set
from continuum_grasp.cli.output import Output
from continuum_grasp.errors import InputError

if TYPE_CHECKING:
    from continuum_grasp.scene.load import Loaded


def validate(
    files: Annotated[list[Path], typer.Argument(metavar="FILES...", help="YAML configurations.", show_default=False)],
    changes: Set = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Check configurations, any number of them, and whether a finger can be modeled so."""
    from continuum_grasp.scene.load import kind_of_scene

    output = Output(as_json, quiet)
    checked: list[dict[str, Any]] = []
    for file in files:
        try:
            kind = kind_of_scene(_checked(file, changes or ()))
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


def _checked(file: Path, changes: Iterable[str]) -> Loaded:
    """The configuration, checked as far as the structure of its model; no expressions are built."""
    from continuum_grasp.control.prediction import Prediction
    from continuum_grasp.model import FingerModel
    from continuum_grasp.scene.control import ControlScene
    from continuum_grasp.scene.finger import Finger
    from continuum_grasp.scene.load import load_placed
    from continuum_grasp.scene.simulate import Scene

    loaded, document = load_placed(file, changes)
    try:
        if isinstance(loaded, Scene):  # which model a tolerance needs is not asked here
            FingerModel(loaded.model_copy(update={"fidelity": loaded.fidelity.model_copy(update={"tolerance": None})}))
        elif isinstance(loaded, Finger):
            FingerModel(loaded)
        elif isinstance(loaded, ControlScene):
            Prediction(loaded)
    except InputError as error:
        raise document.placed_error(error) from None
    return loaded
