"""Curves of drawings as other programs write them, against shapes and affine maps of shapely."""

from __future__ import annotations

import itertools
import math
import re

import ezdxf
import numpy as np
import pytest
import shapely
from ezdxf import units
from ezdxf.math import Matrix44
from ezdxf.xclip import XClip
from shapely.affinity import affine_transform, rotate, scale, skew, translate

from continuum_grasp.scene import Outline


def outline(file, **keys):
    return Outline(shape="outline", file=str(file), mass=0.1, position=(0.0, 0.0), **keys)


def off_by(file, truth, **keys):
    """Area by which the curve of a file differs from a polygon [mm], both at their centroids, as a part of its area."""
    found = scale(shapely.Polygon(outline(file, **keys).found.curve.points), 1e3, 1e3, origin=(0.0, 0.0))
    found, wanted = (translate(one, -one.centroid.x, -one.centroid.y) for one in (found, truth))
    return found.symmetric_difference(wanted).area / wanted.area


def ellipse(a, b, count=4000):
    turn = np.arange(count) * math.tau / count
    return shapely.Polygon(np.column_stack([a * np.cos(turn), b * np.sin(turn)]))


# -- SVG -----------------------------------------------------------------------------------------------------------

SVG = '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
PAGE = f'{SVG} width="100mm" height="100mm" viewBox="0 0 100 100">'
WIDE = f'{SVG} width="400mm" height="400mm" viewBox="-200 -200 400 400">'
SHAPES = {
    "rect": ('<rect x="30" y="40" width="40" height="20" {}/>', shapely.box(30, 40, 70, 60)),
    "rounded": ('<rect width="40" height="20" rx="6" {}/>', shapely.box(6, 6, 34, 14).buffer(6, quad_segs=500)),
    "circle": ('<circle cx="9" cy="4" r="12" {}/>', translate(ellipse(12, 12), 9, 4)),
    "ellipse": ('<ellipse rx="20" ry="9" {}/>', ellipse(20, 9)),
    "polygon": ('<polygon points="0,0 30,5 20,30" {}/>', shapely.Polygon([(0, 0), (30, 5), (20, 30)])),
    "polyline": ('<polyline points="0,0 30,5 20,30" {}/>', shapely.Polygon([(0, 0), (30, 5), (20, 30)])),
    "path": ('<path d="m0 0h40v20l-40 0" {}/>', shapely.box(0, 0, 40, 20)),
}
TURNS = {
    "rotate(30 50 50)": lambda one: rotate(one, 30, (50, 50)),
    "scale(1,-1)": lambda one: scale(one, 1, -1, origin=(0, 0)),
    "skewX(40)": lambda one: skew(one, 40, 0, origin=(0, 0)),
    "skewY(-25)": lambda one: skew(one, 0, -25, origin=(0, 0)),
    "scale(2 0.5)": lambda one: scale(one, 2, 0.5, origin=(0, 0)),
    "matrix(0.8,0.3,-0.5,-1.1,4,7)": lambda one: affine_transform(one, [0.8, -0.5, 0.3, -1.1, 4, 7]),
}


def up(one):
    """A shape of a page, whose y is down."""
    return scale(one, 1, -1, origin=(0, 0))


@pytest.mark.parametrize("name", SHAPES)
def test_every_shape_follows_its_transform_and_those_of_its_groups(tmp_path, name):
    shape, truth = SHAPES[name]
    file = tmp_path / "one.svg"
    for inner, outer in itertools.product(TURNS, list(TURNS)[:3]):
        drawn = shape.format(f'transform="{inner}"')
        file.write_text(f'{WIDE}<g transform="translate(3 4)"><g transform="{outer}">{drawn}</g></g></svg>')
        assert off_by(file, up(TURNS[outer](TURNS[inner](truth)))) < 2e-4, (inner, outer)


SIZES = {
    'width="50mm" height="50mm" viewBox="0 0 100 100"': 0.5,
    'width="5cm" height="5cm" viewBox="-10,-10,50,50"': 1.0,
    'width="2in" height="2in" viewBox="0 0 50.8 50.8"': 1.0,
    'width="144pt" height="144pt" viewBox="0 0 144 144"': 25.4 / 72.0,
    'width="960" height="960" viewBox="0 0 10 10"': 25.4,
    'width="96px" height="96px"': 25.4 / 96.0,
    'viewBox="0 0 10 10"': 25.4 / 96.0,
    'x="0px" y="0px" width="20mm" height="40mm" viewBox="0 0 10 10" preserveAspectRatio="xMinYMax"': 2.0,
    'width="20mm" height="20mm" viewBox="0 0 20 10" preserveAspectRatio="xMidYMid slice"': 2.0,
}


