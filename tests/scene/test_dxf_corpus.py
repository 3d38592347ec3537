"""What the renderer of ezdxf paints of each drawing of a corpus is what the outline covers, or the error names why not.

The renderer has its own way from entities to pixels: visibility of layers and blocks, arrays, boundaries of blocks.
"""

from __future__ import annotations

import re

import ezdxf
import numpy as np
import pytest
import shapely
from ezdxf.math import Matrix44
from ezdxf.xclip import XClip
from scipy import ndimage

from continuum_grasp.scene import Outline
from tests.marks import optional

SIDE = 120.0
"""Half of the side of the picture [mm]."""
PIXELS = 800
COVERED = 0.98
"""Share of pixels in common of those that the outline or the picture covers [1]: lines are a pixel wide."""
WEDGE = [(0, 0), (60, 0), (60, 20), (25, 45)]


def outline(file, **keys):
    return Outline(shape="outline", file=str(file), mass=0.1, position=(0.0, 0.0), **keys)


def picture(paint):
    """Pixels of the largest part of a picture, with its holes."""
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(8.0, 8.0), dpi=PIXELS / 8)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    paint(axes)
    axes.set(xlim=(-SIDE, SIDE), ylim=(-SIDE, SIDE))
    axes.set_aspect("equal", adjustable="box")
    figure.set_size_inches(8.0, 8.0)  # which the renderer changes
    figure.set_dpi(PIXELS / 8)
    figure.canvas.draw()
    ink = 255 - np.asarray(figure.canvas.buffer_rgba())[..., :3].min(axis=2)
    plt.close(figure)
    parts, _ = ndimage.label(ndimage.binary_fill_holes(ink > 60))
    return parts == 1 + np.argmax(np.bincount(parts.ravel())[1:])


def painted(document):
    """Pixels that ezdxf paints."""
    drawing, config = optional("ezdxf.addons.drawing"), optional("ezdxf.addons.drawing.config")
    backend = optional("ezdxf.addons.drawing.matplotlib")
    how = config.Configuration(
        color_policy=config.ColorPolicy.BLACK,
        background_policy=config.BackgroundPolicy.WHITE,
        lineweight_policy=config.LineweightPolicy.ABSOLUTE,
    )

    def paint(axes):
        front = drawing.Frontend(drawing.RenderContext(document), backend.MatplotlibBackend(axes), config=how)
        front.draw_layout(document.modelspace())

    return picture(paint)


def in_common(body, document):
    """Pixels that the outline and the picture both cover, as a share of those that one of the two covers."""
    curve = body.found.curve
    area = shapely.Polygon(1e3 * np.array(curve.points)).buffer(500.0 * curve.width, join_style="mitre")
    ours, theirs = picture(lambda axes: axes.fill(*area.exterior.xy, color="black")), painted(document)
    return (ours & theirs).sum() / (ours | theirs).sum()


def wedge(space, **attributes):
    return space.add_lwpolyline(WEDGE, close=True, dxfattribs=attributes)


def block(document, name="PART"):
    part = document.blocks.new(name)
    wedge(part)
    return part


def lines(document):
    for a, b in zip(WEDGE, WEDGE[1:] + WEDGE[:1], strict=True):
        document.modelspace().add_line(b, a)


def bulges(document):
    document.modelspace().add_lwpolyline([(-30, 0, 0.4), (30, 0, -0.3), (40, 40, 1), (-20, 40, 0)], "xyb", close=True)


def below(document):
    space = document.modelspace()
    space.add_lwpolyline(
        [(9, 0, 0.5), (60, 0, 0), (40, 50, 0)], "xyb", close=True, dxfattribs={"extrusion": (0, 0, -1)}
    )


def arcs_below(document):
    space = document.modelspace()
    space.add_arc((10, 5), 30, 20, 200, dxfattribs={"extrusion": (0, 0, -1)})
    end = [(-10 - 30 * np.cos(a), 5 + 30 * np.sin(a)) for a in np.radians((20, 200))]
    space.add_line(*end)


def ellipse(document):
    document.modelspace().add_ellipse((5, 5), (50, 20), 0.4)


def spline(document):
    document.modelspace().add_open_spline([(0, 0), (40, -30), (80, 20), (30, 70), (-40, 30), (0, 0)], degree=3)


def fitted(document):
    spline = document.modelspace().add_spline([(0, 0), (40, -10), (70, 20), (30, 50), (-20, 30), (0, 0)])
    assert not spline.control_points


