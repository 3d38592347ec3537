"""Pictures into files, frames into an animation file."""

from __future__ import annotations

import base64
import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import InputError, SolverError, named_value
from continuum_grasp.results.atomic import replacing

if TYPE_CHECKING:
    from PIL.Image import Image

_RANGES = {".gif": 50.0, ".mp4": 240.0}
"""Greatest frames per second: browsers show no frame of a GIF shorter than 20 ms; 240 is the fastest screen."""


def write_animation(motion: Any, path: str | os.PathLike[str], fps: float, speed: float, width: int) -> Path:
    """See `MotionResult.animate`."""
    target = Path(path)
    suffix = target.suffix.lower()
    for name, value, low, high in (
        ("fps", fps, 0.0, _RANGES.get(suffix, 240.0)),
        ("speed", speed, 0.0, 1e9),
        ("width", width, 159, 4096),  # pixels: labels fill a narrower frame, H.264 takes no wider one
    ):
        if not low < value <= high:
            raise InputError(f"expected more than {low:g} and at most {high:g}, got {value}", key=name)
    if suffix not in _RANGES:
        raise InputError(f"expected a file name ending in .gif or .mp4, got {target.name!r}", key="path")
    ffmpeg = shutil.which("ffmpeg") if suffix == ".mp4" else None
    if suffix == ".mp4" and ffmpeg is None:
        raise InputError("MP4 needs ffmpeg, which is not found on this machine; use .gif", key="path")

    instants = np.asarray(motion.t, dtype=float)
    duration = float(instants[-1] - instants[0]) / speed
    # a duration that is a whole number of frames must not lose the last one to rounding
    count = max(1, int(np.floor(duration * fps * (1 + 1e-12))) + 1)
    moments = instants[0] + speed * np.arange(count) / fps
    shown = np.abs(instants[None, :] - moments[:, None]).argmin(axis=1)
    pictures = named_value(motion.frames)(motion, shown, width)
    with replacing(target) as temporary:
        if ffmpeg is None:
            _write_gif(temporary, pictures, count, fps)
        else:
            _write_mp4(temporary, pictures, fps, ffmpeg)
    return target


def _write_gif(path: Path, pictures: Iterator[NDArray[Any]], count: int, fps: float) -> None:
    from PIL import Image

    # Ends, not durations, are rounded to the GIF's hundredths of a second, so that no error adds up.
    ends = np.round(100.0 * np.arange(1, count + 1) / fps).astype(int)
    shown = (10 * np.diff(ends, prepend=0)).tolist()
    shown[-1] += 700  # ms of rest before it starts again: long enough to see that it ended
    images = [Image.fromarray(picture) for picture in pictures]
    palette = _palette(images)
    paletted = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    paletted[0].save(
        path, format="GIF", save_all=True, append_images=paletted[1:], duration=shown, loop=0, optimize=False
    )