@pytest.mark.parametrize("size", SIZES)
def test_lengths_are_those_of_the_document(tmp_path, size):
    (tmp_path / "one.svg").write_text(f'{SVG} {size}><circle cx="7.5" cy="5" r="2"/></svg>')
    assert off_by(tmp_path / "one.svg", ellipse(2 * SIZES[size], 2 * SIZES[size])) < 2e-4


BAR = '<rect width="4" height="2"/>'
PLACED = {
    "use": f'<defs><g id="a">{BAR}</g></defs><use href="#a" x="3" transform="scale(2)"/>',
    "use before its target": f'<use xlink:href="#a" transform="scale(2)"/><defs><g id="a">{BAR}</g></defs>',
    "use of a use": f'<defs><g id="a">{BAR}</g><use id="b" href="#a" transform="scale(2)"/></defs><use href="#b"/>',
    "symbol": f'<symbol id="a" viewBox="0 0 10 10">{BAR}</symbol><use href="#a" width="20" height="20"/>',
    "inner drawing": f'<svg x="7" y="5" width="20" height="20" viewBox="0 0 10 10">{BAR}</svg>',
    "inner drawing at a place": '<svg x="7" y="5"><rect width="8" height="4"/></svg>',
    "percent of an inner drawing": '<svg width="16" height="16"><rect width="50%" height="25%"/></svg>',
    "percent": '<rect width="8%" height="4%"/>',
    "marker": f'<marker id="m"><path d="M0 0h9v9z"/></marker><g transform="scale(2)">{BAR}</g>',
    "clip path": f'<clipPath><circle r="9"/></clipPath><g transform="scale(2)">{BAR}</g>',
    "mask": f'<mask><circle r="9"/></mask><g transform="scale(2)">{BAR}</g>',
    "hidden": f'<g display="none"><circle r="9"/></g><g visibility="hidden"><circle r="9"/></g>'
    f'<circle r="9" style="display:none"/><g transform="scale(2)">{BAR}</g>',
    "no paint": f'<path d="M0 0h24v24H0z" fill="none"/><circle r="9" opacity="0"/><g transform="scale(2)">{BAR}</g>',
    "clear paint": '<circle r="9" fill-opacity="0"/><circle r="9" fill="#0000"/>'
    '<linearGradient id="g"><stop/></linearGradient><rect width="8" height="4" fill="url(#g)"/>',
    "style sheet behind": '<circle class="h" r="9"/><rect class="b" width="8" height="4"/>'
    "<style>.h{display:none} .b{fill:none;stroke:#000;stroke-width:.1}</style>",
    "white page": f'<rect width="100%" height="100%" fill="#ffffff"/><g transform="scale(2)">{BAR}</g>',
    "twice": '<rect width="8" height="4" fill="red"/>'
    '<rect width="8" height="4" fill="none" stroke="black" stroke-width=".1"/>',
    "clipped beside": '<g clip-path="url(#c)"><rect width="8" height="4"/><circle cx="50" r="3"/></g><clipPath id="c">'
    '<rect width="9" height="9"/></clipPath>',
    "islands on a body": '<rect width="8" height="4"/><path d="M1 1h2v2h-2z M1.5 1.5h1v1h-1z"/>',
    "editor": '<switch><foreignObject/><g><rect width="8" height="4"/></g></switch><metadata><rect/></metadata>',
    "strokes": '<g fill="none" stroke="black" stroke-width=".1"><path d="M0 0h8"/><path d="M0 4v-4"/>'
    '<line x1="8" x2="8" y2="4"/>'
    '<polyline points="0 4 5 4 8 4"/><path d="M2 2h2"/></g>',
}


@pytest.mark.parametrize("name", PLACED)
def test_what_is_drawn_is_read_where_it_is_drawn(tmp_path, name):
    (tmp_path / "one.svg").write_text(f"{PAGE}{PLACED[name]}</svg>")
    assert off_by(tmp_path / "one.svg", shapely.box(0, 0, 8, 4)) < 2e-6


