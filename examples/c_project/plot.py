"""Draw what ``reach`` wrote: python plot.py reach.csv reach.png."""

from __future__ import annotations

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np


def main(source: str, target: str) -> None:
    """Draw the tip and the tensions over time."""
    rows = np.genfromtxt(source, delimiter=",", names=True, deletechars="", replace_space=" ")
    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(6.0, 5.0), layout="constrained")
    above.plot(rows["time [s]"], 1e3 * rows["tip x [m]"])
    above.axhline(-60.0, color="0.6", linestyle="--", label="target")
    above.set_ylabel("tip x [mm]")
    above.legend()
    for k in (1, 2):
        below.plot(rows["time [s]"], rows[f"tension {k} [N]"], label=f"tendon {k}")
    below.set_xlabel("time [s]")
    below.set_ylabel("tension [N]")
    below.legend()
    figure.savefig(target, dpi=120)


if __name__ == "__main__":
    main(*sys.argv[1:])
