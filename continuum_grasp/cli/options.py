"""Arguments and options that several verbs share, and the scene that they name."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.models import OptionInfo

from continuum_grasp.cli.output import Output


def named_path(text: str | Path) -> Path:
    """A path that is given by its name; an empty one would be the working directory."""
    if not str(text):
        raise typer.BadParameter("expected a path, got an empty text")
    return Path(text)


def one_of(*words: str) -> Callable[[str], str]:
    """The reader of an option that takes one of some words."""

    def read(text: str) -> str:
        if text not in words:
            raise typer.BadParameter(f"expected {', '.join(words[:-1])} or {words[-1]}, got {text!r:.60}")
        return text

    return read


def option(explained: str, *names: str, default: Any = None, **more: Any) -> Any:
    """An option of one verb, of the name of its parameter where it has no other ``names``; ``more`` as of typer."""
    return typer.Option(default, *names, help=explained, **more)


def out_option(explained: str, metavar: str = "DIR") -> Any:
    """``--out`` with its own explanation."""
    return typer.Option("--out", metavar=metavar, parser=named_path, help=explained)


_SHARED: dict[str, tuple[Any, Any, Any]] = {
    "config": (
        Path,
        typer.Argument(
            metavar="CONFIG",
            parser=named_path,
            help="YAML configuration.",
            show_default=False,
        ),
        inspect.Parameter.empty,
    ),
    "out": (
        Path | None,
        out_option(
            "Folder of the run (default: runs/COMMAND/NAME-OF-CONFIG); an earlier run of the command is replaced."
        ),
        None,
    ),
    "changes": (
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY.PATH=VALUE",
            help="Change one entry of the configuration; repeatable. Paths are relative to the configuration.",
        ),
        None,
    ),
    "animation": (
        str | None,
        typer.Option(
            "--animate",
            metavar="gif|mp4",
            parser=one_of("gif", "mp4"),
            help="Write an animation too; mp4 needs ffmpeg.",
        ),
        None,
    ),
    "pictures": (bool, typer.Option("--pictures/--no-pictures", help="Draw pictures."), True),
    "format": (
        str,
        typer.Option("--format", metavar="png|pdf|svg", parser=one_of("png", "pdf", "svg"), help="Of the pictures."),
        "png",
    ),
    "style": (
        str,
        typer.Option(
            "--style",
            metavar="screen|paper",
            parser=one_of("screen", "paper"),
            help="Look of the pictures; paper: as wide as a column, with its fonts.",
        ),
        "screen",
    ),
    "as_json": (bool, typer.Option("--json", help="Print one JSON object instead of text."), False),
    "quiet": (bool, typer.Option("--quiet", "-q", help="Print nothing but warnings and errors."), False),
    "verbose": (bool, typer.Option("--verbose", "-v", help="Print statistics too."), False),
}
"""Arguments and options of several verbs: type, how they are given, and default."""
_LAST = ("pictures", "format", "style", "as_json", "quiet", "verbose")
"""Shared options that `--help` lists after those of the verb alone."""


def verb(*names: str, **other: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a verb of a function of its `Output` and of the verb's own options.

    ``names`` are the options that it shares with others, which are in the output; ``other`` has those by name that this
    verb explains in words of its own.
    """

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        shown = [*names, *(("format", "style") if "pictures" in names else ())]
        _, *declared = inspect.signature(function, eval_str=True).parameters.values()
        for parameter in declared:
            if isinstance(parameter.default, OptionInfo):
                parameter.default.param_decls = parameter.default.param_decls or (
                    f"--{parameter.name.replace('_', '-')}",
                )
        first, last = list[inspect.Parameter](), list[inspect.Parameter]()
        for name in shown:
            taken, option_info, default = _SHARED[name]
            annotation = Annotated[taken, other.get(name, option_info)]  # type: ignore[valid-type]
            parameter = inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
            (last if name in _LAST else first).append(parameter)
        last.sort(key=lambda parameter: _LAST.index(parameter.name))
        parameters = [
            *first,
            *(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in declared),
            *last,
        ]

        @wraps(function)
        def call(**arguments: Any) -> None:
            shared = {name: arguments.pop(name) for name in shown}
            try:
                function(Output(verb=function.__name__.replace("_", "-"), **shared), **arguments)
            finally:
                if "continuum_grasp.results.atomic" in sys.modules:
                    sys.modules["continuum_grasp.results.atomic"].release_folders()

        call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        return call

    return decorate


def resolved_scene(output: Output, *others: type, vibrates: bool = False) -> tuple[Any, str]:
    """A scene of ``simulate``, its tolerance turned into a model, or one of other kinds; what was chosen and why."""
    from continuum_grasp.scene.simulate import Scene
    from continuum_grasp.verbs import resolved

    scene = output.scene(Scene, *others)
    if not isinstance(scene, Scene):
        return scene, ""
    with output.busy("choosing the model"):
        scene, note = resolved(scene, vibrates=vibrates)
    if note:
        output.say(f"fidelity: {note}")
    return scene, note
