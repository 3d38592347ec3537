"""What every result is: arrays, meta data, texts and pictures that it declares, and the files made of them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, ClassVar

import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.results.atomic import write_text
from continuum_grasp.results.run_folder import Run, read_run, write_run


@dataclass(frozen=True)
class Stored:
    """An array of ``result.npz``.

    Attributes
    ----------
    name : str
    shape : str
        In letters that mean the same number in all arrays of a result, as ``"(T, nx)"``.
    unit : str
        SI unit; ``""`` where columns differ, and then their names carry it, ``"text"`` for words.
    meaning : str
    source : str
        The attribute of the result that it is, ``name`` where not given; dots lead into attributes. An array whose
        source is None is not stored.

    The docstring of a result lists its stored arrays.
    """

    name: str
    shape: str
    unit: str
    meaning: str
    source: str = ""

    def __str__(self) -> str:
        unit = f" [{self.unit}]" if self.unit not in ("", "text") else ""
        return f"{self.meaning[:1].upper()}{self.meaning[1:]}{unit}."

    def of(self, result: Result) -> Any:
        """The array of a result; None where it has none."""
        found: Any = result
        for part in (self.source or self.name).split("."):
            found = None if found is None else getattr(found, part)
        return np.array(found, dtype=str) if self.unit == "text" and found is not None else found


@dataclass(frozen=True)
class File:
    """A text or picture that is made of a result.

    Attributes
    ----------
    name : str
        In the run folder; the suffix of a picture is its format.
    maker : str
        ``"module:function"`` below ``continuum_grasp``, which is given the result and returns a text, or axes or a
        figure. It is a name because results lie below what draws and describes them, and matplotlib is loaded late.
    needs : str
        An attribute of the result; where it is None or empty the file is not written.
    """

    name: str
    maker: str
    needs: str = ""


class Result:
    """A result: a frozen dataclass that says which of its attributes are stored, and what is written and drawn of it.

    Subclasses have ``scene``, ``status``, ``warnings`` and ``statistics``, as fields or properties.

    Attributes
    ----------
    kind : str
        The command that computes such results, as recorded in the run folder.
    stored : tuple of Stored
    texts : tuple of File
        Written by `save`, beside ``result.npz`` and ``meta.json``.
    pictures : tuple of File
        Written by `plot`.

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
    texts: ClassVar[tuple[File, ...]] = ()
    pictures: ClassVar[tuple[File, ...]] = ()

    scene: Any
    status: Any
    warnings: Any
    statistics: Any

    def __init_subclass__(cls) -> None:
        """Describe the stored arrays in the docstring, so that their description stands in one place."""
        super().__init_subclass__()
        rows = [f"    {one.name} : {one.shape} ndarray\n        {one}" for one in cls.stored]
        if rows:
            doc = (cls.__doc__ or "").rstrip()
            cls.__doc__ = "\n".join([doc, "", "    Stored arrays", "    -------------", *rows, "    "])

    @property
    def name(self) -> str | None:
        """Name of the scene."""
        found: str | None = self.scene.name
        return found

    def stored_arrays(self) -> dict[str, Any]:
        """The arrays by the names that they are stored under."""
        found = {one.name: one.of(self) for one in self.stored}
        return {name: value for name, value in found.items() if value is not None}

    def meta(self, **options: Any) -> dict[str, Any]:
        """Everything else that is stored; ``options`` are those of `details`."""
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

    def parts(self) -> Mapping[str, Result]:
        """Results that are saved in folders below this one's, by the folder's name."""
        return {}

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
        """
        return self._save(folder)

    def _save(self, folder: str | os.PathLike[str], **options: Any) -> Path:
        """Save, with options for `details` and for what makes the texts."""
        from continuum_grasp.results.record import note_part

        target = write_run(folder, self.stored_arrays(), self.meta(**options))
        self._write(self.texts, target, **options)
        for name, part in self.parts().items():
            note_part(target, name)
            part.save(target / name)
        return target

    def plot(self, folder: str | os.PathLike[str]) -> list[Path]:
        """Draw the pictures into a folder, which is made where missing; files of the same names are replaced.

        Returns
        -------
        list of pathlib.Path
            The files.

        Raises
        ------
        OSError
            A file cannot be written.
        """
        return self._write(self.pictures, Path(folder))

    def _write(self, files: tuple[File, ...], folder: Path, **options: Any) -> list[Path]:
        from continuum_grasp.results.animation import save_picture

        written = []
        for file in files:
            if file.needs and not _is_there(getattr(self, file.needs)):
                continue
            made = maker_of(file.maker)(self, **options)
            write = write_text if isinstance(made, str) else save_picture
            written.append(write(made, folder / file.name))
        return written

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
                f"expected the folder of a run of {cls.kind}, got that of {run.meta.get('kind')}", file=str(folder)
            )
        return run


class MotionResult(Result):
    """A result that moves, over instants ``t``.

    Attributes
    ----------
    frames : str
        What draws its animation, as `File.maker`: given the result, the indices of the instants and the width [pixels],
        it yields frames.
    fps : float
        Frames per second where none are asked for.
    """

    frames: ClassVar[str]
    fps: ClassVar[float] = 30.0

    t: Any

    @property
    def length(self) -> float:
        """Length of the finger [m]."""
        found: float = self.scene.finger.rod.length
        return found

    def animate(
        self, path: str | os.PathLike[str], fps: float | None = None, *, speed: float = 1.0, width: int = 640
    ) -> Path:
        """Write an animation.

        Parameters
        ----------
        path : path-like
            ``.gif``, written by Pillow, or ``.mp4``, written by ffmpeg where that is found. It is replaced whole.
        fps : float, optional
            Frames per second of the animation. A GIF counts time in hundredths of a second: above 50 it is refused,
            below that single frames last up to 10 ms more or less, never the whole.
        speed : float
            Seconds of motion per second of animation; 0.1 is ten times slowed down.
        width : int
            Width of the frames [pixels], from 160 on.

        Returns
        -------
        pathlib.Path
            ``path``.

        Raises
        ------
        InputError
            Another suffix, a number out of range, or MP4 without ffmpeg.
        SolverError
            ffmpeg failed.
        """
        from continuum_grasp.results.animation import write_animation

        def draw(indices: Any) -> Any:
            return maker_of(self.frames)(self, indices, width)

        return write_animation(path, self.t, draw, self.fps if fps is None else fps, speed=speed, width=width)


def maker_of(name: str) -> Any:
    """The function of a ``"module:function"`` below the package."""
    return resolve_name(f"continuum_grasp.{name}")


def _is_there(value: Any) -> bool:
    return value is not None and (not hasattr(value, "__len__") or len(value) > 0)