def test_a_plate_as_large_as_the_page_keeps_its_holes(tmp_path):
    path = '<path d="M0 0h90v60h-90z M9 9h9v9h-9z"/><circle cx="60" cy="30" r="9" fill="white"/>'
    (tmp_path / "one.svg").write_text(f'{SVG} width="90mm" height="60mm" viewBox="0 0 90 60">{path}</svg>')
    assert off_by(tmp_path / "one.svg", shapely.box(0, 0, 90, 60)) < 2e-6


def test_every_subpath_is_a_curve_of_its_own(tmp_path):
    data = "M10 10H90V70H10z Z M30 30h20v20h-20z m1 2 M60 60 M 60 40 a9 9 0 1 0 0 .001 z"
    (tmp_path / "one.svg").write_text(f'{PAGE}<path id="plate" fill-rule="evenodd" d="{data}"/></svg>')
    body = outline(tmp_path / "one.svg")
    assert off_by(tmp_path / "one.svg", shapely.box(0, 0, 80, 60)) < 2e-6
    assert body.note == (
        "path 'plate' [1] (80 x 60 mm) of one.svg; "
        "left out: path 'plate' [2] (20 x 20 mm): a hole, path 'plate' [3] (18 x 18 mm): a hole"
    )
    (tmp_path / "two.svg").write_text(f'{PAGE}<path id="two" d="M0 0h9v9h-9z M20 0h8v8h-8z"/></svg>')
    with pytest.raises(ValueError, match=r"two.svg has 2 outer curves.* \(9 x 9 mm\), path: two\[1\]; .* two\[2\]"):
        outline(tmp_path / "two.svg")
    assert off_by(tmp_path / "two.svg", shapely.box(0, 0, 8, 8), path="two[2]") < 2e-6


def test_open_strokes_texts_and_white_areas_are_left_out_and_named(tmp_path):
    drawn = (
        '<g fill="none" stroke="black" stroke-width=".1"><rect id="rim" width="60" height="60"/>'
        '<path id="axis" d="M-9 30h90"/>'
        '</g><circle id="eye" cx="30" cy="30" r="9" fill="white"/><text>A</text>'
    )
    (tmp_path / "one.svg").write_text(f"{PAGE}{drawn}</svg>")
    assert outline(tmp_path / "one.svg").found.left_out == (
        "circle 'eye' (18 x 18 mm): a hole, white",
        "path 'axis' (90 x 0 mm): open",
        "text",
    )
    assert off_by(tmp_path / "one.svg", ellipse(9, 9), path="eye") < 2e-4


def test_drawings_of_matplotlib_have_one_object_by_name(tmp_path):
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(4.0, 3.0))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0, 101.6), ylim=(0, 76.2))
    axes.add_patch(plt.Circle((50, 40), 20, gid="disc", fill=False))
    axes.text(3, 3, "words")
    figure.savefig(tmp_path / "one.svg")
    plt.close(figure)
    assert off_by(tmp_path / "one.svg", ellipse(20, 20), path="disc") < 1e-3


BAD_SVG = {
    "data": ('<path id="q" d="M0 0 L10 0 foo 10 Z"/>', "path 'q': d = .* is not read"),
    "number": ('<path id="q" d="M0 0 L10 0 L 5"/>', "path 'q': d = .* is not read"),
    "unit": ('<rect id="q" width="3em" height="2"/>', "rect 'q': width = '3em' is not read"),
    "points": ('<polygon id="q" points="0,0 1,q 3,4 5,0"/>', "polygon 'q': points = .* is not read"),
    "turn": ('<g id="q" transform="turn(3)"><circle r="3"/></g>', r"g 'q': transform = 'turn\(3\)' is not read"),
    "nothing": (
        '<path id="q" d="M0 0h9" stroke="red"/><image/>',
        r"no closed curve in bad.svg.*path 'q' \(9 x 0 mm\): open",
    ),
    "crossing": ('<path id="q" d="M0 0L9 9V0L0 9z"/>', r"path 'q' of bad.svg must be .* self-intersection at"),
    "two": (
        '<rect id="q" width="9" height="9"/><circle cx="50" r="3"/>',
        "rect 'q' .* path: q; circle 1 .* path: circle 1",
    ),
    "frame": (
        '<g fill="none" stroke="#000"><rect width="90" height="60"/><g id="p"><circle cx="40" cy="30" r="9"/></g></g>',
        r"bad.svg: a frame around the object, .*rect 1 \(90 x 60 mm\), path: rect 1; circle 1 .* path: circle 1",
    ),
    "island": ('<path d="M0 0h90v60h-90z M9 9h40v40h-40z M19 19h9v9h-9z"/>', r"frame .* path 1 \[3\] is inside a hole"),
    "colored page": ('<rect width="100" height="100" fill="#ffd"/><circle r="9" cx="50" cy="50"/>', "a frame around"),
    "bitten": (
        '<rect width="90" height="60"/><circle fill="white" r="9"/>',
        "circle 1 .* white and covers a part of rect 1",
    ),
    "lost": ('<use href="other.svg#a"/>', "use of 'other.svg#a', which is not in the file"),
}


