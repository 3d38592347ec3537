"""Arguments and options that several verbs share, and the scene that they name."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Sequence
from copy import copy
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_args

import typer
from typer.models import OptionInfo

from continuum_grasp.cli.output import Output, named_path, one_of


def option(explained: str, *names: str, default: Any = None, words: Sequence[str] = (), **more: Any) -> Any:
    """An option of one verb, of the name of its parameter where it has no other ``names``.

    Some ``words`` are all that it takes; ``more`` as of typer.
    """
    if words:
        more |= {"metavar": "|".join(words), "parser": one_of(*words)}
    return typer.Option(default, *names, help=explained, **more)


_OF_RUNS = ("config", "out", "changes", "pictures", "as_json", "quiet", "verbose", "optimize", "strict")
"""Shared arguments and options of verbs that save a run and draw it."""
_FIRST = ("config", "out", "changes", "animation")
"""Shared arguments and options that `--help` lists before the verb's own; the others come after them."""


def verb(*names: str, **other: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a verb of a function of its `Output` and of the verb's own options.

    ``names`` are the options that it shares with others, which are in the output; ``other`` has by name the words with
    which this verb explains some of them, or whole options. Paths that are given must have a name.
    """

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        shared = inspect.signature(Output, eval_str=True).parameters
        shown = {*names, *(("format", "style") if "pictures" in names else ())}
        _, *own = inspect.signature(function, eval_str=True).parameters.values()
        for parameter in own:
            if isinstance(parameter.default, OptionInfo):
                parameter.default.param_decls = parameter.default.param_decls or (
                    f"--{parameter.name.replace('_', '-')}",
                )
                if Path in get_args(parameter.annotation):
                    parameter.default.parser = named_path

        def described(name: str) -> inspect.Parameter:
            parameter = shared[name]
            if name == "config":  # required, though an output without a configuration is possible
                parameter = parameter.replace(default=inspect.Parameter.empty)
            if name not in other:
                return parameter
            taken, explained = get_args(parameter.annotation)
            own = other[name]
            if isinstance(own, str):
                own = copy(explained)
                own.help = other[name]
            return parameter.replace(annotation=Annotated[taken, own])

        first = [described(name) for name in _FIRST if name in shown]
        last = [described(name) for name in shared if name in shown and name not in _FIRST]
        parameters = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in (*first, *own, *last)]

        @wraps(function)
        def call(**arguments: Any) -> None:
            given = {name: arguments.pop(name) for name in shown}
            try:
                function(Output(verb=function.__name__.replace("_", "-"), **given), **arguments)
            finally:
                if "continuum_grasp.results.folders" in sys.modules:
                    sys.modules["continuum_grasp.results.folders"].release_folders()

        call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        return call

    return decorate


def run_verb(*names: str, **other: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a verb that saves a run and draws it, as `verb` does; ``names`` are options beside the common ones."""
    return verb(*_OF_RUNS, *names, **other)


def resolved_scene(output: Output, *others: type) -> Any:
    """Load a scene; in a scene of ``simulate`` a model replaces the tolerance."""
    from continuum_grasp.scene import Scene

    scene = output.scene(Scene, *others)
    if not isinstance(scene, Scene) or scene.fidelity.tolerance is None:
        return scene
    from continuum_grasp.simulation import resolve_fidelity

    with output.busy("choosing the model"):
        scene, note = resolve_fidelity(scene)
    if note:
        output.say(f"fidelity: {note}")
    return scene
