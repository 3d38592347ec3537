"""Base of results: arrays, meta data, texts and pictures that a result declares, and the files made of them."""

from __future__ import annotations

import inspect
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, get_args

from continuum_grasp.base import InputError, Summarized, addons, check_arguments, clipped, named_value
from continuum_grasp.results.atomic import write_text
from continuum_grasp.results.declared import Dimension, File, Picture, Stored
from continuum_grasp.results.run_folder import META, RESULT, Run, check_files, read_run, write_run

if TYPE_CHECKING:
    import pandas
    import xarray


Format = Literal["png", "pdf", "svg"]
Style = Literal["screen", "paper"]


class Result(Summarized):
    """A result: a frozen dataclass that says which of its attributes are stored, and which files and pictures it has.

    Subclasses have ``scene``, ``status``, ``warnings`` and ``statistics``, as fields or properties. ``repr`` and the
    view in a notebook are short: `headline`, `pairs`, and in a notebook the first picture.

    Attributes
    ----------
    kind : str
        The command that computes such results, as recorded in the run folder.
    stored : tuple of Stored
    dimensions : tuple of Dimension
        Dimensions that stored arrays extend along.
    texts : tuple of File
        Written by `save`, beside ``result.npz`` and ``meta.json``.
    pictures : tuple of Picture
        Drawn by `plot`, the first where none is named, and written by `save_pictures`.
    on_request : tuple of Picture
        Drawn by `plot` alone, since they need options.
    pages : tuple of File
        Texts with pictures in them, written by `save_pictures`; their makers take the drawn axes, by picture, as
        ``pictures``.
    page : str
        Kind of page that ``show`` gives: ``motion``, ``loop`` or ``hand``; empty where there is none.

    Examples
    --------
    >>> from dataclasses import dataclass, field
    >>> from tempfile import mkdtemp
    >>> import numpy as np
    >>> from continuum_grasp.results import Result, Stored
    >>> @dataclass(frozen=True)
    ... class Load(Result):
    ...     kind = "load"
    ...     stored = (Stored("force", "(T,)", "N", "pull at the tip"),)
    ...     force: np.ndarray
    ...     scene: None = None
    ...     status: str = "finished"
    ...     warnings: tuple = ()
    ...     statistics: dict = field(default_factory=dict)
    >>> Load.read(Load(np.array([0.5, 1.0])).save(mkdtemp())).arrays["force"]
    array([0.5, 1. ])
    """

    kind: ClassVar[str]
    stored: ClassVar[tuple[Stored, ...]] = ()
    dimensions: ClassVar[tuple[Dimension, ...]] = ()
    texts: ClassVar[tuple[File, ...]] = ()
    pictures: ClassVar[tuple[Picture, ...]] = ()
    on_request: ClassVar[tuple[Picture, ...]] = ()
    pages: ClassVar[tuple[File, ...]] = ()
    page: ClassVar[str] = ""

    scene: Any
    status: Any
    warnings: Any
    statistics: Any

    def __init_subclass__(cls) -> None:
        """Describe the stored arrays in the docstring, so that their description stands in one place."""
        super().__init_subclass__()
        rows = [f"    {stored.name} : {stored.shape} ndarray\n        {stored}" for stored in cls.stored]
        if rows:
            doc = (cls.__doc__ or "").rstrip()
            cls.__doc__ = "\n".join([doc, "", "    Stored arrays", "    -------------", *rows, "    "])

    @property
    def name(self) -> str | None:
        """Name of the scene."""
        name: str | None = None if self.scene is None else self.scene.name
        return name

    @property
    def outcome(self) -> str:
        """Outcome, in a word or two."""
        return str(self.status)

    @staticmethod
    def as_yaml(values: Any, head: str = "", *, exact: bool = False) -> str:
        """Plain values and arrays as YAML below comments; ``exact`` retains all digits of numbers, otherwise nine."""
        from continuum_grasp.results.plain_values import yaml_text

        return head + yaml_text(values, exact=exact)

    @staticmethod
    def as_csv(headings: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
        """A table as text, with commas between the cells."""
        from csv import writer
        from io import StringIO

        text = StringIO()
        writer(text, lineterminator="\n").writerows([headings, *rows])
        return text.getvalue()

    @classmethod
    def file_names(cls, kind: str) -> set[str]:
        """Return the names of the files that results of a kind write into their folder, for all loaded classes."""
        names = {RESULT, META} if cls.__dict__.get("kind") == kind else set[str]()
        if names:
            names |= {file.name for file in (*cls.texts, *cls.pages)}
            names |= {f"{picture.name}.{suffix}" for picture in cls.pictures for suffix in get_args(Format)}
            names |= {"animation.gif", "animation.mp4"}
        return names.union(*(below.file_names(kind) for below in cls.__subclasses__()))

    def headline(self) -> str:
        """Name, and how it ended."""
        return self.quoted(self.name, self.outcome)

    def words(self) -> Mapping[str, Iterable[str]]:
        """Names that stand for the words in braces in the names of stored arrays."""
        return {}

    def declared(self) -> list[Stored]:
        """The stored arrays, with names in place of `words`."""
        return [each for stored in self.stored for each in stored.each(self.words())]

    def stored_arrays(self) -> dict[str, Any]:
        """The arrays by the names that they are stored under."""
        arrays = {stored.name: stored.of(self) for stored in self.stored if "{" not in stored.name}
        return {name: value for name, value in arrays.items() if value is not None}

    def meta(self, **options: Any) -> dict[str, Any]:
        """Everything else that is stored; ``options`` go to `details`."""
        return {
            "kind": self.kind,
            "config": None if self.scene is None else self.scene.model_dump(mode="json"),
            "status": self.status,
            "warnings": list(self.warnings),
            "statistics": dict(self.statistics),
            **self.details(**options),
        }

    def details(self) -> Mapping[str, Any]:
        """The meta data that only results of this kind have."""
        return {}

    @property
    def _own_folder(self) -> Path | None:
        """Folder in which it lies already, of a result that has one."""
        return None

    def parts(self) -> Mapping[str, Result]:
        """Results that are saved in folders below this one's, by the folder's name."""
        return {}

    @check_arguments
    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write ``result.npz``, ``meta.json`` and the texts into a run folder, each whole or not at all.

        Parameters
        ----------
        folder : path-like
            Made where missing; the run in it is replaced, its pictures too.

        Returns
        -------
        pathlib.Path
            The folder.

        Raises
        ------
        OSError
            The files cannot be written.
        InputError
            The folder has a file of one of these names that no run wrote; nothing is written.
        """
        return self._save(folder)

    def _save(self, folder: str | os.PathLike[str], **options: Any) -> Path:
        """Save, with options for `details` and for what makes the texts."""
        from continuum_grasp.results.record import note_part

        check_files(Path(folder), (file.name for file in self.texts))
        target = write_run(folder, self.stored_arrays(), self.meta(**options))
        self._write(self.texts, target, **options)
        for name, part in self.parts().items():
            note_part(target, name)
            part.save(target / name)
        return target

    def drawable(self) -> Sequence[Picture]:
        """The pictures that there are of this result, the main one first."""
        return [picture for picture in self.pictures if not picture.needs or _is_there(getattr(self, picture.needs))]

    def plot(self, ax: Any = None, *, picture: str | None = None, **options: Any) -> Any:
        """Draw a picture; nothing is written, and a notebook shows the returned axes.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw into, for a picture with panels some of them; by default axes in a new figure, unknown to
            pyplot.
        picture : str, optional
            Its name, of `drawable`; by default the main one.
        **options
            Further options of the function that draws it, as ``times`` of snapshots; the error of a wrong one lists
            them.

        Returns
        -------
        matplotlib.axes.Axes or matplotlib.figure.Figure
            The axes; the figure of a picture with panels.

        Raises
        ------
        InputError
            There is no such picture, it takes no such option, or it has a figure of its own and ``ax`` is given.
        """
        drawable = {candidate.name: candidate for candidate in (*self.drawable(), *self.on_request)}
        known = ", ".join(drawable) or "none: there is nothing to draw"
        if not drawable or (picture is not None and picture not in drawable):
            raise InputError(f"no such picture of this result: {picture!r}; there are {known}", key="picture")
        chosen = drawable[picture] if picture is not None else next(iter(drawable.values()))
        if ax is not None:
            takes = "ax" in _options_of(chosen)
            several = isinstance(ax, list | tuple) or hasattr(ax, "flat")
            if chosen.panels and not (takes and several):
                instead = "leave ax out" + (", or give a list of axes" if takes else "")
                raise InputError(f"{chosen.name} has panels in a figure of its own: {instead}", key="ax")
            wrong = [panel for panel in (ax if chosen.panels else [ax]) if not hasattr(panel, "get_xlim")]
            if wrong:
                named = f"; write picture={ax!r}" if isinstance(ax, str) else ""
                raise InputError(f"expected matplotlib axes, got {type(wrong[0]).__name__}{named}", key="ax")
            options["ax"] = ax
        return self._drawn(chosen, options)

    def _drawn(self, picture: Picture, options: Mapping[str, Any]) -> Any:
        maker = named_value(picture.maker)
        taken = _options_of(picture)
        arguments = {**picture.options, **options}
        needed = [
            name for name, parameter in taken.items() if parameter.default is parameter.empty and name not in arguments
        ]
        known = ", ".join(name for name in taken if name != "ax") or "none"
        for name in (*(name for name in arguments if name not in taken), *needed):
            wrong = "this picture needs it" if name in needed else "no such option"
            raise InputError(f"{wrong}; {picture.name} takes {known}", key=name)
        drawn = maker(self, **arguments)
        return drawn[0].figure if picture.panels else drawn

    @check_arguments
    def save_pictures(
        self, folder: str | os.PathLike[str] | None = None, *, format: Format = "png", style: Style = "screen"
    ) -> list[Path]:
        """Draw all pictures into a folder, which is made where missing; files of the same names are replaced.

        Where the folder belongs to a run, save the result first: this removes the pictures of the run before.

        Parameters
        ----------
        folder : path-like, optional
            Folder of the pictures; by default the result's own, as a sweep has one; else it must be given.
        format : {"png", "pdf", "svg"}
        style : {"screen", "paper"}
            paper: as wide as one column of a journal, or as both, with a serif font of 8 points at most.

        Returns
        -------
        list of pathlib.Path
            The files.

        Raises
        ------
        OSError
            A file cannot be written.
        InputError
            No folder is given, and the result has none of its own.
        """
        from continuum_grasp.results.animation import save_picture

        chosen = self._own_folder if folder is None else folder
        if chosen is None:
            raise InputError("expected the folder where pictures go", key="folder")
        target = Path(chosen)
        drawn = {picture.name: self._drawn(picture, {}) for picture in self.drawable()}
        # The status, so that whoever has the picture alone, or compares it with a text, has the verdict.
        files = [
            save_picture(drawing, target / f"{name}.{format}", style=style, about=str(self.status))
            for name, drawing in drawn.items()
        ]
        return files + self._write(self.pages, target, pictures=drawn)

    def _write(self, files: Iterable[File], folder: Path, **options: Any) -> list[Path]:
        written = []
        for file in files:
            if not file.needs or _is_there(getattr(self, file.needs)):
                written.append(write_text(named_value(file.maker)(self, **options), folder / file.name))
        return written

    def _page_maker(self) -> Any:
        """The function of an add-on that makes the page of such a run."""
        for addon in addons().values():
            for target in addon.exports.values():
                with suppress(ImportError):  # of one whose libraries are not installed
                    if maker := named_value(target)().page_maker(self.page):
                        return maker
        raise InputError(f"no installed add-on makes a page of a {self.page}")

    def _shown_pairs(self) -> Mapping[str, str]:
        count = len(self.warnings)
        more = f" (and {count - 1} more)" if count > 1 else ""
        return {**self.pairs(), **({f"warning{more}": self.warnings[0]} if count else {})}

    def _picture_html(self) -> str:
        """The main picture inline; why there is none where it cannot be drawn: the numbers are shown all the same."""
        from continuum_grasp.results.animation import inline_picture

        if not self.drawable():
            return ""
        try:
            return inline_picture(self.plot(), self.drawable()[0].name)
        except Exception as error:
            return f"<p>{escape(clipped(f'no picture: {type(error).__name__}: {error}'))}</p>"

    def to_pandas(self, dimension: str | None = None) -> pandas.DataFrame:
        """The stored arrays along one dimension, one row for each place on it.

        Parameters
        ----------
        dimension : str, optional
            Name of a dimension; by default the first one of the first array.

        Returns
        -------
        pandas.DataFrame
            A column per array; of an array with several dimensions one per entry, ``name.entry``. The index are the
            dimension's labels, instants [s] for one. ``attrs`` has ``units`` and ``descriptions`` by column.

        Raises
        ------
        InputError
            There is no such dimension, or pandas is not installed.
        """
        from continuum_grasp.results.tables import to_pandas

        return to_pandas(self, dimension)

    def to_xarray(self) -> xarray.Dataset:
        """The stored arrays with named dimensions, labels as coordinates, ``units`` and ``long_name`` as attributes.

        Returns
        -------
        xarray.Dataset

        Raises
        ------
        InputError
            xarray is not installed.
        """
        from continuum_grasp.results.tables import to_xarray

        return to_xarray(self)

    @classmethod
    def read(cls, folder: str | os.PathLike[str]) -> Run:
        """Read the arrays and the meta data of a saved result.

        Raises
        ------
        InputError
            There is no run in the folder, or one of another kind.
        """
        run = read_run(folder)
        if run.meta.get("kind") != cls.kind:
            raise InputError(
                f"expected the folder of a run of {cls.kind}, got a run of {run.meta.get('kind')}", file=str(folder)
            )
        return run


def _options_of(picture: Picture) -> dict[str, inspect.Parameter]:
    """Parameters of the function that draws a picture, by name."""
    parameters = inspect.signature(named_value(picture.maker)).parameters
    return {name: parameter for name, parameter in parameters.items() if parameter.kind is parameter.KEYWORD_ONLY}


def _is_there(value: Any) -> bool:
    return value is not None and (not hasattr(value, "__len__") or len(value) > 0)
