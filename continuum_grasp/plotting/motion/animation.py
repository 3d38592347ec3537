"""A moving picture of the finger."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import InputError, SolverError
from continuum_grasp.plotting.drawable import DrawableControl, DrawableTrajectory
from continuum_grasp.plotting.motion.frames import frames
from continuum_grasp.results import replacing

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["animate"]


def animate(
    trajectory: DrawableTrajectory | DrawableControl,
    path: str | os.PathLike[str],
    fps: float = 30.0,
    *,
    speed: float = 1.0,
    width: int = 640,
    draw: Callable[[Any, NDArray[Any], int], Iterator[NDArray[Any]]] = frames,
) -> Path:
    """Write an animation of the moving finger with the path of its tip and the forces on it.

    Parameters
    ----------
    trajectory : Trajectory
        What moves.
    path : path-like
        ``.gif``, written by Pillow, or ``.mp4``, written by ffmpeg where that is found. It is replaced whole.
    fps : float
        Frames per second of the animation. A GIF tells time in hundredths of a second: above 50 it is
        refused, below that single frames last up to 10 ms more or less, never the whole.
    speed : float
        Seconds of motion per second of animation; 0.1 is ten times slowed down.
    width : int
        Width of the frames [pixels], from 160 on.
    draw : callable
        What draws the frames, with the arguments and the yield of ``frames``.

    Returns
    -------
    pathlib.Path
        ``path``.

    Raises
    ------
    InputError
        Another suffix, a number out of range, or MP4 without ffmpeg.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    for name, value, low, high in (
        ("fps", fps, 0.0, 50.0 if suffix == ".gif" else 240.0),
        ("speed", speed, 0.0, 1e9),
        ("width", width, 159, 4096),
    ):
        if not low < value <= high:
            raise InputError(f"expected more than {low:g} and at most {high:g}, got {value}", key=name)
    if suffix not in (".gif", ".mp4"):
        raise InputError(f"expected a file name ending in .gif or .mp4, got {target.name!r}", key="path")
    ffmpeg = shutil.which("ffmpeg") if suffix == ".mp4" else None
    if suffix == ".mp4" and ffmpeg is None:
        raise InputError("MP4 needs ffmpeg, which is not found on this machine; use .gif", key="path")

    t = np.asarray(trajectory.t)
    duration = float(t[-1] - t[0]) / speed
    moments = t[0] + speed * np.arange(max(1, int(np.floor(duration * fps * (1 + 1e-12))) + 1)) / fps
    indices = np.abs(t[None, :] - moments[:, None]).argmin(axis=1)
    pictures = draw(trajectory, indices, width)
    with replacing(target) as temporary:
        if ffmpeg is None:
            _write_gif(temporary, pictures, len(indices), fps)
        else:
            _write_mp4(temporary, pictures, fps, ffmpeg)
    return target


def _write_gif(path: Path, pictures: Iterator[NDArray[Any]], count: int, fps: float) -> None:
    from PIL import Image

    ends = np.round(100.0 * np.arange(1, count + 1) / fps).astype(int)
    shown = (10 * np.diff(ends, prepend=0)).tolist()
    shown[-1] += 700  # rest a moment before it starts again
    images = [Image.fromarray(picture) for picture in pictures]
    palette = _palette(images)
    paletted = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    paletted[0].save(
        path, format="GIF", save_all=True, append_images=paletted[1:], duration=shown, loop=0, optimize=False
    )


def _palette(images: list[Image]) -> Image:
    """One palette for all frames, from a few of them side by side, so that colours do not flicker."""
    from PIL import Image

    chosen = [images[k] for k in np.unique(np.linspace(0, len(images) - 1, 6).astype(int))]
    sheet = Image.new("RGB", (chosen[0].width, sum(image.height for image in chosen)))
    top = 0
    for image in chosen:
        sheet.paste(image, (0, top))
        top += image.height
    found = sheet.quantize(colors=256, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    kept = np.full((1, 3), 255)  # the ground stays white: nothing else near it, nor near another colour
    for color in np.array(found.getpalette(), dtype=int).reshape(-1, 3):
        if np.abs(kept - color).max(axis=1).min() > 12:
            kept = np.vstack([kept, color])
    palette = Image.new("P", (1, 1))
    palette.putpalette(kept.ravel().tolist())
    return palette


def _write_mp4(path: Path, pictures: Iterator[NDArray[Any]], fps: float, ffmpeg: str) -> None:
    first = next(pictures)
    height, width = first.shape[:2]
    command = [ffmpeg, "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{width}x{height}", "-r", f"{fps:g}", "-i", "-", "-an"]
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
