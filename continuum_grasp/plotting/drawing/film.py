"""Frames of an animation: what does not move is drawn once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.plotting.drawing.bodies import mass_positions, masses_of
from continuum_grasp.plotting.drawing.style import Color, Inch, Z
from continuum_grasp.plotting.drawing.styled_axes import Box, StyledAxes

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.lines import Line2D
    from matplotlib.text import Text

_BESIDE, _BELOW = 80, 110
"""Taken by labels and ticks beside the axes, and by these and the title above and below them [pixels]."""


class Film:
    """World axes of a width [pixels], made even as video coders want it, round a box; draw what does not move first."""

    def __init__(self, box: Box, width: int) -> None:
        across = 2 * max(1, width // 2)
        high = 2 * round(((across - _BESIDE) * (box[3] - box[2]) / (box[1] - box[0]) + _BELOW) / 2)
        self._figure = StyledAxes.figure(across / Inch.PIXELS, high / Inch.PIXELS)
        self._figure.set_dpi(Inch.PIXELS)
        self.ax = StyledAxes.plane(self._figure.add_subplot(), box).ax

    def line(self, *marker: str, **style: Any) -> Line2D:
        """A line that moves, empty at first."""
        return self.ax.plot([], [], *marker, animated=True, **style)[0]

    def prediction(self, label: str) -> Line2D:
        """Path that a controller predicts, with its entry in the legend."""
        style: dict[str, Any] = {"color": Color.GREEN, "linewidth": 1.4}
        self.ax.plot([], [], label=label, **style)
        return self.line(zorder=Z.CLAMP_FACE, **style)

    def clock(self) -> Text:
        """A text in the upper right corner that moves on."""
        style: dict[str, Any] = {"ha": "right", "va": "top", "color": Color.INK, "animated": True}
        return self.ax.text(0.985, 0.975, "", transform=self.ax.transAxes, **style)

    def finger(self, motion: Any, at: NDArray[Any], shapes: NDArray[Any]) -> Callable[[int], list[Artist]]:
        """Draw the path of the tip so far, the backbone (n, points, 2) at instants (n,), point masses and the time.

        The function returned moves them to the k-th of the instants and returns them.
        """
        tip = np.asarray(motion.tip)
        masses = masses_of(motion.scene.finger)
        trail = self.line(color=Color.GRAY, linewidth=0.9, zorder=Z.SUPPORT)
        body = self.line(color=Color.BLUE, linewidth=2.6, solid_capstyle="round", zorder=Z.SHAPE)
        dots = self.line("o", color=Color.INK, markersize=7, zorder=Z.MASS)
        clock = self.clock()

        def move(k: int) -> list[Artist]:
            trail.set_data(*tip[: at[k] + 1].T)
            body.set_data(*shapes[k].T)
            clock.set_text(f"{motion.t[at[k]]:.2f} s")
            if masses:
                dots.set_data(*mass_positions(shapes[k], motion.scene.finger).T)
            return [trail, body, clock, dots]

        return move

    def frames(
        self, numbers: Iterable[int], moving: Callable[[int], tuple[Sequence[Artist], Sequence[Artist]]]
    ) -> Iterator[NDArray[np.uint8]]:
        """Draw frame after frame (height, width, 3).

        ``moving`` is given the number of a frame and returns the artists that it moved, and those that it added to the
        axes for this frame alone.
        """
        canvas: Any = self._figure.canvas
        canvas.draw()
        self._figure.set_layout_engine("none")  # frames must not shift
        background = canvas.copy_from_bbox(self._figure.bbox)
        for number in numbers:
            canvas.restore_region(background)
            lasting, passing = moving(number)
            # matplotlib sorts by zorder only where it draws whole axes
            for artist in sorted([*lasting, *passing], key=lambda artist: float(artist.get_zorder())):
                self.ax.draw_artist(artist)
            for artist in passing:
                artist.remove()
            yield np.asarray(canvas.buffer_rgba())[..., :3].copy()
