"""Silhouettes in PNG pictures."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, Any, NamedTuple

from continuum_grasp.base import Array
from continuum_grasp.scene.objects.drawings.curves import DrawnCurve, distinct
from continuum_grasp.scene.objects.drawings.drawing import Drawing
from continuum_grasp.scene.objects.measured import Sampling

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from continuum_grasp.scene.objects.outline import OutlineFile

_ADVICE = "erase everything but the object, change the threshold, or choose one by path"
_BETWEEN = 0.0624
"""RMS error of an interpolated sharp edge between two pixels, one partly covered [pixels]: of (1/2 - a) a / (1 - a)
over coverages a from 0 to 1/2."""
_CLEARLY = 4.0
"""A pixel is clearly darker if it differs from its neighbor by more than this many median differences [1]: three
standard deviations of two pixels."""
_SPECK = 9.0
"""A smaller silhouette is dust or noise [pixels]: three by three pixels show no shape."""
_CLEAR = 4.0
"""Distance from an edge beyond which the blur does not matter, in standard deviations of the blur [1]."""
_TRIMMED = 3.0
"""A pixel farther from its side's darkness, in median deviations [1], is a highlight, a label or a shadow."""


class _Edge(NamedTuple):
    """Edge of a silhouette in a picture [pixels].

    Attributes
    ----------
    points : Array
        Points at the half level between both sides (n, 2).
    sampling : Sampling
    """

    points: Array
    sampling: Sampling


def read_png(given: OutlineFile) -> Drawing:
    """Read the silhouettes, from the largest on; `ValueError` where one reaches the edge of the picture."""
    import contourpy
    import numpy as np

    level = 0.5 if given.threshold is None else given.threshold
    dark = _darkness(given.file)
    noise = _CLEARLY * max(float(np.median(np.abs(np.diff(dark, axis=1)))), 1.0 / 255.0)
    dark = _without_impulses(dark, noise)
    sides = {"top": dark[0], "bottom": dark[-1], "left": dark[:, 0], "right": dark[:, -1]}
    # One or two pixels are noise.
    if cut := [side for side, p in sides.items() if (np.minimum(np.minimum(p[:-2], p[1:-1]), p[2:]) >= level).any()]:
        raise ValueError(
            f"the object reaches the {' and '.join(cut)} edge of the picture, which may cut it: leave a light margin "
            "round a dark object"
        )
    up = dark[::-1]
    lines: Any = contourpy.contour_generator(z=up).lines(level)
    solid = [line for line in lines if (line[0] == line[-1]).all() and abs(_area(line)) >= _SPECK]
    ignored = Counter({f"specks of less than {_SPECK:g} pixels": len(lines) - len(solid)})
    solid.sort(key=lambda line: -abs(_area(line)))
    curves = []
    sampling = Sampling()
    for k, line in enumerate(solid, 1):
        edge = _edge(up, line, level, noise)
        sampling = edge.sampling if k == 1 else sampling
        points = edge.points if given.threshold is None else line
        ring = distinct((float(x), float(y)) for x, y in points)
        curves.append(DrawnCurve(f"silhouette {k}", (f"silhouette {k}",), ring, filled=True))
    return Drawing(None, curves, +ignored, advice=_ADVICE, sampling=sampling)


def _area(line: Array) -> float:
    """Return the area inside a closed line, negative if clockwise [pixels]."""
    x, y = line.T
    return 0.5 * float(x[:-1] @ y[1:] - x[1:] @ y[:-1])


