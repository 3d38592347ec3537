"""Tables and picture of peers.md from the stored results of the benchmarks: ``python docs/peer_figures.py``, seconds.

It prints the rows that the page shows; ``tests/benchmarks/test_front_page.py`` compares page and README with them.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks/results"
PICTURE = ROOT / "docs/pictures/peers/error_and_time.webp"
RELEASES = {"peers": "released straight, damped", "peers_undamped": "released straight, no damping"}
"""Stored results, and what happens in them."""
LIBRARIES = {
    "this package": ("black", "o"),
    "MuJoCo": ("tab:blue", "s"),
    "PyElastica": ("tab:green", "D"),
    "SoRoMoX GVS": ("tab:red", "^"),
    "SoRoMoX": ("tab:orange", "v"),
    "JSRM": ("tab:purple", "P"),
}
"""Color and marker of each library; a row of a table belongs to the first whose name begins it."""


MOTIONS = "r.m.s. error of the tip [mm]"
"""Ending of the title of the table of motions."""


def stored(name: str) -> dict[str, Any]:
    """A page of results."""
    data: dict[str, Any] = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
    return data


def table(name: str, ending: str) -> list[dict[str, Any]]:
    """Rows of the one table whose title ends so, each by its columns."""
    (found,) = (one for one in stored(name)["tables"] if one["title"].endswith(ending))
    return [dict(zip(found["columns"], row, strict=True)) for row in found["rows"]]


def library(row: str) -> str:
    """The library of a row; ours are named by family alone."""
    return next((name for name in LIBRARIES if row.startswith(name)), "this package")


def short(name: str) -> str:
    """A contestant without layout, integrator, accuracy and steps."""
    name = re.sub(r", section ([\d.]+) times as thick", r", \1 times as thick", name)
    return re.sub(r" \(\w+\)|, [a-zA-Z]\w+(?=, \d)|, [\d.e-]+(?=, \d)|, \d+/s|, staggered", "", name)


def times(value: float) -> str:
    """Two digits."""
    return f"{float(f'{value:.2g}'):,.0f}" if value >= 10.0 else f"{value:.2g}"


def equal_errors(name: str) -> dict[str, tuple[float, str, float, float]]:
    """By short name of a peer: its error [mm], ours with no more, our error [mm], and how many times faster ours is.

    Settings of a library that another of its settings beats in error and in time are left out, and so are those with
    the short name of one that is better for the peer.
    """
    took = {row[""]: (row["r.m.s. error [mm]"], row["median [ns]"]) for row in table(name, "ms of motion")}
    found: dict[str, tuple[float, str, float, float]] = {}
    for row in table(name, "at equal error"):
        peer, error = row["peer"], row["its error [mm]"]
        rivals = (took[other] for other in took if library(other) == library(peer))
        surpassed = any(pair[0] < error and pair[1] < took[peer][1] for pair in rivals)
        factor, known = row["times as fast"], found.get(short(peer))
        if factor is not None and not surpassed and (known is None or factor < known[3]):
            own = short(row["our fastest with at most that"])
            found[short(peer)] = error, own, row["our error [mm]"], factor
    return found


def release_rows() -> list[str]:
    """Rows of "Motion of a rod"."""
    rows = []
    for name in RELEASES:
        for peer, (error, own, own_error, factor) in equal_errors(name).items():
            label = peer if name == "peers" else f"{peer}, undamped"
            rows.append(f"| {label} | {error:.2g} mm | {own}, {own_error:.2g} mm | {times(factor)} |")
    return rows


def acados_ranges() -> dict[tuple[str, bool], dict[str, tuple[float, float]]]:
    """By build, and whether bounds are hard: times [us] and ratios to ours, from the least to the most."""
    found: dict[tuple[str, bool], dict[str, tuple[float, float]]] = {}
    columns = ("median [us]", "times ours, scalar", "times ours, lanes")
    rows = [row for row in table("mpc_race", "loop: arcs") if row[""].startswith("acados")]
    for build in ("generic", "own"):
        for hard in (False, True):
            chosen = [row for row in rows if f", {build} " in row[""] and ("hard bounds" in row[""]) is hard]
            found[build, hard] = {
                name: (min(r[name] for r in chosen), max(r[name] for r in chosen)) for name in columns
            }
    return found


def between(pair: tuple[float, float]) -> str:
    """A range with two digits."""
    return " to ".join(times(value) for value in pair)


def mpc_rows() -> list[str]:
    """Rows of "Predictive control"."""
    named = {row[""]: row for row in table("mpc_race", "loop: arcs")}
    columns = ("median [us]", "times ours, scalar", "times ours, lanes")

    def one(label: str, name: str) -> str:
        middle, scalar, lanes = (times(named[name][column]) for column in columns)
        return f"| {label} | {middle} μs | {scalar} | {lanes} |"

    rows = [one("CasADi `sqpmethod` + `qrqp`, derivatives by CasADi", "sqpmethod + qrqp, own")]
    builds = {"generic": "generic C", "own": "own kernels"}
    for (build, hard), ranges in acados_ranges().items():
        posed = "hard bounds, linear least squares" if hard else "soft rows"
        middle, scalar, lanes = (between(ranges[column]) for column in columns)
        rows.append(f"| acados, {builds[build]}, {posed} | {middle} μs | {scalar} | {lanes} |")
    return [
        *rows,
        one("**this package, scalar**", "ours, scalar"),
        one("**this package, vector lanes**", "ours, lanes"),
    ]


def referee_rows() -> list[str]:
    """Rows of "An outside referee"."""
    held = {row[""]: row for row in table("referee", "force at the tip")}
    solvers = ("this package, 2 clothoids", "mujoco, 40 elements", "pyelastica, 40 elements")
    columns = ("error against the exact elastica", "tip deflection error")
    labels = ("a cantilever's tip, against the exact elastica", "the same, against the referee's linear theory")
    rows = [
        f"| {label} | {' | '.join(f'{held[solver][column]:.1g}' for solver in solvers)} |"
        for label, column in zip(labels, columns, strict=True)
    ]
    for modulus, words in ((1e6, "1 MPa"), (1e7, "10 MPa")):
        swung = {row[""]: row["period error"] for row in table("referee", f"{modulus:g} Pa, against linear theory")}
        chosen = (swung[f"{name} elements"] for name in ("mujoco, 50", "pyelastica, 50"))
        cells = [f"{value:.1g}" for value in (swung["this package, 8 clothoids"], *chosen)]
        rows.append(f"| the period of a cable of {words} | {' | '.join(cells)} |")
    return rows


def readme_words() -> list[str]:
    """What the README says of each peer: its error, and ours with its share of the time."""

    def one(name: str, peer: str) -> str:
        error, _, own, factor = equal_errors(name)[peer]
        return f"{error:.2g} mm off; **this: {own:.2g} mm in 1/{times(factor)} of the time**"

    def over_settings(name: str, beginning: str) -> str:
        factors = [found[3] for peer, found in equal_errors(name).items() if peer.startswith(beginning)]
        return f"(1/{times(min(factors))} to 1/{times(max(factors))} over its settings)"

    posed = {hard: acados_ranges()["own", hard] for hard in (True, False)}
    scalar, lanes = (between(posed[True][f"times ours, {own}"]) for own in ("scalar", "lanes"))
    soft = between(posed[False]["times ours, scalar"])
    elastica = one("peers_undamped", "PyElastica 20 elements, 10 times as thick")
    return [
        f"{elastica} {over_settings('peers_undamped', 'PyElastica')}",
        f"{one('peers', 'SoRoMoX GVS, 1 segment of order 1')} {over_settings('peers', 'SoRoMoX GVS')}",
        one("peers", "MuJoCo 10 hinges"),
        f"a step of equal cost takes {scalar} times as long as **this, scalar** ({lanes} times as long as vector "
        f"lanes); with soft rows as here {soft}",
    ]


def model_rows() -> list[str]:
    """Rows of the README's table of models."""
    errors, few = {}, {"arc": "2 arcs (the paper)", "matched_clothoid": "**2 matched clothoids**"}
    frequencies, motions = (
        {row["model"]: row for row in rows}
        for rows in (table("accuracy", "frequencies, per cent"), table("accuracy", MOTIONS))
    )
    for family, label in few.items():
        of, moved = frequencies[f"2 {family}"], motions[f"2 {family}"]["release, 20 g"]
        (count,) = (r["instructions dense"] for r in table("elements_few", f"dynamics, {family}") if r["elements"] == 2)
        cells = f"+{of['mode 1']:.2f} %", f"+{of['mode 2']:.3g} %", f"{moved:.2g} mm"
        bold = "**" if family != "arc" else ""
        errors[label] = [*(f"{bold}{cell}{bold}" for cell in cells), f"{count:.0f}"]
    return [f"| {label} | {' | '.join(cells)} |" for label, cells in errors.items()]


def points(name: str) -> dict[str, list[tuple[float, float]]]:
    """Time per second of motion [s] and error [mm] of all contestants, by library."""
    found: dict[str, list[tuple[float, float]]] = {}
    for row in table(name, "ms of motion"):
        found.setdefault(library(row[""]), []).append((1.0 / row["real-time factor"], row["r.m.s. error [mm]"]))
    return found


def draw() -> None:
    """One panel per release, both axes logarithmic."""
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, len(RELEASES), figsize=(9.6, 4.2), sharey=True, layout="constrained")
    for panel, (name, words) in zip(panels, RELEASES.items(), strict=True):
        for label, pairs in points(name).items():
            color, marker = LIBRARIES[label]
            panel.loglog(*zip(*pairs, strict=True), marker, color=color, label=label, linestyle="none")
        panel.set(title=f"0.6 m rod {words}", xlabel="time per second of motion, one thread [s]")
        panel.grid(alpha=0.3)
        panel.legend(fontsize=8)
    panels[0].set_ylabel("r.m.s. error of the tip [mm]")
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURE, dpi=110)


if __name__ == "__main__":
    print(*model_rows(), *readme_words(), *release_rows(), *mpc_rows(), *referee_rows(), sep="\n")
    draw()