@pytest.mark.parametrize("name", BAD_SVG)
def test_an_error_names_the_element(tmp_path, name):
    (tmp_path / "bad.svg").write_text(f"{PAGE}{BAD_SVG[name][0]}</svg>")
    with pytest.raises(ValueError, match=BAD_SVG[name][1]):
        outline(tmp_path / "bad.svg")


def test_other_documents_are_refused(tmp_path):
    (tmp_path / "bad.svg").write_text("<html><body/></html>")
    with pytest.raises(ValueError, match=r"bad.svg: expected an svg element, got 'html'"):
        outline(tmp_path / "bad.svg")


# -- DXF -----------------------------------------------------------------------------------------------------------

SLOT = shapely.LineString([(-20, 0), (20, 0)]).buffer(10, quad_segs=1000)


def slot(space, layer="0"):
    """Lines and arcs that meet, in no order and direction."""
    on = {"layer": layer}
    space.add_line((20, 10), (-20, 10), dxfattribs=on)
    space.add_arc((20, 0), 10, -90, 90, dxfattribs=on)
    space.add_line((20, -10), (-20, -10), dxfattribs=on)
    space.add_arc((-20, 0), 10, 90, 270, dxfattribs=on)


@pytest.fixture
def drawing():
    return ezdxf.new(units=units.MM)


@pytest.mark.parametrize("version", ["R12", "R2000", "R2004", "R2007", "R2010", "R2013", "R2018"])
def test_entities_that_meet_are_a_loop_in_every_version(tmp_path, version):
    file, drawing = tmp_path / "one.dxf", ezdxf.new(version, units=units.MM if version != "R12" else 0)
    slot(drawing.modelspace())
    drawing.modelspace().add_circle((5, 0), 3)
    drawing.saveas(file)
    keys = {"scale": 1e-3} if version == "R12" else {}
    assert off_by(file, SLOT, **keys) < 1e-4
    assert re.search(r"left out: CIRCLE \w+ on layer '0' \(6 x 6 mm\): a hole$", outline(file, **keys).note)


def test_every_kind_of_entity_is_exact(tmp_path, drawing):
    space, truths = drawing.modelspace(), {}

    def named(name, truth):
        truths[name] = truth
        return {"layer": name}

    space.add_lwpolyline(
        [(-20, -10, 0), (20, -10, 1), (20, 10, 0), (-20, 10, 1)], "xyb", close=True, dxfattribs=named("bulge", SLOT)
    )
    space.add_polyline2d(
        [(-20, -10, 0), (20, -10, 1), (20, 10, 0), (-20, 10, 1)], "xyb", close=True, dxfattribs=named("old", SLOT)
    )
    space.add_polyline3d(
        [(0, 0, 7), (9, 0, 7), (9, 5, 7)], close=True, dxfattribs=named("3d", shapely.Polygon([(0, 0), (9, 0), (9, 5)]))
    )
    space.add_circle((3, 4), 12, dxfattribs=named("circle", ellipse(12, 12)))
    turned = named("ellipse", rotate(ellipse(20, 8), 30))
    space.add_ellipse((0, 0), (20 * math.cos(math.pi / 6), 10), 0.4, dxfattribs=turned)
    # A circle of nine control points with weights.
    square = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)]
    weights = [1 if k % 2 == 0 else math.sqrt(0.5) for k in range(9)]
    knots = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]
    points = [(9 * x, 9 * y) for x, y in square]
    space.add_rational_spline(points, weights, degree=2, knots=knots, dxfattribs=named("spline", ellipse(9, 9)))
    half = named("arcs", ellipse(20, 8))
    space.add_ellipse((0, 0), (20, 0), 0.4, 0.0, math.pi, dxfattribs=half)
    space.add_ellipse((0, 0), (-20, 0), 0.4, 0.0, math.pi, dxfattribs=half)
    # Below the plane: x is mirrored.
    below = {"extrusion": (0, 0, -1)}
    wedge = [(0, 0), (30, 5), (20, 30)]
    space.add_lwpolyline(wedge, close=True, dxfattribs=below | named("mirrored", scale(shapely.Polygon(wedge), -1, 1)))
    half = below | named(
        "mirrored arc", translate(shapely.Point(0, 0).buffer(9, quad_segs=1000) & shapely.box(-9, 0, 9, 9))
    )
    space.add_arc((4, 0), 9, 0, 180, dxfattribs=half)
    space.add_line((-13, 0), (5, 0), dxfattribs={"layer": "mirrored arc"})
    drawing.saveas(tmp_path / "one.dxf")
    for name, truth in truths.items():
        assert off_by(tmp_path / "one.dxf", truth, path=name) < 1e-4, name


