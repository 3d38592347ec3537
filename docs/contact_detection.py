"""Picture of docs/contact_detection.md: a finger of a chain of guides bends, is pushed, and bends on.

Run ``python docs/contact_detection.py`` in the root of the repository (1 min).
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from continuum_grasp.control import ContactDetector, ResidualContact
from tests.contact_cases import NOISE, STEP, plant, scene

PUSH = 0.8, 1.1
"""When it is pushed [s]."""
FORCE = 0.25
"""Greatest force across the tip [N]."""
COLORS = {ResidualContact.UNCERTAIN: "#f2d16b", ResidualContact.DETECTED: "#e07a5f"}


def course(asked, **wrong):
    """Time, force, residual, bounds and verdict of a motion."""
    detector, driven, rng = ContactDetector(scene(0.1, detection=asked)), plant(**wrong), np.random.default_rng(0)
    rows, step = [], driven.chain.time_step
    for k in range(1, round(2.0 / step) + 1):
        t = k * step
        command = float(np.interp(t, [0.0, 0.4, 0.55, 0.7, 1.4, 1.6, 1.8], [0.0, 0.8, 0.8, 0.7, 0.7, 0.1, 0.5]))
        force = FORCE * float(np.interp(t, [PUSH[0], PUSH[0] + 0.1, PUSH[1] - 0.1, PUSH[1]], [0.0, 1.0, 1.0, 0.0]))
        driven.advance(command, -force)
        if k % round(detector.period / step) == 0:
            found = detector.step(driven.readings(STEP, NOISE, rng))
            rows.append((t, force, found.residual[0], *found.bounds[0], found.contact))
    return [np.array(column) for column in zip(*rows, strict=True)]


def main() -> None:
    """Draw the picture."""
    cases = {
        "defaults allowed: stiffness 20 %, tendon friction 50 %, dry friction 30 %; plant at these": (
            {},
            {"friction": 0.15, "stiffness": 0.8, "dry": 1.3},
        ),
        "identified: 2 %, 10 %, 10 % allowed; plant as the model states": (
            {"bending_stiffness": 0.02, "tendon_friction": 0.1, "coulomb_friction": 0.1, "tension": 0.03},
            {"friction": 0.1},
        ),
    }
    figure, axes = plt.subplots(2, 1, sharex=True, figsize=(8.0, 5.6), layout="constrained")
    for ax, (title, (asked, wrong)) in zip(axes, cases.items(), strict=True):
        t, force, residual, low, high, verdict = course(asked, **wrong)
        ax.fill_between(t, low, high, color="#b8cde0", label="residuals of a finger that touches nothing")
        ax.plot(t, residual, color="#22333b", lw=1.2, label="residual")
        for kind, color in COLORS.items():
            ax.fill_between(
                t,
                0,
                1,
                where=verdict == kind,
                color=color,
                alpha=0.35,
                lw=0,
                transform=ax.get_xaxis_transform(),
                label=kind.name.lower(),
            )
        ax.plot(t, 10.0 * force, color="#2a7f62", ls="--", lw=1.0, label="push at the tip [0.1 N]")
        ax.set_title(title, fontsize=9, loc="left")
        ax.set_ylabel("tension [N]")
        ax.grid(alpha=0.3)
    axes[1].legend(fontsize=8, loc="upper left")
    axes[1].set_xlabel("time [s]")
    folder = Path(__file__).parent / "pictures"
    figure.savefig(folder / "contact_detection.webp", dpi=110, pil_kwargs={"quality": 85})


if __name__ == "__main__":
    main()
