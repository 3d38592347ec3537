"""Figures and pictures of theory.md: ``python docs/theory.py`` in the root of the repository, half a minute."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
from scipy import optimize, special

import continuum_grasp as cg
from continuum_grasp.plotting import Color, StyledAxes
from continuum_grasp.results import save_picture
from continuum_grasp.rod import solve_elastica

PICTURES = Path(__file__).parent / "pictures"
UNIT = {"length": 1.0, "linear_density": 1.0, "bending_stiffness": 1.0}
EULER = math.pi**2 / 4
FAMILIES = {
    "arc": ("arcs", Color.ORANGE),
    "clothoid": ("clothoids", Color.GREEN),
    "matched_clothoid": ("matched clothoids", Color.BLUE),
}
DPI = 110.0
"""A page shows them 700 to 900 pixels wide."""


def rod(family: str, elements: int, angle: float, **keys: Any) -> cg.Scene:
    """The unit rod, clamped at a base angle [rad]."""
    finger = {"rod": UNIT, "base": {"position": [0.0, 0.0], "angle": angle}}
    # evaluated far more exactly than any of them is
    fidelity = {"family": family, "elements": elements, "bending_range": 4.0, "accuracy": 1e-12}
    given = {"schema_version": 1, "finger": finger, "gravity": (0.0, 0.0), "fidelity": fidelity, **keys}
    return cg.Scene.model_validate(given)


def pushed(family: str, elements: int, load: float) -> cg.Scene:
    """With a force across it at its tip."""
    return rod(family, elements, -math.pi / 2, loads=[{"kind": "force", "at": 1.0, "force": [0.0, load]}])


def pressed(family: str, elements: int, load: float) -> cg.Scene:
    """With a force along it against its tip."""
    return rod(family, elements, 0.0, loads=[{"kind": "force", "at": 1.0, "force": [0.0, -load]}])


def draw_curvature() -> None:
    """Curvature of exact rod and models, and how far their shapes are from the exact one."""
    exact = solve_elastica(pushed("arc", 2, 2.0))
    s = np.linspace(0.0, 1.0, 401)
    figure = StyledAxes.figure(6.4, 5.0)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    above.plot(s, exact.curvature(s), color=Color.INK, linewidth=3.0, alpha=0.35, label="exact rod")
    for family in ("arc", "matched_clothoid"):
        found = cg.equilibrium(pushed(family, 2, 2.0))
        name, color = FAMILIES[family]
        kappa, at, _ = (np.array(value) for value in found.model.curvatures()(found.q, found.u, found.p))
        for k, start in enumerate((0.0, 0.5)):
            ends = (at[0, k], at[-1, k])
            above.plot([start, start + 0.5], ends, color=color, label=f"2 {name}" if k == 0 else None)
        if family != "arc":
            above.plot([0.0, 0.5, 1.0], kappa.ravel(), "o", color=color, markersize=4)
        away = np.linalg.norm(found.backbone(len(s)) - exact.position(s), axis=1)
        below.semilogy(s[1:], away[1:], color=color)
        print(f"curvature: 2 {name}, tip {away[-1]:.2g} L off")
    StyledAxes(above).label("", "curvature [1/L]")
    StyledAxes(below).label("position along the rod [L]", "distance from\nthe exact shape [L]")
    below.set_ylim(1e-6, 1e-1)
    above.legend(frameon=False, fontsize=9)
    save_picture(figure, PICTURES / "theory_curvature.png", dpi=DPI)


def inertia(theta: Any, math_: Any) -> Any:
    """Closed form of integral (10), with the sine and cosine of a library."""
    s, c = math_.sin(theta), math_.cos(theta)
    return 1 / (3 * theta**2) + 2 * (c + 1) / theta**4 - 4 * s / theta**5


def draw_digits() -> None:
    """Relative error of the inertia of an arc, by its closed form and by the model, in double precision."""
    angles = np.geomspace(1e-4, 2.0, 240)
    mpmath.mp.dps = 50
    truth = np.array([float(inertia(mpmath.mpf(float(a)), mpmath)) for a in angles])
    model = cg.FingerModel(rod("arc", 1, 0.0), tip_force=False)
    ours = np.array([float(model.mass_matrix([a], [0.0], [])) for a in angles])
    errors = {
        "closed form": (np.abs(inertia(angles, np) / truth - 1.0), Color.ORANGE),
        "Stumpff functions": (np.abs(ours / truth - 1.0), Color.BLUE),
    }
    figure = StyledAxes.figure(6.4, 3.4)
    ax = figure.add_subplot()
    for name, (error, color) in errors.items():
        # below the last bit there is nothing to see
        ax.loglog(angles, np.maximum(error, 5e-17), ".", color=color, markersize=4, label=name)
        print(f"digits: {name}, worst {error.max():.2g}, {error[0]:.2g} at 1e-4 rad")
    ax.set_ylim(2e-17, 1e4)
    StyledAxes(ax).label("bending angle [rad]", "relative error [1]")
    ax.legend(frameon=False, fontsize=9)
    save_picture(figure, PICTURES / "theory_digits.png", dpi=DPI)


def buckled(slope: float) -> tuple[float, float]:
    """Load of the unit column whose tip has turned by an angle [rad], and how far the tip is aside."""
    m = math.sin(slope / 2.0) ** 2
    whole = special.ellipk(m)
    return whole**2, 2.0 * math.sqrt(m) / whole


def draw_buckling() -> None:
    """Tip of the column over the load, exact and of two models."""
    figure = StyledAxes.figure(6.4, 3.6)
    ax = figure.add_subplot()
    exact = np.array([(EULER, 0.0), *(buckled(slope) for slope in np.linspace(0.02, 2.2, 80))])
    ax.plot(exact[:, 0] / EULER, exact[:, 1], color=Color.INK, linewidth=3.0, alpha=0.35, label="exact rod")
    for family in ("arc", "matched_clothoid"):
        name, color = FAMILIES[family]

        def margin(load: float, family: str = family) -> float:
            return cg.equilibrium(pressed(family, 2, load), stable=False).margin

        critical = optimize.brentq(margin, 0.8 * EULER, 1.2 * EULER, xtol=1e-9) / EULER
        # close to the critical load the tip moves like a square root
        loads = critical + (exact[-1, 0] / EULER - critical) * np.linspace(0.06, 1.0, 40) ** 2
        aside = [abs(cg.equilibrium(pressed(family, 2, load * EULER)).tip[0]) for load in loads]
        ax.plot([0.9, critical, *loads], [0.0, 0.0, *aside], color=color, label=f"2 {name}")
        print(f"buckling: 2 {name}, critical load {100 * (critical - 1):+.3f} %")
    StyledAxes(ax).label("load [Euler's load]", "tip aside [L]")
    ax.set_xlim(0.9, 1.6)
    ax.legend(frameon=False, fontsize=9, loc="lower right")
    save_picture(figure, PICTURES / "theory_buckling.png", dpi=DPI)


def draw_convergence() -> None:
    """Errors of first frequency and static tip over the number of elements."""
    beam = 1.8751040687119611**2 / math.tau
    tip = solve_elastica(pushed("arc", 2, 2.0)).tip
    counts = np.array([1, 2, 3, 4, 6, 8, 12, 16])
    figure = StyledAxes.figure(8.4, 3.8)
    left, right = figure.subplots(1, 2)
    for family, (name, color) in FAMILIES.items():
        frequencies, tips = [], []
        for count in counts.tolist():
            found = cg.modes(rod(family, count, -math.pi / 2)).frequencies_hz[0]
            frequencies.append(abs(found / beam - 1.0))
            tips.append(float(np.linalg.norm(cg.equilibrium(pushed(family, count, 2.0)).tip - tip)))
        for ax, errors in ((left, frequencies), (right, tips)):
            ax.loglog(counts, errors, "o-", color=color, markersize=4, label=name)
        print(f"convergence: {name}", np.array(frequencies), np.array(tips))
    for ax, starts in ((left, (3e-1, 2e-3)), (right, (3e-1, 3e-3))):
        for order, start in zip((2, 4), starts, strict=True):
            ax.loglog(counts, start / counts**order, color=Color.GRAY, linewidth=0.8, linestyle="--", zorder=1)
        ax.set_xticks(counts, [f"{count}" for count in counts])
        ax.minorticks_off()
    StyledAxes(left).label("elements", "error of the first frequency [1]")
    StyledAxes(right).label("elements", "error of the tip [L]")
    left.legend(frameon=False, fontsize=9)
    save_picture(figure, PICTURES / "theory_convergence.png", dpi=DPI)


if __name__ == "__main__":
    draw_curvature()
    draw_digits()
    draw_buckling()
    draw_convergence()