@pytest.mark.parametrize("turn", [0.0, 30.0, 200.0])
@pytest.mark.parametrize("factors", [(1, 1), (-1, 1), (2, 0.5), (-1.5, -0.7)])
def test_blocks_are_expanded(tmp_path, drawing, factors, turn):
    part = drawing.blocks.new("PART")
    slot(part)
    part.add_lwpolyline([(20, 10, -0.5), (23, 4)], "xyb", dxfattribs={"layer": "notes"})
    outer = drawing.blocks.new("GROUP", base_point=(3, 4))
    outer.add_blockref("PART", (9, 2), dxfattribs={"xscale": factors[0], "yscale": factors[1], "rotation": turn})
    drawing.modelspace().add_blockref("GROUP", (100, 50), dxfattribs={"rotation": 20, "layer": "L"})
    drawing.saveas(tmp_path / "one.dxf")
    truth = rotate(rotate(scale(SLOT, *factors, origin=(0, 0)), turn, (0, 0)), 20, (0, 0))
    for keys in ({}, {"path": "PART"}, {"path": "L"}):
        assert off_by(tmp_path / "one.dxf", truth, **keys) < 1e-4


def test_what_is_not_visible_is_not_read(tmp_path, drawing):
    for name in ("off", "frozen"):
        drawing.layers.add(name)
    drawing.layers.get("off").off()
    drawing.layers.get("frozen").freeze()
    space = drawing.modelspace()
    slot(space, "part")
    for layer, radius in (("off", 100), ("frozen", 120)):
        space.add_circle((0, 0), radius, dxfattribs={"layer": layer})
    space.add_circle((0, 0), 140, dxfattribs={"invisible": 1})
    drawing.layout("Layout1").add_circle((0, 0), 160)
    frame = drawing.blocks.new("FRAME")
    frame.add_circle((0, 0), 90)
    frame.add_circle((0, 0), 5, dxfattribs={"layer": "part"})
    space.add_blockref("FRAME", (0, 0), dxfattribs={"layer": "frozen"})
    frame = drawing.blocks.new("SIGN")
    frame.add_circle((0, 0), 90)  # on the layer of the reference, which is off
    space.add_blockref("SIGN", (0, 0), dxfattribs={"layer": "off"})
    space.add_text("M6")
    space.add_linear_dim((0, 20), (-30, 0), (30, 0)).render()
    space.add_line((-40, 0), (40, 0), dxfattribs={"layer": "part"})
    drawing.saveas(tmp_path / "one.dxf")
    assert off_by(tmp_path / "one.dxf", SLOT) < 1e-4
    note = outline(tmp_path / "one.dxf").note
    assert "entity on layer 'off', which is off (2)" in note
    assert "entity on layer 'frozen', which is frozen (2)" in note
    assert all(word in note for word in ("invisible entity", "TEXT", "DIMENSION", "(80 x 0 mm): open"))