def _without_impulses(dark: Array, noise: float) -> Array:
    """Replace pixels that are clearly darker or lighter than all their neighbors by the median of these."""
    import numpy as np

    across, down = (np.abs(np.diff(dark, axis=axis)) > noise for axis in (1, 0))
    # Few pixels differ from those on all four sides; only these are compared with all eight neighbors.
    rows, columns = np.nonzero(np.logical_and(_both(across), _both(down.T).T))
    padded = np.pad(dark, 1, mode="edge")
    around = [padded[rows + i, columns + j] for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    if not rows.size:
        return dark
    own = dark[rows, columns]
    alone = np.abs(own - np.clip(own, np.min(around, axis=0), np.max(around, axis=0))) > noise
    dark = dark.copy()
    dark[rows[alone], columns[alone]] = np.median(around, axis=0)[alone]
    return dark


def _both(unlike: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether a pixel (rows, columns) is unlike both of its neighbors in the row, by the pairs that are."""
    import numpy as np

    ends = np.ones((len(unlike), 1), dtype=bool)
    both: NDArray[np.bool_] = np.logical_and(np.hstack([ends, unlike]), np.hstack([unlike, ends]))
    return both


def _edge(dark: Array, line: Array, level: float, noise: float) -> _Edge:
    """The edge along a contour, whose points are each between two pixels of a row or a column.

    Across an edge of contrast 1 with Gaussian blur of standard deviation s, two pixels about the half level differ by
    erf(0.5 / (sqrt(2) s)), and the darkness at a distance x from there is (1 + erf(x / (sqrt(2) s))) / 2. Pixels
    without any gray between them leave the edge anywhere between them.
    """
    import numpy as np
    from scipy.special import erfinv

    points = line[:-1]
    # Over three neighbors: a wrong pixel swaps its own sides.
    along = np.roll(points, -3, axis=0) - np.roll(points, 3, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    outward = np.column_stack([along[:, 1], -along[:, 0]]) * math.copysign(1.0, _area(line))
    low, high = np.floor(points).astype(int), np.ceil(points).astype(int)
    step = np.abs(dark[low[:, 1], low[:, 0]] - dark[high[:, 1], high[:, 0]])
    # The crossing is along x where the coordinate x is between two pixels.
    share = np.abs(np.where(high[:, 0] > low[:, 0], outward[:, 0], outward[:, 1]))
    across = share > math.sqrt(0.5)
    blur, inside, outside = 0.0, np.ones(len(points)), np.zeros(len(points))
    for _ in range(2):
        reach = _CLEAR * blur + 2.0
        inside, outside = (_plane(dark, points + away * outward, points) for away in (-reach, reach))
        contrast = np.maximum(inside - outside, 0.1)
        steep = np.median(np.clip(step[across] / share[across] / contrast[across], 0.0, 1.0 - 1e-9))
        blur = math.sqrt(0.125) / float(erfinv(steep))
    crossed = np.clip(2.0 * (level - outside) / contrast - 1.0, -0.9, 0.9)
    bare = float(np.mean(step >= contrast - noise))
    # Darker than halfway is inside.
    shift = math.sqrt(2.0) * blur * erfinv(crossed)
    return _Edge(points + shift[:, None] * outward, Sampling(bare / 12.0 + (1.0 - bare) * _BETWEEN**2, blur))


def _plane(dark: Array, samples: Array, at: Array) -> Array:
    """Estimate darkness at places by a plane through pixels at other places, without outliers."""
    import numpy as np

    rounded = np.rint(samples).astype(int)
    rows, columns = dark.shape
    within = ((rounded >= 0) & (rounded < [columns, rows])).all(axis=1)
    values = dark[rounded[within, 1], rounded[within, 0]]
    terms = np.column_stack([np.ones(len(values)), samples[within]])
    plane = np.array([np.median(values), 0.0, 0.0])
    for _ in range(3):
        off = np.abs(values - terms @ plane)
        near = off <= _TRIMMED * max(float(np.median(off)), 1.0 / 255.0)
        plane = np.linalg.lstsq(terms[near], values[near], rcond=None)[0]
    return np.asarray(np.column_stack([np.ones(len(at)), at]) @ plane)


def _darkness(file: str) -> Array:
    """Darkness of pixels (rows, columns) [1], 0 white or clear, 1 black; opacity where the edges are clear."""
    import numpy as np
    from PIL import Image

    try:
        with Image.open(file) as image:
            if image.mode.startswith("I"):  # gray with 16 bits, which Pillow would clip at 8
                values = np.asarray(image, dtype=float)
                return 1.0 - np.where(values == image.info.get("transparency"), 1.0, values / 65535.0)
            gray, alpha = np.moveaxis(np.asarray(image.convert("RGBA").convert("LA"), dtype=float) / 255.0, 2, 0)
    except Image.DecompressionBombError as error:
        raise ValueError(str(error)) from None
    edge = np.concatenate([alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]])
    return np.asarray(alpha if edge.max() == 0.0 else (1.0 - gray) * alpha)
