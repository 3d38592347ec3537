"""Call the finger from your own C program, which CMake builds with the exported package as a subdirectory.

Needs cmake and a C compiler. A curvature of pi / (2 L) all along bends the finger to a quarter of a circle, with its
tip 2 L / pi above the base.
"""

import argparse
import shutil
import subprocess
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import continuum_grasp as cg

LENGTH = 0.2  # m
CMAKE = """cmake_minimum_required(VERSION 3.15)
project(mine C)
add_subdirectory(finger)
add_executable(mine main.c)
target_link_libraries(mine PRIVATE finger::finger)"""
MAIN = """#include <finger.h>
#include <stdio.h>
int main(void) {
  const finger_state state = {7.853981633974483, 7.853981633974483, 7.853981633974483};
  finger_model model; finger_input input = {0}; finger_section section;
  finger_init(&model);
  for (int i = 0; i <= 20 && finger_section_at(&model, &state, &input, 0.01 * i, &section) >= 0; i++)
    printf("%.12f %.12f\\n", section.x, section.y);
}"""


def main(out=None):
    if shutil.which("cmake") is None:
        raise SystemExit("this example needs cmake: pip install cmake")
    finger = cg.Finger(rod=cg.Rod(length=LENGTH, linear_density=0.03, bending_stiffness=6e-3))
    with tempfile.TemporaryDirectory() as folder:
        cg.export_c(cg.FingerModel(finger, family="clothoid", elements=2), f"{folder}/finger", what=["kinematics"])
        for name, text in (("CMakeLists.txt", CMAKE), ("main.c", MAIN)):
            Path(folder, name).write_text(text)
        for line in ("cmake -B build", "cmake --build build", "./build/mine"):
            done = subprocess.run(line.split(), cwd=folder, check=True, capture_output=True, text=True)
    points = np.array(done.stdout.split(), dtype=float).reshape(-1, 2)
    plt.figure(figsize=(3.2, 3.2), layout="constrained")
    plt.plot(*(1e3 * points).T, "o-")
    plt.gca().set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    if out:
        plt.savefig(out)
    found, expected = points[-1, 1], 2.0 * LENGTH / np.pi
    print(f"tip {1e3 * found:.6f} mm above the base, expected {1e3 * expected:.6f} mm")
    assert abs(found / expected - 1.0) < 1e-6
    return found, expected


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="file for the picture")
    main(**vars(parser.parse_args()))
