"""Silhouettes in PNG pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from continuum_grasp.base import Array
from continuum_grasp.scene.objects.drawings.curves import DrawnCurve, distinct
from continuum_grasp.scene.objects.drawings.drawing import Drawing

if TYPE_CHECKING:
    from continuum_grasp.scene.objects.outline import OutlineFile

_ADVICE = "erase everything but the object, change the threshold, or choose one by path"


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
    return Drawing(None, named, advice=_ADVICE)


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
