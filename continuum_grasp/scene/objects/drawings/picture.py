"""Silhouettes in PNG pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from continuum_grasp.base import Array
from continuum_grasp.scene.objects.drawings.curves import Drawing, DrawnCurve, distinct
from continuum_grasp.scene.objects.measured import Sampling
from continuum_grasp.scene.polygons import PlanePoint

if TYPE_CHECKING:
    from continuum_grasp.scene.objects.outline import OutlineFile

_ADVICE = "erase everything but the object, change the threshold, or choose one by path"
_BETWEEN = 0.0624
"""Root mean square of what a line between two pixels is off the place of a clear edge, where one of them is partly
covered [pixels]: of (1/2 - a) a / (1 - a) over coverages a from 0 to 1/2."""
_BARE = 4.0
"""Differences of two neighbors, in medians, up to which a pixel is as dark as all of its side [1]: three standard
deviations of two pixels."""


def read_png(given: OutlineFile) -> Drawing:
    """Read the silhouettes, from the largest on; `ValueError` where one reaches the edge of the picture."""
    import contourpy

    dark = _darkness(given.file)
    threshold = given.threshold
    sides = {"top": dark[0], "bottom": dark[-1], "left": dark[:, 0], "right": dark[:, -1]}
    if cut := [side for side, pixels in sides.items() if pixels.max() >= threshold]:
        raise ValueError(
            f"the object reaches the {' and '.join(cut)} edge of the picture, which may cut it: leave a light margin "
            "round a dark object"
        )
    lines: Any = contourpy.contour_generator(z=dark[::-1]).lines(threshold)
    rings = sorted((distinct((float(x), float(y)) for x, y in line) for line in lines), key=len, reverse=True)
    curves = [DrawnCurve("", (), ring, filled=True) for ring in rings if len(ring) > 2]
    curves.sort(key=lambda curve: -curve.solid.area)
    names = [f"silhouette {k}" for k in range(1, len(curves) + 1)]
    named = [DrawnCurve(name, (name,), one.points, filled=True) for name, one in zip(names, curves, strict=True)]
    sampling = _sampling(dark[::-1], named[0].points, threshold) if named else None
    return Drawing(None, named, advice=_ADVICE, sampling=sampling)


def _sampling(dark: Array, ring: Sequence[PlanePoint], threshold: float) -> Sampling:
    """How the pixels show the edge at the points of a contour [pixels], each between two pixels of a row or a column.

    Across an edge of contrast 1 with Gaussian blur of standard deviation s, two pixels about the half level differ by
    erf(0.5 / (sqrt(2) s)). Pixels without any gray between them leave the edge anywhere between them.
    """
    import numpy as np
    from scipy.special import erfinv

    points = np.asarray(ring)
    low, high = np.floor(points).astype(int), np.ceil(points).astype(int)
    pair = dark[low[:, 1], low[:, 0]], dark[high[:, 1], high[:, 0]]
    levels = [float(np.median(dark[side])) for side in (dark < threshold, dark >= threshold)]
    contrast = levels[1] - levels[0]
    along = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    # The crossing is along x where the normal has the same share of x as the tangent has of y.
    share = np.abs(np.where(high[:, 0] > low[:, 0], along[:, 1], along[:, 0])) / np.linalg.norm(along, axis=1)
    step = np.abs(pair[1] - pair[0]) / contrast
    steep = np.clip(step[share > math.sqrt(0.5)] / share[share > math.sqrt(0.5)], 0.0, 1.0 - 1e-9)
    blur = math.sqrt(0.125) / float(erfinv(np.median(steep)))
    flat = float(np.median(np.abs(np.diff(dark, axis=1)))) / contrast
    bare = float(np.mean(step >= 1.0 - _BARE * max(flat, 1.0 / 255.0)))
    return Sampling(bare / 12.0 + (1.0 - bare) * _BETWEEN**2, blur)


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
