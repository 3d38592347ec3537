"""Take the outline of an object from a drawing: here half a disc from an SVG file.

By a theorem of Pappus its center of mass is 4 R / (3 pi) above the flat side.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

import continuum_grasp as cg
from continuum_grasp.plotting import plot_object

RADIUS = 0.04  # m
DRAWING = '<svg xmlns="http://www.w3.org/2000/svg"><path d="M -40 0 A 40 40 0 0 1 40 0 Z"/></svg>'
SCENE = """
schema_version: 1
finger:
  rod: {length: 0.18, linear_density: 0.034, bending_stiffness: 6.11e-3}
  half_thickness: 0.006
  tendons: {offset: 0.005, max_tension: 60.0}
  base: {position: [0.0, -0.06], angle: -90 deg}
object: {shape: outline, file: half_disc.svg, scale: 1 mm, mass: 0.2, position: [0.04, 0.0]}
supports: {palm: {type: palm, point: [0.0, 0.0], normal_angle: 0.0}}
contacts: {friction: 0.5, normal_force_max: 30.0, middle: on, tip: on}
gravity: [0.0, 0.0, -9.81]
"""


def main(out=None):
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "half_disc.svg").write_text(DRAWING)
        Path(folder, "scene.yaml").write_text(SCENE)
        body = cg.load(Path(folder, "scene.yaml")).object
    if out:
        plot_object(body).figure.savefig(out)
    corners = np.array(body.vertices)  # m, about the center of mass
    found, expected = -corners[:, 1].min(), 4.0 * RADIUS / (3.0 * np.pi)
    print(f"center of mass {1e3 * found:.4f} mm above the flat side, expected {1e3 * expected:.4f} mm")
    assert abs(found / expected - 1.0) < 1e-3
    return found, expected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