def _palette(images: list[Image]) -> Image:
    """A palette for all frames, from a few of them side by side, so that colors do not flicker."""
    from PIL import Image

    chosen = [images[k] for k in np.unique(np.linspace(0, len(images) - 1, 6).astype(int))]
    sheet = Image.new("RGB", (chosen[0].width, sum(image.height for image in chosen)))
    top = 0
    for image in chosen:
        sheet.paste(image, (0, top))
        top += image.height
    quantized = sheet.quantize(colors=256, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    chosen_colors = np.full((1, 3), 255)  # the ground stays white: none is near it, nor near another color
    for color in np.array(quantized.getpalette(), dtype=int).reshape(-1, 3):
        # 12: levels of 255 by which colors of a palette differ: closer ones look alike, and make still areas flicker
        if np.abs(chosen_colors - color).max(axis=1).min() > 12:
            chosen_colors = np.vstack([chosen_colors, color])
    palette = Image.new("P", (1, 1))
    palette.putpalette(chosen_colors.ravel().tolist())
    return palette


def _write_mp4(path: Path, pictures: Iterator[NDArray[Any]], fps: float, ffmpeg: str) -> None:
    first = next(pictures)
    height, width = first.shape[:2]
    command = [ffmpeg, "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{width}x{height}", "-r", f"{fps:g}", "-i", "-", "-an"]
    # Players other than ffmpeg's need 4:2:0; a rate factor of 18 is visually lossless.
    command += ["-vcodec", "libx264", "-pix_fmt", "yuv420p", "-crf", "18", "-f", "mp4", str(path)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        if process.stdin is None:  # pragma: no cover - Popen was asked for a pipe
            raise OSError("no pipe to ffmpeg")
        try:
            process.stdin.write(first.tobytes())
            for picture in pictures:
                process.stdin.write(picture.tobytes())
        except BrokenPipeError:
            pass  # ffmpeg ended early and says why below
        _, said = process.communicate()
    except BaseException:
        process.kill()
        process.wait()
        raise
    if process.returncode != 0:
        raise SolverError(
            f"no animation: ffmpeg failed with {said.decode(errors='replace').strip()!r}",
            status="ffmpeg",
            advice="the run itself is saved; try a GIF",
        )


_DPI = 150.0
"""Pixels per inch: text of 9 points is read without zooming on a page and on a screen."""
_POINTS = 8.0
"""Size of text in a journal [points], as in captions."""


def save_picture(
    drawn: Any | Sequence[Any],
    path: str | os.PathLike[str],
    *,
    dpi: float = _DPI,
    style: str = "screen",
    about: str = "",
) -> Path:
    """Save the figure of a plot's result.

    Parameters
    ----------
    drawn : matplotlib.axes.Axes, sequence of them, or matplotlib.figure.Figure
        The result of a plot.
    path : path-like
        File; its suffix is the format (png, pdf, svg). It is replaced whole.
    dpi : float
        Pixels per inch.
    style : {"screen", "paper"}
        paper: as wide as one column of a journal, or as both, with a serif font of 8 points at most, and four times the
        pixels.
    about : str, optional
        Text for the metadata of the file: ``Description`` in PNG and SVG, ``Subject`` in PDF.

    Returns
    -------
    pathlib.Path
        ``path``.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.plotting import plot_object
    >>> from continuum_grasp.results import save_picture
    >>> save_picture(plot_object(cg.load("configs/grasp/gear.yaml").object), mkdtemp() + "/gear.svg").name
    'gear.svg'
    """
    target, figure = Path(path), _figure_of(drawn)
    if style == "paper":
        _print(figure)
        dpi *= 4.0
    kind = target.suffix[1:] or "png"
    metadata = {"Subject" if kind == "pdf" else "Description": about} if about else None
    with replacing(target) as temporary:
        figure.savefig(temporary, format=kind, dpi=dpi, metadata=metadata)
    return target


def _print(figure: Any) -> None:
    """Make a figure as wide as a column, or as both, with text and lines of that size."""
    width = float(figure.get_figwidth())
    # 3.46, 7.16: widths of one column of a journal and of both [inch]: 88 and 182 mm, of IEEE and Elsevier
    # 7.5: width on screen from which a figure takes both [inch]: it has panels side by side
    share = (3.46 if width < 7.5 else 7.16) / width
    figure.set_size_inches(share * width, share * float(figure.get_figheight()))
    # Where text was placed by hand, not by a layout, it must not grow.
    grown = 1.0 if figure.get_layout_engine() is not None else share
    for text in figure.findobj(lambda artist: hasattr(artist, "set_math_fontfamily")):
        text.set(fontsize=min(_POINTS, grown * text.get_fontsize()), fontfamily="STIXGeneral", math_fontfamily="stix")
    for axes in figure.axes:
        axes.tick_params(labelsize=grown * (_POINTS - 1.0), labelfontfamily="STIXGeneral", width=0.6, length=2.5)
    for line in figure.findobj(lambda artist: hasattr(artist, "set_markersize")):
        line.set(linewidth=max(0.5, share * line.get_linewidth()), markersize=max(2.0, share * line.get_markersize()))


def inline_picture(drawn: Any, described: str) -> str:
    """A plot as an HTML element with its data in it, described for readers who cannot see it."""
    content, size = _figure_of(drawn)._repr_png_()
    data = base64.b64encode(content).decode("ascii")
    look = f"width:{size['width']}px;max-width:100%"
    return f'<img alt="{escape(described)}" style="{look}" src="data:image/png;base64,{data}">'


def _figure_of(drawn: Any) -> Any:
    first: Any = drawn[0] if isinstance(drawn, (list, tuple)) else drawn
    return first if hasattr(first, "savefig") else first.figure