def layers(document):
    for name in ("off", "frozen"):
        document.layers.add(name)
    document.layers.get("off").off()
    document.layers.get("frozen").freeze()
    space = document.modelspace()
    wedge(space)
    for layer, radius in (("off", 100), ("frozen", 90)):
        space.add_circle((0, 0), radius, dxfattribs={"layer": layer})
    space.add_circle((0, 0), 95, dxfattribs={"invisible": 1})
    part = document.blocks.new("SIGN")
    part.add_circle((0, 0), 80, dxfattribs={"layer": "off"})
    part.add_circle((0, 0), 85)
    space.add_blockref("SIGN", (0, 0), dxfattribs={"layer": "frozen"})


def mirrored(document):
    block(document)
    document.modelspace().add_blockref("PART", (20, 5), dxfattribs={"xscale": -1.2, "yscale": 0.7, "rotation": 25})


def mirrored_below(document):
    block(document)
    document.modelspace().add_blockref("PART", (20, 5), dxfattribs={"extrusion": (0, 0, -1), "rotation": 25})


def nested(document):
    block(document)
    outer = document.blocks.new("OUTER", base_point=(3, 4))
    outer.add_blockref("PART", (9, 2), dxfattribs={"xscale": -1, "rotation": 200})
    document.modelspace().add_blockref("OUTER", (-20, 5), dxfattribs={"rotation": 20, "yscale": -1})


def two_scales(document):
    part = document.blocks.new("PART")
    part.add_circle((0, 0), 20)
    document.modelspace().add_blockref("PART", (0, 0), dxfattribs={"xscale": 3.0, "yscale": 1.5, "rotation": 30})


def clip_around(document):
    block(document)
    reference = document.modelspace().add_blockref("PART", (0, 0), dxfattribs={"rotation": 30})
    XClip(reference).set_block_clipping_path([(-5, -5), (90, 90)])


def clip_of_a_part(document):
    block(document).add_circle((70, 30), 40)
    wedge(document.modelspace()).transform(Matrix44.translate(-90, 0, 0))
    reference = document.modelspace().add_blockref("PART", (0, 0))
    XClip(reference).set_block_clipping_path([(-100, -100), (-90, -90)])


def attributes(document):
    block(document).add_attdef("NAME", (0, 0))
    document.modelspace().add_blockref("PART", (0, 0)).add_attrib("NAME", "A", (5, 5))


def hatched(document):
    space = document.modelspace()
    wedge(space)
    space.add_hatch().paths.add_polyline_path(WEDGE, is_closed=True)


def wide(document):
    wedge(document.modelspace(), const_width=2.0)


def wide_of_old(document):
    document.modelspace().add_polyline2d(
        WEDGE, close=True, dxfattribs={"default_start_width": 2.0, "default_end_width": 2.0}
    )


def in_paper(document):
    wedge(document.modelspace())
    document.layout("Layout1").add_circle((0, 0), 80)


READ = [
    lines, bulges, below, arcs_below, ellipse, spline, fitted, layers, mirrored, mirrored_below, nested, two_scales,
    clip_around, clip_of_a_part, attributes, hatched, wide, wide_of_old, in_paper,
]  # fmt: skip
NAMED = {
    layers: "entity on layer 'off', which is off; entity on layer 'frozen', which is frozen .2.; invisible entity",
    attributes: "ATTRIB",
    hatched: "HATCH",
    wide: "half of its line, which is 2 mm wide",
    wide_of_old: "half of its line, which is 2 mm wide",
    in_paper: "entity of the paper space 'Layout1'",
}


@pytest.fixture
def document():
    return ezdxf.new(units=ezdxf.units.MM)


@pytest.mark.parametrize("draw", READ, ids=lambda draw: draw.__name__)
def test_the_outline_covers_what_a_renderer_paints(tmp_path, document, draw):
    draw(document)
    document.saveas(tmp_path / "one.dxf")
    body = outline(tmp_path / "one.dxf")
    assert in_common(body, document) > COVERED
    assert all(words in body.note for words in NAMED.get(draw, "").replace(".2.", "(2)").split("; "))


def clip(document):
    block(document)
    XClip(document.modelspace().add_blockref("PART", (0, 0))).set_block_clipping_path([(-5, -5), (40, 90)])


def nested_clip(document):
    block(document)
    outer = document.blocks.new("OUTER")
    XClip(outer.add_blockref("PART", (0, 0))).set_block_clipping_path([(-5, -5), (40, 90)])
    document.modelspace().add_blockref("OUTER", (0, 0), dxfattribs={"rotation": 90})


