"""Draw the outlines of the shipped grasps: a scissors handle (SVG), a bottle (PNG) and a gear (DXF).

``python docs/outlines.py`` writes them beside the configurations in ``configs/grasp`` that name them.
"""

from __future__ import annotations

import math
from pathlib import Path

GRASPS = Path(__file__).parents[1] / "configs" / "grasp"
HANDLE = """M -7 -44 L -5 -24 C -5 -19 -10 -19 -20 -19 A 19 19 0 1 0 -3.5 9.4207 Q 0 5 3.5 9.4207
         A 19 19 0 1 0 20 -19 C 10 -19 5 -19 5 -24 L 7 -44 Z"""
"""Both bows and the root of the blades [mm], y down."""
BOTTLE = [(-27, -38), (-27, 8), (-26, 14), (-22, 21), (-16, 27), (-12, 33), (-11, 40), (-11, 50), (-13, 52), (-13, 58)]
"""The left half from the ground up [mm], y up."""
PIXELS, FINER = 4, 4
"""Pixels of the picture per mm, and how many times finer it is drawn."""
TEETH, ROOT, TIP = 12, 33.0, 40.0
"""Number of teeth of the gear, and its radii [mm]."""


def handle() -> None:
    size = 'width="90mm" height="90mm" viewBox="-45 -50 90 90" xmlns="http://www.w3.org/2000/svg"'
    (GRASPS / "scissors_handle.svg").write_text(f'<svg {size}>\n  <path id="handle" d="{HANDLE}"/>\n</svg>\n')


def bottle() -> None:
    from PIL import Image, ImageDraw

    each, width, height = PIXELS * FINER, 64, 106
    image = Image.new("L", (width * each, height * each), 255)
    corners = [*BOTTLE, *((-x, y) for x, y in reversed(BOTTLE))]
    ImageDraw.Draw(image).polygon([((x + 0.5 * width) * each, (63 - y) * each) for x, y in corners], fill=0)
    image.resize((width * PIXELS, height * PIXELS), Image.Resampling.BOX).save(GRASPS / "bottle.png", optimize=True)


def gear() -> None:
    import ezdxf

    drawing = ezdxf.new(units=ezdxf.units.MM)
    pitch, corners = math.tau / TEETH, []
    for tooth in range(TEETH):
        for radius, share in ((ROOT, -0.30), (TIP, -0.16), (TIP, 0.16), (ROOT, 0.30)):
            angle = pitch * (tooth + share)
            corners.append((radius * math.cos(angle), radius * math.sin(angle)))
    drawing.modelspace().add_lwpolyline(corners, close=True, dxfattribs={"layer": "gear"})
    drawing.saveas(GRASPS / "gear.dxf")


if __name__ == "__main__":
    handle()
    bottle()
    gear()
