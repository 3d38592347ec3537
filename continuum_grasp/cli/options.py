"""Arguments and options that several verbs share, and the scene that they name."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from continuum_grasp.cli.completion import complete_config

if TYPE_CHECKING:
    from continuum_grasp.cli.output import Output
    from continuum_grasp.scene.simulate import Scene


def named_path(text: str | Path) -> Path:
    """A path that is given by its name; an empty one would be the working directory."""
    if not str(text):
        raise typer.BadParameter("expected a path, got an empty text")
    return Path(text)


def _format(text: str) -> str:
    """The format of an animation."""
    if text not in ("gif", "mp4"):
        raise typer.BadParameter(f"expected gif or mp4, got {text!r}")
    return text


def out_option(explained: str, metavar: str = "DIR") -> Any:
    """``--out`` with its own explanation."""
    return typer.Option("--out", metavar=metavar, parser=named_path, help=explained)


Config = Annotated[
    Path,
    typer.Argument(
        metavar="CONFIG",
        parser=named_path,
        help="YAML configuration.",
        show_default=False,
        autocompletion=complete_config,
    ),
]
Out = Annotated[
    Path | None,
    out_option("Folder of the run (default: runs/COMMAND/NAME-OF-CONFIG); an earlier run of the command is replaced."),
]
Animate = Annotated[
    str | None,
    typer.Option("--animate", metavar="gif|mp4", parser=_format, help="Write an animation too; mp4 needs ffmpeg."),
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY.PATH=VALUE",
        help="Change one entry of the configuration; repeatable. Paths are relative to the configuration.",
    ),
]
Pictures = Annotated[bool, typer.Option("--pictures/--no-pictures", help="Draw pictures.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but warnings and errors.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Print statistics too.")]


def simulation_scene(
    config: Path, changes: Iterable[str] | None, output: Output, *, vibrates: bool = False
) -> tuple[Scene, str]:
    """A scene for simulation, modes and code generation, its tolerance turned into a model; what was chosen and why."""
    from continuum_grasp.scene.load import scene_of
    from continuum_grasp.scene.simulate import Scene
    from continuum_grasp.verbs import resolved

    with output.busy("choosing the model"):
        scene, note = resolved(scene_of(config, Scene, changes or ()), vibrates=vibrates)
    if note:
        output.say(f"fidelity: {note}")
    return scene, note
