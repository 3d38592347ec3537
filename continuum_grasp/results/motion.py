"""Results that move."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from continuum_grasp.base import InputError
from continuum_grasp.results.result import Result


class MotionResult(Result):
    """A result that moves, over instants ``t``.

    Attributes
    ----------
    frames : str
        The function that draws its animation, as `File.maker`: given the result, the indices of the instants and the
        width [pixels], it yields frames.
    fps : float
        Frames per second where none are asked for.
    """

    frames: ClassVar[str]
    fps: ClassVar[float] = 30.0

    t: Any
    x: Any
    system: Any

    @property
    def simulated(self) -> Any:
        """Scene by which `continuum_grasp.simulate` repeats the motion; an InputError where none does."""
        raise InputError(f"no simulation scene can repeat a {type(self).__name__}")

    @property
    def length(self) -> float:
        """Length of the finger [m]."""
        length: float = self.scene.finger.rod.length
        return length

    @property
    def object_pose(self) -> Any:
        """Pose of the object (T, 3): x, y [m] and angle [rad] of its frame in the world, (T, 4) with its height z [m]
        where it can slide out of the plane; None without an object.
        """
        if self.scene.object is None or self.system is None:
            return None
        columns = self.system.object_states
        return self.x[:, columns] if columns.stop > columns.start else np.tile(self.scene.object.pose, (len(self.t), 1))

    def loads_at(self, index: int) -> list[tuple[Any, Any, str]]:
        """Forces that are drawn at an instant: where they act (2,) [m], force (2,) [N], and of what kind."""
        return []

    def show(self) -> Any:
        """Show the run as a page that plays it back; you can take over, and the page computes on from there.

        Drag the object, the target or the finger, or move a slider, to take over: from the state of that instant the
        page computes the rest, with the plant, the estimator and the controller of the scene as WebAssembly.

        Returns
        -------
        continuum_grasp.addons.web.Page
            A notebook shows it; ``save`` writes it to a file.

        Raises
        ------
        InputError
            There is no page of such a run, its scene cannot be exported, or clang or wasm-ld is missing.

        Examples
        --------
        >>> import shutil
        >>> import continuum_grasp as cg
        >>> run = cg.simulate(cg.load("configs/simulate/hanging.yaml", ["time.duration=0.1"]))
        >>> if shutil.which("clang") and shutil.which("wasm-ld"):
        ...     assert list(run.show().modules) == ["plant"]
        """
        if len(self.t) < 2:
            raise InputError("this run has one instant only: there is nothing to show")
        return self._page

    @cached_property
    def _page(self) -> Any:
        """Page that `show` gives, made once."""
        if not self.page:
            raise InputError(f"a {type(self).__name__} has no page: use animate")
        return self._page_maker()(self)

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

        return write_animation(self, path, self.fps if fps is None else fps, speed, width)
