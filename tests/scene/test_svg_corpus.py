"""What an independent renderer paints of each drawing of a corpus is what the outline covers, or the error names why not.

The renderer is resvg (PyPI: resvg-py): it is maintained, comes with tests of 1,600 drawings against browsers, shares no
code with our reader, and its wheels need no library of the system. CairoSVG ignores masks of groups and most selectors of
style sheets, and needs cairo; svglib has no masks. What resvg does not know (variables and media of CSS) Chromium paints,
and it paints all others, too, where it is installed.
"""

from __future__ import annotations

import io
import re
import shutil

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from continuum_grasp.scene import Outline
from tests.scene.svg_corpus import LEFT_OUT, PROGRAMS, READ, REFUSED, WEB, document

PIXELS = 1000
"""Pixels of the longer side of a picture [1]."""
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
TOUCHED = 0.985
"""Share of pixels in common of what both cover [1]: the rim of a picture counts pixels that are touched by the smallest
part, half a pixel on each side of 300 x 200 pixels."""


def outline(folder, text, **keys):
    file = folder / "one.svg"
    file.write_text(document(text))
    return Outline(shape="outline", file=str(file), mass=0.1, position=(0.0, 0.0), **keys)


def painted(text, zoom=None):
    """Colors (rows, columns, 3)."""
    resvg = pytest.importorskip("resvg_py")
    picture = resvg.svg_to_bytes(
        svg_string=text, zoom=zoom, background="#fff", dpi=96, skip_system_fonts=True, languages=["en"]
    )
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"))


def by_resvg(text):
    """Colors of a drawing, and pixels per user unit of CSS."""
    zoom = PIXELS / max(painted(text).shape)
    return painted(text, zoom), zoom


def seen(colors):
    """Pixels of the largest thing that is painted, with its holes."""
    ink = 255 - colors.min(axis=2)
    dark = ndimage.binary_fill_holes(ink > 0.4 * np.median(ink[ink > 5]))
    parts, _ = ndimage.label(dark)
    return parts == 1 + np.argmax(np.bincount(parts.ravel())[1:])


def in_common(body, colors, zoom):
    """Pixels that the outline and the picture both cover, as a share of those that one of the two covers."""
    height, width, _ = colors.shape
    points = np.array(body.found.curve.points) * [1.0, -1.0] / 0.0254 * 96.0 * zoom
    path = "L".join(f"{x:.9g},{y:.9g}" for x, y in points)
    ours = seen(painted(f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}"><path d="M{path}z"/></svg>'))
    theirs = seen(colors)
    return (ours & theirs).sum() / (ours | theirs).sum()


EVERY = READ | {f"{name}, a program": text for name, text in PROGRAMS.items()}


@pytest.mark.parametrize("name", EVERY)
def test_the_outline_covers_what_a_renderer_paints(tmp_path, name):
    colors, zoom = by_resvg(document(EVERY[name]))
    assert in_common(outline(tmp_path, EVERY[name]), colors, zoom) > TOUCHED


@pytest.mark.parametrize("name", LEFT_OUT)
def test_a_part_that_is_left_out_is_named(tmp_path, name):
    text, words = LEFT_OUT[name]
    body = outline(tmp_path, text)
    assert re.search(f"left out: .*{words}", body.note)
    colors, zoom = by_resvg(document(text))
    assert in_common(body, colors, zoom) > (0.96 if name == "width" else TOUCHED)


@pytest.mark.parametrize("name", REFUSED)
def test_an_error_names_what_changes_the_shape(tmp_path, name):
    text, words = REFUSED[name]
    with pytest.raises(ValueError, match=words):
        outline(tmp_path, text)