def test_old_polylines_leave_out_the_frame_of_their_control_points(tmp_path, drawing):
    fitted = drawing.modelspace().add_polyline2d([(0, 0), (40, 0), (40, 20), (0, 20)], close=True)
    fitted.dxf.flags |= 4
    for vertex in fitted.vertices:
        vertex.dxf.flags |= 8
    fitted.append_vertices([(-99, -99), (99, 99)], dxfattribs={"flags": 16})
    drawing.saveas(tmp_path / "one.dxf")
    assert off_by(tmp_path / "one.dxf", shapely.box(0, 0, 40, 20)) < 1e-9


@pytest.mark.parametrize("binary", [False, True])
def test_files_of_entities_alone_and_binary_ones(tmp_path, drawing, binary):
    if binary:
        slot(drawing.modelspace())
        drawing.saveas(tmp_path / "one.dxf", fmt="bin")
    else:  # as Potrace and small exporters write them
        pairs = [(0, "SECTION"), (2, "ENTITIES"), (0, "POLYLINE"), (8, "0"), (66, 1), (70, 1)]
        for x, y, bulge in ((-20, -10, 0), (20, -10, 1), (20, 10, 0), (-20, 10, 1)):
            pairs += [(0, "VERTEX"), (8, "0"), (10, x), (20, y), (42, bulge)]
        pairs += [(0, "SEQEND"), (0, "ENDSEC"), (0, "EOF")]
        (tmp_path / "one.dxf").write_text("".join(f"{code}\n{value}\n" for code, value in pairs))
        with pytest.raises(ValueError, match=r"scale: missing; one.dxf does not say how long a unit of it is"):
            outline(tmp_path / "one.dxf")
    assert off_by(tmp_path / "one.dxf", SLOT, scale=1e-3) < 1e-4


def test_references_that_are_clipped_or_lie_in_another_file_are_named(tmp_path, drawing):
    file, space = tmp_path / "one.dxf", drawing.modelspace()
    slot(space)
    drawing.add_xref_def("other.dxf", "OTHER")
    space.add_blockref("OTHER", (0, 0))
    drawing.saveas(file)
    assert outline(file).found.left_out == ("block 'OTHER', which is in another file",)
    drawing.blocks.new("PART").add_circle((0, 0), 50)
    XClip(space.add_blockref("PART", (0, 0))).set_block_clipping_path([(-9, -9), (9, 9)])
    drawing.saveas(file)
    with pytest.raises(
        ValueError, match=r"CIRCLE \w+ .* is cut by the boundary of block 'PART' on layer '0' \(INSERT \w+\)"
    ):
        outline(file)


UNITS = {
    1: 25.4,
    2: 304.8,
    4: 1.0,
    5: 10.0,
    6: 1e3,
    8: 2.54e-5,
    9: 0.0254,
    10: 914.4,
    13: 1e-3,
    14: 100.0,
    21: 1.2e6 / 3937,
}


@pytest.mark.parametrize("code", UNITS)
def test_lengths_are_those_of_insunits(tmp_path, code):
    length = UNITS[code]
    drawing = ezdxf.new()
    drawing.header["$INSUNITS"] = code
    drawing.modelspace().add_lwpolyline([(0, 0), (50 / length, 0), (50 / length, 20 / length)], close=True)
    drawing.saveas(tmp_path / "one.dxf")
    x, y = outline(tmp_path / "one.dxf").found.curve.size
    assert (1e3 * x, 1e3 * y) == pytest.approx((50.0, 20.0), rel=1e-9)


def test_lines_inside_an_outline_and_lines_drawn_twice_do_not_matter(tmp_path, drawing):
    space = drawing.modelspace()
    corners = [(0, 0), (40.00003, 0.00002), (40, 20), (0, 20)]  # ends as rounded as other programs write them
    for a, b in [
        *itertools.pairwise([*corners, (0.00003, 0)]),
        ((40, 20), (40, 0)),
        ((0, 0), (40, 20)),
        ((0, 20), (0, 30)),
    ]:
        space.add_line(a, b)
    drawing.saveas(tmp_path / "one.dxf")
    assert off_by(tmp_path / "one.dxf", shapely.box(0, 0, 40, 20)) < 1e-5
    assert outline(tmp_path / "one.dxf").note.count(": open") == 2


