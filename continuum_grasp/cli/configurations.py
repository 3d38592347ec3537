"""Verbs of configurations and of the installation: ``new``, ``schema``, ``validate``, ``doctor``."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from continuum_grasp.base import (
    InputError,
    command_line,
    command_words,
    has_tool,
    install_line,
    quoted_line,
    tool_words,
)
from continuum_grasp.cli.options import option, verb
from continuum_grasp.cli.output import Output, named_path, out_option

if TYPE_CHECKING:
    from continuum_grasp.examples import Example
    from continuum_grasp.scene import ConfigurationData

_FIRST = "grasp/mug"
"""The example of those who name none."""


@verb("as_json", "quiet")
def new(
    output: Output,
    folder: Annotated[
        Path | None,
        typer.Argument(metavar="DIR", parser=named_path, help="Target folder; created if missing.", show_default=False),
    ] = None,
    name: str = option("Example to copy.", "--example", default=_FIRST, metavar="NAME"),
    listed: bool = option("Copy nothing: list all examples, by command.", "--list", default=False),
    notebooks: bool = option("Copy the notebooks instead of an example.", "--notebooks", default=False),
) -> None:
    """Copy an example that runs, or the notebooks.

    Nothing is overwritten; one folder takes several examples.
    """
    if notebooks and (listed or name != _FIRST):
        raise InputError("cannot be combined with --example or --list", key="--notebooks")
    if listed:
        _list(output)
        return
    if folder is None:
        raise InputError("expected a folder to copy an example into, or --list")
    if folder.exists() and not folder.is_dir():
        raise InputError("expected a folder, got a file", file=str(folder))

    from continuum_grasp.examples import copy_example, copy_notebooks, example

    if notebooks:
        files = copy_notebooks(folder)
        command = tool_words("jupyterlab", "notebooks", folder=folder)
        output.say("Notebooks, and what they read:\n")
    else:
        files = copy_example(name, folder)
        command = _command(example(name), folder)
        output.say(f"{name}: {example(name).summary}\n")
    for file in files:
        output.say(f"  {file}")
    output.say("\nRun it:\n")
    if folder.resolve() != Path.cwd():
        output.say(f"  {quoted_line(['cd', str(folder)])}")
    if notebooks and not has_tool("jupyterlab"):
        output.say(f"  {install_line('notebook')}")
    output.say(f"  {quoted_line(command)}")
    output.result(example=None if notebooks else name, folder=folder, files=files, command=command)


def _list(output: Output) -> None:
    from continuum_grasp.examples import examples

    all_ = examples().values()
    width = max(len(example.name) for example in all_)
    for command in dict.fromkeys(example.verb for example in all_):
        output.say(command_line(command))
        for example in all_:
            if example.verb == command:
                note = f" (not shipped: its data, {', '.join(example.missing)})" if example.missing else ""
                output.line(f"  {example.name:<{width}}  {example.summary}{note}")
        output.say("")
    names = ("name", "kind", "summary", "missing")
    rows = [{**{name: getattr(example, name) for name in names}, "command": _command(example)} for example in all_]
    output.result(examples=rows)


def _command(example: Example, folder: Path = Path()) -> list[str]:
    return command_words(*example.arguments, folder=folder)


def schema(
    kind: Annotated[
        str | None,
        typer.Argument(
            metavar="KIND",
            help="Print the schema of simulate, identify, grasp, hand, mpc, mission, plan, sweep, design or finger.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[Path | None, out_option("Write all schemas into this folder.")] = None,
) -> None:
    """JSON Schema of the configurations, for editors."""
    from continuum_grasp.results import write_text
    from continuum_grasp.scene import json_schema, kinds, schema_files, schema_text

    output = Output()
    if (kind is None) == (out is None):
        raise InputError(f"expected either one of {', '.join(kinds())}, or --out DIR")
    if kind is not None:
        output.say(schema_text(json_schema(kind)).rstrip("\n"))
    elif out is not None:
        from continuum_grasp.export import check_file

        texts = schema_files()
        for name in texts:
            check_file(out / name, lambda file: b'"$schema"' in file.read_bytes()[:100])
        for name, text in texts.items():
            output.say(str(write_text(text, out / name)))


@verb("changes", "as_json", "quiet", "strict")
def validate(
    output: Output,
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE", help="YAML configurations.", show_default=False),
    ],
    picture: Path | None = option("Draw the scene; solve nothing.", metavar="FILE"),
) -> None:
    """Check configurations. Whether a finger can be modeled so is part of it."""
    from continuum_grasp.scene import ConfigurationData, kind_of_scene

    if picture is not None:
        from continuum_grasp.export import check_file

        check_file(picture, lambda file: b"Matplotlib" in file.read_bytes())
    checked: list[dict[str, Any]] = []
    for file in files:
        try:
            with output.doubting():
                data = ConfigurationData.load(file, output.changes or ())
                loaded = data.scene
                _check_structure(data)
        except InputError as error:
            checked.append({"file": str(file), "valid": False, "errors": str(error).splitlines()})
            if not output.as_json:
                typer.echo(str(error), err=True)
        else:
            kind = kind_of_scene(loaded).name
            if picture is not None:
                _draw(data, picture)
            checked.append({"file": str(file), "valid": True, "kind": kind, "notes": data.notes})
            output.say(f"{file}: valid ({kind})")
            for note in data.notes:
                output.say(f"  {note}")
    output.result(files=checked)
    if not all(verdict["valid"] for verdict in checked):
        raise typer.Exit(2)


def _check_structure(data: ConfigurationData) -> None:
    """Check a scene up to the structure of its model, without building expressions."""
    from continuum_grasp.addons.sweeps import base_scene
    from continuum_grasp.control import Prediction
    from continuum_grasp.grasp import overlaps_at_rest
    from continuum_grasp.model import FingerModel
    from continuum_grasp.scene import CommandedScene, ControlScene, Finger, GraspScene, HandScene, Scene

    scene = data.scene
    with_fingers = GraspScene | HandScene | Scene | CommandedScene
    base = base_scene(data)
    below = "" if base is scene else "scene."
    if getattr(base, "grasp", None) is not None:  # of a mission or a plan, which takes base and object from it
        base, below = base.grasp, f"{below}grasp."
    if isinstance(base, with_fingers):
        for overlap in overlaps_at_rest(base):
            data.doubt(f"{below}{overlap.key}", f"is in the way: {overlap}")
    try:
        if isinstance(scene, Scene):  # which model a tolerance needs is not asked here
            fidelity = scene.fidelity.replaced(tolerance=None)
            structure = FingerModel(scene.model_copy(update={"fidelity": fidelity})).structure
            if scene.initial.pose == "equilibrium":
                structure.check_reached_by(scene.initial)
        elif isinstance(scene, Finger):
            FingerModel(scene)
        elif isinstance(scene, ControlScene):
            Prediction(scene)
    except InputError as error:
        raise data.placed_error(error) from None


def _draw(data: ConfigurationData, picture: Path) -> None:
    """Draw the scene of a configuration, of a sweep or design its base; of several files, the last one's stays."""
    from continuum_grasp.addons.sweeps import base_scene
    from continuum_grasp.plotting import plot_scene
    from continuum_grasp.results import save_picture

    save_picture(plot_scene(base_scene(data)), picture)


