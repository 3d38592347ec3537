"""The command ``continuum-grasp``: its verbs and its one way of reporting errors."""

from __future__ import annotations

import atexit
import errno
import gc
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from continuum_grasp import __version__
from continuum_grasp.base import (
    COMMAND,
    ContinuumGraspError,
    ExitStatus,
    InputError,
    SolverError,
    addons,
    command_line,
    interrupt_was_pressed,
    listening_for_interrupts,
    named_value,
)

_UsageError: Any = typer.BadParameter.__bases__[0]
"""Class of click that typer has a copy of."""


_GONE = {
    "--compare": "give --set fidelity.family=arc, or --set controller.sqp_iterations=20, and compare two runs",
}
"""Options that verbs had once, and what to write instead."""


@contextmanager
def _one_line() -> Iterator[None]:
    """Print faults of options, files and printing in one line, like all other errors."""
    try:
        yield
    except _UsageError as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            raise
        text = error.format_message().rstrip(".")
        text += "".join(f": {instead}" for gone, instead in _GONE.items() if gone == getattr(error, "option_name", ""))
        text = text.replace(". Did you mean", "; did you mean")
        where = "" if error.ctx is None else f"{'' if text[-1] == '?' else ';'} see {error.ctx.command_path} --help"
        typer.echo(f"error: {text[0].lower()}{text[1:]}{where}", err=True)
        raise typer.Exit(ExitStatus.BAD_INPUT) from None
    except OSError as error:
        if error.errno == errno.EPIPE:  # the reader has closed, as with head; click ends silently
            raise
        where = "" if error.filename is None else f"{error.filename}: "
        typer.echo(f"error: {where}{error.strerror or error}", err=True)
        raise typer.Exit(ExitStatus.BAD_INPUT) from None


def _exit_status(error: ContinuumGraspError) -> int:
    if isinstance(error, InputError):
        return ExitStatus.BAD_INPUT
    if isinstance(error, SolverError) and error.status == "unstable":
        return ExitStatus.UNSTABLE
    return ExitStatus.FAILED


class _Root(typer.Context):
    """Has usage and hints name the command as it was typed; ``continuum-grasp`` alone is completed by the Tab key."""

    @property
    def command_path(self) -> str:
        return command_line()


class _Verbs(TyperGroup):
    """Turns the package's errors into one message and an exit code."""

    context_class = _Root

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        old, _, to = args[0].partition("-")
        if old == "export" and to:
            raise InputError(f"{args[0]}: write export CONFIG --to {to}")
        return super().resolve_command(ctx, args)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        with _one_line():
            return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        try:
            with _one_line():
                return super().invoke(ctx)
        except ContinuumGraspError as error:
            typer.echo(f"error: {error}", err=True)
            raise typer.Exit(_exit_status(error)) from None
        except KeyboardInterrupt as error:
            typer.echo(str(error) or "interrupted", err=True)
            raise typer.Exit(ExitStatus.INTERRUPTED) from None


class _Verb(TyperCommand):
    """Names the place in the configuration that an error found later on is about."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except InputError as error:
            config = ctx.params.get("config")
            if config is None or error.file is not None or error.key is None:
                raise
            from continuum_grasp.scene import ConfigurationData

            data = ConfigurationData.load(config, ctx.params.get("changes") or ())
            if error.key.partition(".")[0].partition("[")[0] not in type(data.scene).model_fields:
                raise  # about an option, or an argument of a function
            raise data.placed_error(error) from None


app = typer.Typer(
    name=COMMAND,
    cls=_Verbs,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Planar tendon-driven continuum fingers: simulate, grasp, control, generate C.",
    epilog="Exit status: 0 done, 1 a solver failed, 2 bad input, 3 the only grasp is unstable, 130 interrupted.",
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"continuum-grasp {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


_FIRST = "configurations:new motions:simulate grasps:grasp mpc:mpc motions:modes motions:accuracy export:export"
_LAST = "configurations:schema configurations:validate configurations:doctor"
"""Verbs of the core before and after the add-ons' verbs, each behind the module that has its function."""


_SAID: list[str] = []
"""Warnings of add-ons that cannot be loaded, until they are printed."""


def _by_verb(places: str) -> dict[str, str]:
    """Functions of the command line by their verbs."""
    return {place.partition(":")[2]: f"continuum_grasp.cli.{place}" for place in places.split()}


def _add_verbs() -> None:
    """Give the command line its verbs."""
    first = _by_verb(_FIRST)
    last = _by_verb(_LAST)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        known = addons()
    _SAID.extend(str(warning.message) for warning in said)
    for name, addon in known.items():
        if again := (first | last).keys() & addon.verbs.keys():
            raise InputError(f"add-on {name!r}: the verb {min(again)!r} already exists")
        first |= addon.verbs
    for place in (first | last).values():
        app.command(cls=_Verb)(named_value(place))


_add_verbs()


def _say_warning(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
    """Print a warning as one line, without the place in the code; above a bar where there is one."""
    print(f"warning: {message}", file=sys.stderr, flush=True)


def main() -> None:
    """Run the command line; Ctrl-C ends it with status 130, also where all was done when it was pressed."""
    warnings.showwarning = _say_warning
    for text in _SAID:
        warnings.warn(text, stacklevel=2)
    # Libraries make many objects as they load, none of them garbage: to search them takes 0.3 s, most of it at the end.
    gc.set_threshold(20_000)
    atexit.register(gc.freeze)
    with listening_for_interrupts(command=True):
        try:
            app(prog_name=COMMAND)
        except SystemExit as end:
            _end_output()
            if interrupt_was_pressed() and end.code != ExitStatus.INTERRUPTED:
                typer.echo("interrupted", err=True)
                raise SystemExit(ExitStatus.INTERRUPTED) from None
            raise


def _end_output() -> None:
    """Drop what standard output cannot take: the interpreter would fail over it once more."""
    try:
        sys.stdout.flush()
    except OSError:
        # The interpreter flushes once more at its end, into the stream that is open then.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
