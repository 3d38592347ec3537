"""What independent renderers paint of each drawing of a corpus is what the outline covers, or the error names why not.

The renderer of every run is resvg (PyPI: resvg-py). It is maintained, its own tests compare 1,600 drawings with
browsers, it shares no code with our reader, and its wheels need no library of the system. CairoSVG and svglib leave out
masks and most selectors of style sheets. Chromium paints the corpus once more in the deep tests; it also knows what
resvg does not: variables, media and units of CSS.
"""

from __future__ import annotations

import io
import re
import shutil

import numpy as np
import pytest
import shapely
import yaml
from PIL import Image
from scipy import ndimage

from continuum_grasp.scene import Outline
from tests.marks import few, optional
from tests.scene.random_drawings import RandomDrawing
from tests.scene.svg_corpus import LEFT_OUT, PROGRAMS, READ, REFUSED, WEB, document

PIXELS = 1000
"""Pixels of the longer side of a picture [1]."""
COVERED = 0.99
"""Share of pixels in common of those that the outline or the picture covers [1]: each rim is uncertain by a tenth of a
pixel, of parts that are 200 pixels large."""
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


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


@pytest.fixture(scope="module")
def browser():
    if CHROMIUM is None:
        pytest.skip("needs Chromium")
    with optional("playwright.sync_api").sync_playwright() as driver:
        yield driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])


def by_chromium(browser, file):
    """Colors of a drawing, and pixels per user unit of CSS."""
    height, width, _ = painted(file.read_text()).shape
    zoom = PIXELS / max(width, height)
    page = browser.new_page(viewport={"width": width, "height": height}, device_scale_factor=zoom)
    page.goto(file.as_uri())
    picture = page.screenshot()
    page.close()
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")), zoom


def seen(colors):
    """Pixels of the largest part that is painted, with its holes."""
    ink = 255 - colors.min(axis=2)
    dark = ndimage.binary_fill_holes(ink > 0.4 * np.median(ink[ink > 5]))
    parts, _ = ndimage.label(dark)
    return parts == 1 + np.argmax(np.bincount(parts.ravel())[1:])


def in_common(body, colors, zoom):
    """Pixels that the outline and the picture both cover, as a share of those that one of the two covers."""
    height, width, _ = colors.shape
    curve = body.found.curve
    area = shapely.Polygon(curve.points).buffer(0.5 * curve.width, join_style="mitre")
    points = np.array(area.exterior.coords) * [1.0, -1.0] / 0.0254 * 96.0 * zoom
    path = "L".join(f"{x:.9g},{y:.9g}" for x, y in points)
    page = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}">'
    ours, theirs = seen(painted(f'{page}<path d="M{path}z"/></svg>')), seen(colors)
    return (ours & theirs).sum() / (ours | theirs).sum()


EVERY = READ | {f"{name}, a program": text for name, text in PROGRAMS.items()}


@pytest.mark.parametrize("name", EVERY)
def test_the_outline_covers_what_a_renderer_paints(tmp_path, name):
    colors, zoom = by_resvg(document(EVERY[name]))
    assert in_common(outline(tmp_path, EVERY[name]), colors, zoom) > COVERED


@pytest.mark.parametrize("seed", few(range(100), 12))
def test_the_outline_of_a_random_drawing_covers_what_a_renderer_paints(tmp_path, seed):
    text = RandomDrawing(seed).text
    try:
        body = outline(tmp_path, text)
    except ValueError as error:
        problem = str(error)
    else:
        problem = ""
        pixels = 8.0 * 1e3 * min(body.found.curve.size)
        assert in_common(body, *by_resvg(text)) > min(COVERED, 1.0 - 1.0 / pixels)
    # All of it may be cut off, or it may be cut in two.
    assert not problem or re.search("no closed curve|outer curves", problem)


INSTANCES = {
    "symbols": '<symbol id="s" viewBox="0 0 10 10"><circle cx="5" cy="5" r="4"/></symbol>'
    '<use href="#s" width="30" height="30"/><use href="#s" x="40" width="30" height="30"/>'
    '<use href="#s" transform="matrix(-1 0 0 1 110 0)" width="30" height="30"/>',
    "groups of one name": '<g id="a"><circle id="q" cx="15" cy="15" r="9"/></g>'
    '<g id="a"><circle id="q" cx="45" cy="15" r="9"/></g><g id="a"><circle id="q" cx="75" cy="15" r="9"/></g>',
    "paths of one name": '<path id="q" d="M5 5h20v20h-20zM40 5h20v20h-20z"/><path id="q" d="M80 5h20v20h-20z"/>',
    "uses in uses": '<defs><circle id="c" cx="15" cy="15" r="9"/>'
    '<g id="two"><use href="#c"/><use href="#c" y="30"/></g></defs>'
    '<use href="#two"/><use href="#two" x="30"/>',
    "names that are numbers": '<circle id="12" cx="15" cy="15" r="9"/><circle id="yes" cx="45" cy="15" r="9"/>'
    '<circle id="a: b" cx="75" cy="15" r="9"/>',
}


@pytest.mark.parametrize("name", INSTANCES)
def test_the_error_has_a_path_for_each_of_several_shapes(tmp_path, name):
    with pytest.raises(ValueError, match="outer curves") as error:
        outline(tmp_path, INSTANCES[name])
    listed = re.findall(r"path: ([^;]+);", str(error.value))
    paths = [yaml.safe_load(f"path: {path}")["path"] for path in listed]
    centers = {
        tuple(np.round(np.mean(outline(tmp_path, INSTANCES[name], path=path).found.curve.points, axis=0), 6))
        for path in paths
    }
    assert len(centers) == len(paths) == (4 if name == "uses in uses" else 3)


@pytest.mark.deep
@pytest.mark.parametrize("name", EVERY | WEB)
def test_the_outline_covers_what_a_browser_paints(tmp_path, browser, name):
    body = outline(tmp_path, (EVERY | WEB)[name])
    assert in_common(body, *by_chromium(browser, tmp_path / "one.svg")) > COVERED


@pytest.mark.parametrize("name", LEFT_OUT)
def test_a_part_that_is_left_out_is_named(tmp_path, name):
    text, words = LEFT_OUT[name]
    body = outline(tmp_path, text)
    assert re.search(f"left out: .*{words}", body.note)
    colors, zoom = by_resvg(document(text))
    assert in_common(body, colors, zoom) > COVERED


@pytest.mark.parametrize("name", REFUSED)
def test_an_error_names_what_changes_the_shape(tmp_path, name):
    text, words = REFUSED[name]
    with pytest.raises(ValueError, match=words):
        outline(tmp_path, text)