def test_a_line_shorter_than_the_gap_between_ends_closes_a_loop(tmp_path, drawing):
    corners = [(0, 0), (40, 0), (40, 20), (0, 20), (0, 1e-3)]
    for a, b in itertools.pairwise([*corners, corners[0]]):
        drawing.modelspace().add_line(a, b)
    drawing.saveas(tmp_path / "one.dxf")
    assert off_by(tmp_path / "one.dxf", shapely.box(0, 0, 40, 20)) < 1e-4


def test_frames_several_objects_and_gaps_are_errors_with_the_names_that_choose(tmp_path, drawing):
    file, space = tmp_path / "one.dxf", drawing.modelspace()
    slot(drawing.blocks.new("PART"))
    frame = space.add_lwpolyline([(-100, -100), (197, -100), (197, 110), (-100, 110)], close=True)
    space.add_blockref("PART", (30, 30))
    drawing.saveas(file)
    with pytest.raises(
        ValueError, match=r"one.dxf: a frame around .*\(297 x 210 mm\), path: LWPOLYLINE 36; .*60 x 20 mm\), path: "
    ):
        outline(file)
    assert off_by(file, SLOT, path="PART") < 1e-4
    space.delete_entity(frame)
    space.add_circle((200, 0), 5, dxfattribs={"layer": "pin"})
    drawing.saveas(file)
    with pytest.raises(
        ValueError, match=r"2 outer curves.*60 x 20 mm.*layer 'pin' \(10 x 10 mm\), path: .*a layer, block or"
    ):
        outline(file)
    assert off_by(file, ellipse(5, 5), path="pin") < 1e-4


def test_an_error_names_layer_and_handle(tmp_path, drawing):
    file, space = tmp_path / "one.dxf", drawing.modelspace()
    slot(space)
    upright = Matrix44.x_rotate(math.pi / 2)
    space.add_lwpolyline([(0, 0), (9, 0), (9, 9)], close=True, dxfattribs={"layer": "side"}).transform(upright)
    drawing.saveas(file)
    with pytest.raises(ValueError, match=r"LWPOLYLINE 33 on layer 'side' of one.dxf is not in a plane of constant z"):
        outline(file)
    assert off_by(file, SLOT, path="0") < 1e-4
    drawing = ezdxf.new(units=units.MM)
    drawing.modelspace().add_lwpolyline([(0, 0), (40, 0), (40, 20), (0, 20), (0, 1)], dxfattribs={"layer": "part"})
    drawing.saveas(file)
    with pytest.raises(
        ValueError, match=r"no closed curve in one.dxf.*LWPOLYLINE 2F on layer 'part' \(40 x 20 mm\): open"
    ):
        outline(file)


# -- CSV -----------------------------------------------------------------------------------------------------------

ROWS = "0,0\n4,0\n4,2\n1,2\n"
WEDGE = [(0, 0), (4, 0), (4, 2), (1, 2)]
TABLES = {
    "without headings": (ROWS, {"scale": 1e-3}, (1.0, 1.0)),
    "cm": ("x [cm],y [cm]\n" + ROWS, {}, (10.0, 10.0)),
    "two units": ("x [in],y [mm]\n" + ROWS, {}, (25.4, 1.0)),
    "unit as the configuration": ("x [mm],y [mm]\n" + ROWS, {"scale": 1e-3}, (1.0, 1.0)),
    "capitals, parentheses": ("X (mm),Y (mm)\n" + ROWS, {}, (1.0, 1.0)),
    "low line": ("x_mm,y_mm\n" + ROWS, {}, (1.0, 1.0)),
    "units below": ("x,y\ncm,cm\n" + ROWS, {}, (10.0, 10.0)),
    "numpy": ("# x [cm],y [cm]\n" + ROWS, {}, (10.0, 10.0)),
    "other columns": (
        "k;x [mm];note;y [mm]\n" + ROWS.replace(",", ";-;").replace("\n", "\n7;").join(("7;", ""))[:-2],
        {},
        (1.0, 1.0),
    ),
}


@pytest.mark.parametrize("name", TABLES)
def test_points_have_the_units_of_their_headings(tmp_path, name):
    text, keys, factors = TABLES[name]
    (tmp_path / "one.csv").write_text(text)
    assert off_by(tmp_path / "one.csv", scale(shapely.Polygon(WEDGE), *factors), **keys) < 1e-9