def hatch_alone(document):
    document.modelspace().add_hatch().paths.add_polyline_path(WEDGE, is_closed=True)


def thick(document):
    wedge(document.modelspace(), const_width=12.0)


def paper_alone(document):
    document.layout("Layout1").add_circle((0, 0), 80)


def another_file(document):
    document.add_xref_def("other.dxf", "OTHER")
    document.modelspace().add_blockref("OTHER", (0, 0))


def upright(document):
    wedge(document.modelspace(), extrusion=(0, 1, 0))


REFUSED = {
    clip: r"LWPOLYLINE \w+ .* is cut by the boundary of block 'PART' on layer '0' \(INSERT \w+\)",
    nested_clip: r"LWPOLYLINE \w+ .* is cut by the boundary of block 'PART' on layer '0' \(INSERT \w+\)",
    hatch_alone: "no closed curve .* HATCH",
    thick: "drawn by a line 12 mm wide",
    paper_alone: "no closed curve .* entity of the paper space 'Layout1'",
    another_file: "no closed curve .* block 'OTHER', which is in another file",
    upright: "is not in a plane of constant z",
}


@pytest.mark.parametrize("draw", REFUSED, ids=lambda draw: draw.__name__)
def test_an_error_names_what_changes_the_shape(tmp_path, document, draw):
    draw(document)
    document.saveas(tmp_path / "one.dxf")
    with pytest.raises(ValueError, match=REFUSED[draw]):
        outline(tmp_path / "one.dxf")


# -- a name for every instance of a block --------------------------------------------------------------------------


def array(space, name, at, count, step, **attributes):
    grid = {"row_count": count[0], "column_count": count[1], "row_spacing": step[0], "column_spacing": step[1]}
    return space.add_blockref(name, at, dxfattribs=grid | attributes)


def rows(document):
    block(document)
    array(document.modelspace(), "PART", (0, 0), (2, 3), (50, 70), rotation=15, yscale=-0.5)
    return [WEDGE] * 6


def touching(document):
    part = document.blocks.new("PART")
    for a, b in (((0, 0), (9, 0)), ((9, 0), (9, 5)), ((9, 5), (0, 5)), ((0, 5), (0, 0))):
        part.add_line(a, b)
    array(document.modelspace(), "PART", (0, 0), (1, 3), (0, 30))


def arrays_in_an_array(document):
    block(document)
    outer = document.blocks.new("OUTER")
    array(outer, "PART", (0, 0), (1, 2), (0, 70))
    outer.add_circle((0, 60), 9)
    array(document.modelspace(), "OUTER", (0, 0), (2, 1), (100, 0))


def several_references(document):
    block(document)
    for x, mirror in ((0, 1), (150, -1), (300, 1)):
        document.modelspace().add_blockref("PART", (x, 0), dxfattribs={"xscale": mirror, "layer": "12"})


ARRAYS = {rows: 6, touching: 3, arrays_in_an_array: 6, several_references: 3}


@pytest.mark.parametrize("draw", ARRAYS, ids=lambda draw: draw.__name__)
def test_the_error_has_a_path_for_each_instance_of_a_block(tmp_path, document, draw):
    draw(document)
    file = tmp_path / "one.dxf"
    document.saveas(file)
    with pytest.raises(ValueError, match=f"{ARRAYS[draw]} outer curves") as error:
        outline(file)
    paths = re.findall(r"path: ([^;]+)", str(error.value))
    assert len(set(paths)) == ARRAYS[draw]
    centers = {tuple(np.round(shapely.Polygon(outline(file, path=path).found.curve.points).centroid.coords[0], 9))
               for path in paths}  # fmt: skip
    assert len(centers) == ARRAYS[draw]


def test_instances_count_along_the_rows_of_an_array(tmp_path, document):
    document.blocks.new("PIN").add_circle((0, 0), 5)
    reference = array(document.modelspace(), "PIN", (10, 20), (2, 3), (40, 30))
    document.saveas(tmp_path / "one.dxf")
    for row in range(2):
        for column in range(3):
            path = f"INSERT {reference.dxf.handle}[{3 * row + column + 1}]"
            points = np.array(outline(tmp_path / "one.dxf", path=path).found.curve.points)
            middle = 0.5 * (points.max(axis=0) + points.min(axis=0))
            assert middle == pytest.approx((1e-3 * (10 + 30 * column), 1e-3 * (20 + 40 * row)), abs=1e-7)
