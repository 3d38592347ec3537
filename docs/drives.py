"""Figures and pictures of drives.md: ``OPENBLAS_NUM_THREADS=1 python -m docs.drives`` in the root of the repository."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

import continuum_grasp as cg
from benchmarks.bench_tendons import FORCES, TENSIONS, Chain, Reduced
from continuum_grasp.plotting import StyledAxes
from continuum_grasp.plotting.motion import plot_tension_loop, plot_tensions_along
from continuum_grasp.results import save_picture
from continuum_grasp.simulation import equilibrium_under
from tests.tendon_cases import bend, model, way

PICTURES = Path("docs/pictures")
LAWS = (("2 cells per element", 2, "C0", "-"), ("1 cell", 1, "C1", "-"), ("tension always falls", 0, "C7", "--"))


def save(figure, name: str) -> None:
    """As WebP without loss."""
    save_picture(figure, PICTURES / f"{name}.png", dpi=100)
    buffer = io.BytesIO()
    with Image.open(PICTURES / f"{name}.png") as picture:
        picture.convert("RGB").save(buffer, "WEBP", lossless=True, method=6)
    (PICTURES / f"{name}.png").unlink()
    (PICTURES / f"{name}.webp").write_bytes(buffer.getvalue())


def interval() -> None:
    """Bend at rest, pulled and released."""
    figure = StyledAxes.figure(6.4, 4.0)
    ax = figure.add_subplot()
    tensions = np.linspace(0.0, 15.0, 31)
    for k, friction in enumerate((0.1, 0.2)):
        made = model(friction, elements=4)
        ends = []
        for history in ("pulling", "releasing"):
            found = [equilibrium_under(made, [t, 0.0], [0.0, 0.0], reached_by=history) for t in tensions]
            ends.append([bend(made, one.q) for one in found])
        ax.fill_between(tensions, *ends, color=f"C{k}", alpha=0.3, label=f"friction {friction}")
        at = int(np.flatnonzero(tensions == 10.0)[0])
        print(f"10 N, friction {friction}: {ends[0][at]:.3f} rad pulled, {ends[1][at]:.3f} rad released")
    free = [bend(model(0.0), equilibrium_under(model(0.0), [t, 0.0], [0.0, 0.0]).q) for t in (0.0, 15.0)]
    ax.plot([0.0, 15.0], free, color="k", linewidth=1.0, label="no friction")
    ax.set_ylim(0.0, 3.2)
    StyledAxes(ax).label("tension at the drive [N]", "bend of the finger [rad]")
    ax.legend(loc="upper left", frameon=False)
    save(figure, "drives_interval")


def loops(friction: float = 0.3) -> None:
    """The laws beside a chain of guides."""
    figure = StyledAxes.figure(10.0, 4.2)
    pulls, pushes = way(TENSIONS[friction], 0.5), way(FORCES, 0.03)
    left, right = (figure.add_subplot(1, 2, k) for k in (1, 2))
    drawn = [("chain of 60 guides", None, "k", ":"), *LAWS]
    for name, cells, color, style in drawn:
        one = [Chain(friction, 60) if cells is None else Reduced(friction, 2, cells, None) for _ in range(2)]
        left.plot(
            pulls, [one[0].pull(t)[0] for t in pulls], style, color=color, label=name, zorder=4 if cells == 0 else 3
        )
        for tension in way([0.5, 12.0], 1.0):
            one[1].pull(tension)
        right.plot(pushes, [1e3 * one[1].pull(12.0, f)[1] for f in pushes], style, color=color)
    StyledAxes(left).label("tension at the drive [N]", "bend of the finger [rad]")
    StyledAxes(right).label("force on the tip, across the straight finger [N]", "place of the tip along it [mm]")
    left.legend(loc="lower right", frameon=False)
    save(figure, "drives_loops")


def winches() -> None:
    """The shipped example of two winches."""
    motion = cg.simulate(cg.load("configs/simulate/winch_loop.yaml"))
    figure = StyledAxes.figure(10.0, 4.2)
    plot_tension_loop(motion, ax=figure.add_subplot(1, 2, 1))
    plot_tensions_along(motion, ax=figure.add_subplot(1, 2, 2))
    save(figure, "drives_winches")
    print(f"two winches: {motion.statistics['method']}, {motion.statistics['substeps']} sub-steps; {motion.warnings}")


if __name__ == "__main__":
    interval()
    winches()
    loops()
