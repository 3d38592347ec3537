"""``continuum-grasp validate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from continuum_grasp.cli.options import named_path, option, verb
from continuum_grasp.cli.output import Output
from continuum_grasp.errors import InputError


@verb("changes", "as_json", "quiet")
def validate(
    output: Output,
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILES...", help="YAML configurations.", show_default=False),
    ],
    picture: Path | None = option("Draw the object as it was understood.", metavar="FILE", parser=named_path),
) -> None:
    """Check configurations. Whether a finger can be modeled so is part of it."""
    from continuum_grasp.control.prediction import Prediction
    from continuum_grasp.model import FingerModel
    from continuum_grasp.scene.control import ControlScene
    from continuum_grasp.scene.finger import Finger
    from continuum_grasp.scene.load import kind_of_scene, load_placed
    from continuum_grasp.scene.simulate import Scene

    checked: list[dict[str, Any]] = []
    for file in files:
        try:
            loaded, document = load_placed(file, output.changes or ())
            try:  # as far as the structure of the model; no expressions are built
                if isinstance(loaded, Scene):  # which model a tolerance needs is not asked here
                    fidelity = loaded.fidelity.replaced(tolerance=None)
                    structure = FingerModel(loaded.model_copy(update={"fidelity": fidelity})).structure
                    if loaded.initial.pose == "equilibrium":
                        structure.check_reached_by(loaded.initial)
                elif isinstance(loaded, Finger):
                    FingerModel(loaded)
                elif isinstance(loaded, ControlScene):
                    Prediction(loaded)
            except InputError as error:
                raise document.placed_error(error) from None
        except InputError as error:
            checked.append({"file": str(file), "valid": False, "errors": str(error).splitlines()})
            if not output.as_json:
                typer.echo(str(error), err=True)
        else:
            kind = kind_of_scene(loaded)
            if picture is not None:
                _draw(loaded, file, picture)
            checked.append({"file": str(file), "valid": True, "kind": kind})
            output.say(f"{file}: valid ({kind})")
    output.result(files=checked)
    if not all(verdict["valid"] for verdict in checked):
        raise typer.Exit(2)


def _draw(loaded: Any, file: Path, picture: Path) -> None:
    """Draw the object of a configuration; of several, the last one's picture stays."""
    from continuum_grasp.plotting import plot_object
    from continuum_grasp.results import save_picture

    body = getattr(getattr(loaded, "grasp", loaded), "object", None)
    if body is None:
        raise InputError("has no object to draw (--picture)", file=str(file))
    save_picture(plot_object(body), picture)
