"""``continuum-grasp new``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from continuum_grasp.cli.options import named_path, option, verb
from continuum_grasp.cli.output import Output
from continuum_grasp.errors import InputError

if TYPE_CHECKING:
    from continuum_grasp.examples import Example

_FIRST = "grasp/mug"
"""The example of those who name none."""


@verb("as_json", "quiet")
def new(
    output: Output,
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="DIR", parser=named_path, help="Where to; made where it is missing.", show_default=False
        ),
    ] = None,
    name: str = option("Which one.", "--example", default=_FIRST, metavar="NAME"),
    listed: bool = option("Copy nothing: list all examples, by the command.", "--list", default=False),
    notebooks: bool = option("Copy the notebooks in place of an example.", "--notebooks", default=False),
) -> None:
    """Copy an example that runs, or the notebooks.

    Nothing is overwritten; one folder takes several examples.
    """
    if notebooks and (listed or name != _FIRST):
        raise InputError("is in place of --example and --list", key="--notebooks")
    if listed:
        _list(output)
        return
    if folder is None:
        raise InputError("expected a folder to copy an example into, or --list")
    if folder.exists() and not folder.is_dir():
        raise InputError("expected a folder, got a file", file=str(folder))

    from continuum_grasp.examples import copy_example, copy_notebooks, example

    if notebooks:
        files, command = copy_notebooks(folder), ["jupyter", "lab", "notebooks"]
        output.say("Notebooks, and what they read:\n")
    else:
        files, command = copy_example(name, folder), _command(example(name))
        output.say(f"{name}: {example(name).summary}\n")
    for file in files:
        output.say(f"  {file}")
    output.say("\nRun it:\n")
    if folder.resolve() != Path.cwd():
        output.say(f"  cd {shlex.quote(str(folder))}")
    output.say(f"  {shlex.join(command)}")
    output.result(example=None if notebooks else name, folder=folder, files=files, command=command)


def _list(output: Output) -> None:
    from continuum_grasp.examples import examples

    all_ = examples().values()
    width = max(len(example.name) for example in all_)
    for command in dict.fromkeys(example.verb for example in all_):
        output.say(f"continuum-grasp {command}")
        for example in all_:
            if example.verb == command:
                note = f" (not shipped: its data, {', '.join(example.missing)})" if example.missing else ""
                output.line(f"  {example.name:<{width}}  {example.summary}{note}")
        output.say("")
    names = ("name", "kind", "summary", "missing")
    rows = [{**{name: getattr(example, name) for name in names}, "command": _command(example)} for example in all_]
    output.result(examples=rows)


def _command(example: Example) -> list[str]:
    return ["continuum-grasp", *example.arguments]
