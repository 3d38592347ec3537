"""Draw what ``reach`` wrote: python plot.py reach.csv reach.png."""

from __future__ import annotations

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np


def main(source: str, target: str) -> None:
    """Draw the tip, the tensions and the estimated moment over time."""
    rows = np.genfromtxt(source, delimiter=",", names=True, deletechars="", replace_space=" ")
    time = rows["time [s]"]
    figure, (tip, tension, moment) = plt.subplots(3, 1, sharex=True, figsize=(6.0, 7.0), layout="constrained")
    for axis in "xy":
        line = tip.plot(time, 1e3 * rows[f"tip {axis} [m]"], label=axis)[0]
        tip.plot(time, 1e3 * rows[f"target {axis} [m]"], color=line.get_color(), linestyle="--")
    tip.set_ylabel("tip [mm]")
    tip.legend(title="dashed: target")
    for k in (1, 2):
        tension.step(time, rows[f"tension {k} [N]"], where="post", label=f"tendon {k}")
    tension.set_ylabel("tension [N]")
    tension.legend()
    moment.plot(time, 1e3 * rows["missing moment [N m]"])
    moment.set_ylabel("missing moment [N mm]")
    for plot in (tip, tension, moment):
        blind = time[rows["anomalies"] % 2 == 1]
        plot.axvspan(blind[0], blind[-1], color="0.9")
    moment.set_xlabel("time [s]")
    figure.savefig(target, dpi=120)


if __name__ == "__main__":
    main(*sys.argv[1:])
