"""Output of the verbs."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, TypeVar, cast

import typer

from continuum_grasp.base import ExitStatus, InputError, Interrupted, NumericalError, Summarized, interrupts_held
from continuum_grasp.cli.progress import Progress, shown

if TYPE_CHECKING:
    from continuum_grasp.results import MotionResult, Result

R = TypeVar("R", bound="Result")


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


def out_option(explained: str, metavar: str = "DIR") -> Any:
    """``--out`` with its own explanation."""
    return typer.Option("--out", metavar=metavar, parser=named_path, help=explained)


@dataclass(frozen=True)
class Output:
    """Request to a verb, and its output: text for people, or one JSON object for programs; warnings always go to the
    error stream. Fields are the arguments and options that verbs share, and the verb, after which a run's folder is
    named.
    """

    config: Annotated[
        Path, typer.Argument(metavar="CONFIG", parser=named_path, help="YAML configuration.", show_default=False)
    ] = Path()
    out: Annotated[
        Path | None,
        out_option(
            "Folder of the run (default: runs/COMMAND/NAME-OF-CONFIG); an earlier run of the command is replaced."
        ),
    ] = None
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY.PATH=VALUE",
            help="Change one entry of the configuration; repeatable. Paths are relative to the configuration.",
        ),
    ] = None
    animation: Annotated[
        str | None,
        typer.Option(
            "--animate",
            metavar="gif|mp4",
            parser=one_of("gif", "mp4"),
            help="Write an animation too; mp4 needs ffmpeg.",
        ),
    ] = None
    pictures: Annotated[bool, typer.Option("--pictures/--no-pictures", help="Draw pictures.")] = True
    format: Annotated[
        str,
        typer.Option("--format", metavar="png|pdf|svg", parser=one_of("png", "pdf", "svg"), help="Picture format."),
    ] = "png"
    style: Annotated[
        str,
        typer.Option(
            "--style",
            metavar="screen|paper",
            parser=one_of("screen", "paper"),
            help="Look of the pictures; paper: as wide as a column, with its fonts.",
        ),
    ] = "screen"
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but warnings and errors.")] = False
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print statistics too.")] = False
    optimize: Annotated[
        bool,
        typer.Option("--optimize", help="Compile all code with optimization now, for loops that run many times."),
    ] = False
    strict: Annotated[
        bool, typer.Option("--strict", help="Treat doubts about the configuration, such as a unit, as errors.")
    ] = False
    verb: str = ""

    def __post_init__(self) -> None:
        if self.optimize:
            from continuum_grasp.core import CodeKind

            CodeKind.force_optimized()
        if self.quiet and (self.as_json or self.verbose):
            raise InputError("--quiet cannot be combined with --json or --verbose")

    @property
    def folder(self) -> Path:
        """The folder of the run: as asked, or named after verb and configuration."""
        return self.out if self.out is not None else Path("runs") / self.verb / self.config.stem

    def check_folder(self, *, alone: bool = True) -> None:
        """Refuse, before any work, a folder that cannot be written, or that holds what another verb wrote.

        Where this run is to be ``alone`` in it, also one in which another run is at work.
        """
        from continuum_grasp.results import check_folder, hold_folder

        check_folder(self.folder, self.verb)
        if alone:
            hold_folder(self.folder)

    def scene(self, *kinds: type) -> Any:
        """Load the scene of the configuration, which is of one of the given kinds; then check the tools that options
        need.
        """
        from continuum_grasp.scene import scene_of

        with self.doubting():
            scene = scene_of(self.config, kinds, self.changes or ())
        if self.animation == "mp4" and shutil.which("ffmpeg") is None:
            raise InputError("mp4 needs ffmpeg, which is not installed; use gif", key="--animate")
        return scene

    def doubting(self) -> AbstractContextManager[None]:
        """Return a context in which doubts are errors with ``--strict``, else warnings."""
        from continuum_grasp.scene import doubts_refused

        return doubts_refused() if self.strict else nullcontext()

    @staticmethod
    def fail() -> NoReturn:
        """End with the exit status of what has no usable result."""
        raise typer.Exit(ExitStatus.FAILED)

    def write(self, text: str, name: str) -> Path:
        """Write a text file into the folder of the run; returns its path."""
        from continuum_grasp.results import write_text

        return write_text(text, self.folder / name)

    def say(self, text: str) -> None:
        """Print text for people."""
        if not (self.quiet or self.as_json):
            _print(text)

    def line(self, text: str) -> None:
        """Print text for people, on a terminal as much of it as one line takes."""
        width = shutil.get_terminal_size().columns
        if sys.stdout.isatty() and len(text) > width:
            text = f"{text[: width - 1]}…"
        self.say(text)

    def pairs(self, rows: Mapping[str, Any]) -> None:
        """Print names and values in two columns."""
        self.table(*((name, str(value)) for name, value in rows.items()), left=(0, 1))

    def table(self, *lines: Sequence[str], left: Collection[int] = ()) -> None:
        """Print a heading and rows in columns, to the right, but for those to the ``left``."""
        for line in Summarized.aligned(lines, left):
            self.say(line)

    def statistics(self, statistics: Mapping[str, Any]) -> None:
        """Print statistics where they are wanted."""
        if self.verbose and statistics:
            self.pairs(statistics)

    def warn(self, warnings: Iterable[str]) -> None:
        """Print warnings."""
        for warning in warnings:
            typer.echo(f"warning: {warning}", err=True)

    def result(self, **values: Any) -> None:
        """Print the one JSON object, where JSON is wanted."""
        if self.as_json:
            from continuum_grasp.results import plain

            _print(json.dumps(plain(values), indent=2, allow_nan=False))

    @contextmanager
    def saving(self) -> Iterator[None]:
        """Save what was computed, and let Ctrl-C wait for that."""
        with interrupts_held(quietly=True) as pressed:
            yield
        if pressed():
            raise KeyboardInterrupt(f"interrupted; the result is saved in {self.folder}")

    def run(self, what: str, work: Callable[[Progress], R], speed: float = 1.0) -> tuple[R, list[Path]]:
        """Compute a result and `save` it; returns it and what was drawn.

        ``work`` is given what it may report its share to. Where it stops early, what it has computed is saved.
        """
        self.check_folder()
        try:
            with self.busy(what) as report:
                result = work(report)
        except (NumericalError, Interrupted) as error:
            # An error may carry the result of one step of the work, such as a simulation of a fit.
            if getattr(error.result, "kind", None) == self.verb:
                with self.saving():
                    error.result.save(self.folder)
                typer.echo(f"the results so far are in {self.folder}", err=True)
            raise
        return result, self.save(result, speed)

    def save(self, result: Result, speed: float = 1.0) -> list[Path]:
        """Save a result, draw its pictures where wanted, and its animation where a format is given; returns these."""
        with self.saving():
            result.save(self.folder)
        files: list[Path] = []
        if self.pictures:
            with self.drawing():
                files += self.drawn(result)
        if self.animation is not None:
            with self.drawing():
                path = self.folder / f"animation.{self.animation}"
                files.append(cast("MotionResult", result).animate(path, speed=speed))
        return files

    def drawn(self, result: Result) -> list[Path]:
        """Draw the pictures of a result, in format and style as asked; returns the files."""
        return result.save_pictures(self.folder, format=self.format, style=self.style)  # type: ignore[arg-type]

    def report(
        self, result: Result, files: Sequence[Path], more: Mapping[str, Any] | None = None, **values: Any
    ) -> None:
        """Print warnings, status and numbers of a result, and `conclude`."""
        self.warn(result.warnings)
        self.conclude(result, files, {"status": str(result.status), **result.pairs()}, more, **values)

    def conclude(
        self,
        result: Result,
        files: Sequence[Path],
        pairs: Mapping[str, str] | None = None,
        more: Mapping[str, Any] | None = None,
        **values: Any,
    ) -> None:
        """Print the last ``pairs`` of a result, its model, unused columns, its folder, texts and other files, and on
        request its statistics and ``more`` of them; or its JSON object with ``values``.
        """
        paths = [self.folder / text.name for text in result.texts]
        texts = [path for path in paths if path.exists()]
        files = [*texts, *files]
        drawn = all(file.suffix[1:] in (self.format, self.animation) for file in files)
        self.pairs(
            {
                **(pairs or {}),
                **{key: text for key, text in result.statistics.items() if key in ("fidelity", "code", "unread")},
                "saved in": self.folder,
                "pictures" if drawn else "files": ", ".join(file.name for file in files) or "none",
            }
        )
        self.statistics({**result.statistics, **(more or {})})
        common = {"warnings": result.warnings, "statistics": result.statistics}
        self.result(**{"status": result.status, "folder": self.folder, "files": files, **values, **common})

    @contextmanager
    def drawing(self) -> Iterator[None]:
        """Work on what can be drawn again; Ctrl-C says where the numbers are."""
        try:
            with self.busy("drawing"):
                yield
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"interrupted; the result is saved in {self.folder}") from None

    @contextmanager
    def busy(self, what: str) -> Iterator[Progress]:
        """Show, after two seconds, that work goes on; it may report its share to what this yields."""
        progress = Progress(what)
        if self.quiet:
            yield progress
        else:
            with shown(progress):
                yield progress


def _print(text: str) -> None:
    try:
        typer.echo(text)
    except OSError as error:
        error.filename = error.filename or "standard output"
        raise