_PACKAGES = ("casadi", "numpy", "scipy", "matplotlib", "pydantic", "pyyaml", "typer", "rich")


@verb("as_json")
def doctor(output: Output) -> None:
    """Print versions, solvers and compiler."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    import casadi

    from continuum_grasp import __version__
    from continuum_grasp.core import Compiler

    compiler = Compiler.find()
    facts = {"continuum_grasp": __version__, "python": platform.python_version(), "platform": platform.platform()}
    for package in _PACKAGES:
        try:
            facts[package] = version(package)
        except PackageNotFoundError:
            facts[package] = "not found"
    facts |= {
        "processors": str(os.cpu_count()),
        "ipopt": "found" if casadi.has_nlpsol("ipopt") else "not found",
        "compiler": f"{' '.join(compiler.command)}, {compiler.version}: controllers, models, checks of exports"
        if compiler
        else "not found: grasp and simulate run on CasADi's virtual machine, which is slower; mpc and missions need "
        f"one: {install_line('compiler')}",
        "clang for pages": shutil.which("clang") or "not found: export --to web needs it",
        "ffmpeg": shutil.which("ffmpeg") or "not found: animations as GIF only",
    }
    output.pairs(facts)
    output.result(**facts)
    if facts["ipopt"] != "found":
        output.warn(["IPOPT is not in this CasADi: grasps cannot be optimized; install casadi from PyPI"])
        raise typer.Exit(1)