def test_columns_are_found_by_their_headings(tmp_path):
    (tmp_path / "one.csv").write_text("y [mm],x [mm]\n" + ROWS)
    assert off_by(tmp_path / "one.csv", shapely.Polygon([(y, x) for x, y in WEDGE])) < 1e-9


BAD_TABLES = {
    "no columns": ("a,b\n" + ROWS, {}, r"one.csv:1:1: no column 'x' \(it has a, b\)"),
    "one unit": ("x [mm],y\n" + ROWS, {}, r"one.csv:1:8: column y has no unit, the other has \[mm\]"),
    "contradiction": ("x [cm],y [cm]\n" + ROWS, {"scale": 1e-3}, r"its heading says \[cm\], the configuration scale"),
    "no length": ("x [s],y [s]\n" + ROWS, {}, r"expected a unit of length \(m, cm, mm, um, in, ft, mil\), got \[s\]"),
    "headings alone": ("x,y\n", {}, "expected rows of numbers below the headings"),
    "empty cell": ("x,y\n1,2\n3,\n", {}, "one.csv:3:3: column y: the cell is empty"),
}


@pytest.mark.parametrize("name", BAD_TABLES)
def test_an_error_names_the_line(tmp_path, name):
    text, keys, message = BAD_TABLES[name]
    (tmp_path / "one.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        outline(tmp_path / "one.csv", **keys)


# -- PNG -----------------------------------------------------------------------------------------------------------


def gray(radius=80, at=(120, 100), shape=(220, 240)):
    """Darkness of a disc (rows, columns) [1], with shades at its rim."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.clip(radius - np.hypot(x - at[0], y - at[1]) + 0.5, 0.0, 1.0)


def saved(file, form, dark):
    from PIL import Image

    eight = np.round(255 * (1 - dark)).astype(np.uint8)
    light = {
        "8 bit": lambda: Image.fromarray(eight),
        "16 bit": lambda: Image.fromarray(np.round(65535 * (1 - dark)).astype(np.uint16)),
        "palette": lambda: Image.fromarray(eight).convert("P"),
        "1 bit": lambda: Image.fromarray(eight >= 128),
        "color": lambda: Image.merge("RGB", [Image.fromarray(eight)] * 3),
        "alpha": lambda: Image.merge("LA", [Image.fromarray(0 * eight), Image.fromarray(255 - eight)]),
        "light on transparent": lambda: Image.merge(
            "LA", [Image.fromarray(0 * eight + 230), Image.fromarray(255 - eight)]
        ),
    }
    light[form]().save(file)


@pytest.mark.parametrize("form", ["8 bit", "16 bit", "palette", "1 bit", "color", "alpha", "light on transparent"])
def test_silhouettes_of_every_kind_of_png(tmp_path, form):
    saved(tmp_path / "one.png", form, gray())
    assert off_by(tmp_path / "one.png", ellipse(40, 40), scale=5e-4) < 6e-3


def test_sixteen_bits_keep_a_dim_object_apart_from_its_ground(tmp_path):
    saved(tmp_path / "one.png", "16 bit", 0.3 + 0.4 * gray())
    with pytest.raises(ValueError, match="no closed curve"):
        outline(tmp_path / "one.png", scale=5e-4, threshold=0.8)
    assert off_by(tmp_path / "one.png", ellipse(40, 40), scale=5e-4, threshold=0.5) < 4e-3


def test_an_object_at_the_edge_of_a_picture_is_an_error(tmp_path):
    for at, side in (((120, 5), "top"), ((120, 215), "bottom"), ((5, 100), "left"), ((235, 100), "right")):
        saved(tmp_path / "one.png", "8 bit", gray(at=at))
        with pytest.raises(ValueError, match=rf"one.png: the object reaches the .*{side}.* edge of the picture"):
            outline(tmp_path / "one.png", scale=5e-4)


def test_a_crumb_is_an_error_with_advice_that_works(tmp_path):
    saved(tmp_path / "one.png", "8 bit", np.maximum(gray(), gray(3, (215, 20))))
    with pytest.raises(ValueError, match=r"silhouette 1 \(80 x 80 mm\), path: silhouette 1; silhouette 2.*; erase"):
        outline(tmp_path / "one.png", scale=5e-4)
    assert off_by(tmp_path / "one.png", ellipse(40, 40), scale=5e-4, path="silhouette 1") < 4e-3
