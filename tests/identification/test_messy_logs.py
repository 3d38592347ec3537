"""Logs as benches write them, read as if written neatly, or refused; from inside: the check of lost readings."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.identification import IdentifyScene, Poses, Reading, TipPath, read_data
from continuum_grasp.addons.identification.lost import jumps, lost_of
from continuum_grasp.base import InputError
from tests.identification.test_comparison import LENGTH, ROD, on_arc

FINGER = {
    **ROD["finger"],
    "tendons": {"offset": 0.01, "max_tension": 10.0},
}
TENDONS = {**ROD, "finger": FINGER, "actuation": {"tensions": [1.0, 0.5]}}
COUNT = 60
T = 0.02 * np.arange(COUNT)
PULL = 1.0 + 0.5 * np.sin(3.0 * T)
X, Y = np.array([on_arc(0.01 * pull, LENGTH) for pull in PULL]).T + 1e-5 * np.random.default_rng(1).standard_normal(
    (2, COUNT)
)
EPOCH = 1_764_500_000
SETUP = {
    "kind": "trajectory",
    "t": "t",
    "conditions": [{"name": "tension_1", "column": "pull"}, {"name": "tension_2", "column": "other"}],
    "measured": [{"quantity": "x", "column": "x"}, {"quantity": "y", "column": "y"}],
}
HEADINGS = ("t", "pull", "other", "x", "y")
ROWS = [(f"{t:.2f}", f"{u:.6f}", "0.5", f"{x:.8f}", f"{y:.8f}") for t, u, x, y in zip(T, PULL, X, Y, strict=True)]


def text(rows=ROWS, headings=HEADINGS, between=",", end="\n"):
    return "".join(between.join(row) + end for row in (headings, *rows))


def read(tmp_path, content: str | bytes, changes=(), name="log.csv") -> TipPath:
    file = tmp_path / name
    file.write_bytes(content.encode() if isinstance(content, str) else content)
    (measured,) = read_data(IdentifyScene(**TENDONS, data=[SETUP]).changed(changes), [file])
    return measured


def arrays(measured: TipPath):
    """Instants, readings, and commands at the instants."""
    commands = [
        np.interp(measured.t, of.times, of.values) if not isinstance(of, float) else np.full(len(measured.t), of)
        for of in measured.scene.actuation.values
    ]
    return np.array([measured.t, *(reading.values for reading in measured.measured), *commands])


def column(k, change: Callable[[str], str]):
    return [(*row[:k], change(row[k]), *row[k + 1 :]) for row in ROWS]


def times(factor, digits=0, begin=0):
    return column(0, lambda cell: f"{begin + round(float(cell) * factor) if not digits else float(cell) * factor}")


def moved(*places):
    """Rows of which some change places."""
    rows = ROWS.copy()
    for a, b in places:
        rows[a], rows[b] = rows[b], rows[a]
    return rows


def headed(**names):
    return tuple(names.get(name, name) for name in HEADINGS)


SAME = {
    "seconds": text(),
    "nanoseconds": text(times(1e9), headed(t="t [ns]")),
    "nanoseconds since 1970": text(times(1e9, begin=EPOCH * 10**9), headed(t="t [ns]")),
    "nanoseconds behind the name": (text(times(1e9, begin=EPOCH * 10**9), headed(t="t_ns")), {"data[0].t": "t_ns"}),
    "microseconds since 1970": text(times(1e6, begin=EPOCH * 10**6), headed(t="t (us)")),
    "milliseconds since 1970": text(times(1e3, begin=EPOCH * 10**3), headed(t="t [msec]")),
    "seconds since 1970": text(column(0, lambda cell: f"{EPOCH + int(float(cell))}.{cell.partition('.')[2]}0000000")),
    "minutes": text(times(1 / 60, 9), headed(t="t [min]")),
    "dates": text(
        column(
            0,
            lambda cell: (
                f"2026-03-10 16:59:{59 + float(cell):05.2f}"
                if float(cell) < 1
                else f"2026-03-10T17:00:0{float(cell) - 1:.2f}"
            ),
        )
    ),
    "inches": text(
        [(*r[:3], *(f"{float(c) / 0.0254:.9f}" for c in r[3:])) for r in ROWS], headed(x="x [inch]", y='y ["]')
    ),
    "a line of units": text([("s", "N", "N", "m", "m"), *ROWS]),
    "millimeters behind the name": (
        text([(*r[:3], *(f"{1e3 * float(c):.6f}" for c in r[3:])) for r in ROWS], headed(x="x_mm", y="y / mm")),
        {"data[0].measured[0].column": "x_mm", "data[0].measured[1].column": "y / mm"},
    ),
    "micrometers with two letters": text(
        [(*r[:3], *(f"{1e6 * float(c):.3f}" for c in r[3:])) for r in ROWS], headed(x="x (µm)", y="y [μm]")
    ),
    "ounces": text(column(1, lambda cell: f"{float(cell) / 0.27801385095:.9f}"), headed(pull="pull [oz]")),
    "pounds": text(column(1, lambda cell: f"{float(cell) / 4.4482216152605:.9f}"), headed(pull="pull (lbf)")),
    "rows out of order": text(moved((3, 4), (20, 25), (40, 41))),
    "rows backwards": text(ROWS[::-1]),
    "rows at random": text([ROWS[k] for k in np.random.default_rng(2).permutation(COUNT)]),
    "a buffer that went round": text([*ROWS[25:], *ROWS[:25]]),
    "rows twice": text([*ROWS[:30], *ROWS[28:]]),
    "commands that hold": text([(r[0], r[1], "" if k else "0.5", *r[3:]) for k, r in enumerate(ROWS)]),
    "a command that comes later": text([(r[0], r[1], "0.5" if k > 9 else "nan", *r[3:]) for k, r in enumerate(ROWS)]),
    "commands out of order that hold": text(
        [(r[0], r[1], "0.5" if r[0] == "0.00" else "", *r[3:]) for r in ROWS[::-1]]
    ),
    "semicolons and commas": text(between=";").replace(".", ","),
    "tabs": text(between="\t"),
    "blanks": text(between="  "),
    "UTF-8 with a mark": b"\xef\xbb\xbf" + text().encode(),
    "lines of Windows": text(end="\r\n"),
    "lines of old Macs": text(end="\r"),
    "cells in quotes": text([tuple(f'"{cell}"' for cell in row) for row in ROWS], tuple(f'"{h}"' for h in HEADINGS)),
    "separator stated": "sep=;\n" + text(between=";"),
    "blanks around cells": text(between=" , "),
    "headings in capitals with blanks": text(headings=tuple(f" {h} " for h in HEADINGS)),
    "comments": "# bench 3\n" + text() + "# end\n",
    "numbers with a plus": text(column(1, lambda cell: f"+{cell}")),
    "a minus of typographers": text(column(3, lambda cell: cell.replace("-", "\u2212"))),
    "a column too many": text([(*row, "") for row in ROWS], (*HEADINGS, "")),
}


@pytest.mark.parametrize("case", SAME)
def test_the_same_log_in_other_words_is_the_same(tmp_path, case):
    content, changes = SAME[case] if isinstance(SAME[case], tuple) else (SAME[case], {})
    expected = np.array([T, X, Y, PULL, np.full(COUNT, 0.5)])
    assert arrays(read(tmp_path, content, changes)) == pytest.approx(expected, abs=2e-6)


NOTED = {
    "in order": (text(), []),
    "late": (
        text(moved((3, 4), (20, 25))),
        ["6 of 60 rows come after later ones: sorted by their instants in column t"],
    ),
    "twice": (
        text([*ROWS, *ROWS[-3:]]),
        ["3 of 63 rows repeat the instant of another in column t: the first of each counts"],
    ),
}


@pytest.mark.parametrize("case", NOTED)
def test_what_changed_is_reported(tmp_path, case):
    content, words = NOTED[case]
    notes = read(tmp_path, content).notes
    assert len(notes) >= len(words)
    assert all(any(each in note for note in notes) for each in words), notes


REFUSED = {
    "bars": (text(between=" | "), {}, "no column 't'; separate cells by commas"),
    "UTF-16": (text().encode("utf-16"), {}, "not UTF-8 text"),
    "exponents of Fortran": (
        text(column(1, lambda cell: cell + "D+00")),
        {},
        r"log.csv:2:6: column pull: expected a number",
    ),
    "two runs": (text([*ROWS, *ROWS[5:]]), {}, "log.csv:62:1: column t: a second run begins at number 61 of 115 rows"),
    "an instant is empty": (text([("", *ROWS[0][1:]), *ROWS[1:]]), {}, "log.csv:2:1: column t: the cell is empty"),
    "no command at all": (text([(*r[:2], "", *r[3:]) for r in ROWS]), {}, "column other: every cell is empty"),
    "no command before the first": (
        text([(r[0], r[1], "0.5" if k else "", *r[3:]) for k, r in enumerate(ROWS)]),
        {"actuation": None},
        "log.csv:2:15: column other: the cell is empty before the first command",
    ),
    "commas between commas": (text().replace(".", ","), {}, "expected 5 cells, got"),
    "units in cells": (text(column(3, lambda cell: f"{cell} m")), {}, r"write units in the heading: x \[m\]"),
    "a unit of something else": (
        text(headings=headed(x="x [N]")),
        {},
        "expected a unit like m, cm, mm, um, in, ft, mil, got 'N'",
    ),
    "a unit and a scale": (
        text(headings=headed(x="x_mm")),
        {"data[0].measured[0]": {"quantity": "x", "column": "x_mm", "scale": 0.001}},
        "column x_mm: its name states mm, and scale is 0.001; state the unit that scale applies to",
    ),
    "two units": (
        text(headings=headed(x="x [mm]")),
        {"data[0].measured[0]": {"quantity": "x", "column": "x", "unit": "inch"}},
        r"its heading says \[mm\], the configuration 'inch'",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_could_be_read_wrongly_is_refused_at_its_place(tmp_path, case):
    content, changes, words = REFUSED[case]
    with pytest.raises(InputError, match=words):
        read(tmp_path, content, changes)


def test_a_unit_may_be_spelled_otherwise_in_the_configuration(tmp_path):
    changes = {"data[0].measured[0]": {"quantity": "x", "column": "x", "unit": "inch"}}
    content = text(column(3, lambda cell: f"{float(cell) / 0.0254:.9f}"), headed(x="x [in]"))
    assert np.asarray(read(tmp_path, content, changes).measured[0].values) == pytest.approx(X, abs=1e-8)


def test_commands_hold_until_the_next_cell_and_begin_with_the_scene(tmp_path):
    """By a loop over the rows; the scene pulls with 1 N before the first command."""
    given = {3: 2.0, 7: 3.0, 30: 1.5}
    rows = [(row[0], f"{given[k]:g}" if k in given else "", *row[2:]) for k, row in enumerate(ROWS)]
    expected, last = [], 1.0
    for k in range(COUNT):
        last = given.get(k, last)
        expected.append(last)
    assert arrays(read(tmp_path, text(rows)))[3].tolist() == expected
    shuffled = [rows[k] for k in np.random.default_rng(3).permutation(COUNT)]
    assert arrays(read(tmp_path, text(shuffled)))[3].tolist() == expected


def test_conditions_of_shapes_at_rest_hold_where_rows_follow_one_another(tmp_path):
    def poses(sequence):
        given = {
            "kind": "static",
            "sequence": sequence,
            "conditions": [{"name": "tip_moment", "column": "M"}],
            "measured": [{"quantity": "x", "column": "x"}],
        }
        file = tmp_path / "rest.csv"
        file.write_text("M,x\n0.01,0.1\n,0.11\n0.02,0.12\n")
        (read_poses,) = read_data(IdentifyScene(**ROD, data=[given]), [file])
        return read_poses

    assert poses(True).conditions["tip_moment"].tolist() == [0.01, 0.01, 0.02]
    with pytest.raises(InputError, match=r"rest.csv:3:1: column M: the cell is empty; expected a number"):
        poses(False)


def compared(tmp_path, headings, rows, scene=None):
    file = tmp_path / "arc.csv"
    file.write_text(",".join(headings) + "\n" + "".join(",".join(row) + "\n" for row in rows))
    return cg.compare(scene or cg.Scene(**ROD), file)


ARC = [(f"{m:g}", *(f"{value:.9f}" for value in on_arc(m, LENGTH)), "7") for m in (0.005, 0.01, 0.015)]


def test_columns_that_nothing_reads_are_named(tmp_path):
    """The height may be called z: the same arc in three ways, against its closed form."""
    third = compared(tmp_path, ("tip_moment", "x", "y", "z"), ARC)
    assert third.warnings == ("arc.csv: nothing reads z",)
    height = compared(tmp_path, ("tip_moment", "x", "z", "note"), ARC)
    assert height.warnings == (
        "arc.csv: column z is read as the height y, since the table has none",
        "arc.csv: nothing reads note",
    )
    for found in (third, height):
        assert np.abs(found.residuals).max() < 1e-7
        assert found.measured.size == 6
    data = {
        "kind": "static",
        "conditions": [{"name": "tip_moment", "column": "M"}],
        "measured": [{"quantity": "x", "column": "x"}],
    }
    asked = IdentifyScene(**ROD, data=[data])
    chosen = compared(tmp_path, ("M", "x", "z", "note"), ARC, asked)
    assert chosen.warnings == ()
    assert chosen.statistics["unread"] == "arc.csv: z, note"


SENTINELS = {
    "zero": 0.0,
    "minus one": -1.0,
    "many nines": 9999.0,
    "the begin": (0.0, [0, 1, 2]),
    "the end": (-1.0, [57, 58, 59]),
}


@pytest.mark.parametrize("case", SENTINELS)
@pytest.mark.parametrize("mirrored", [False, True])
def test_lost_markers_are_named_and_only_they(case, mirrored):
    value, rows = SENTINELS[case] if isinstance(SENTINELS[case], tuple) else (SENTINELS[case], [10, 11, 12, 30, 44])
    x, y = (-X if mirrored else X).copy(), Y.copy()
    plain = TipPath(T, [Reading("x", x), Reading("y", y)])
    assert lost_of(plain) == []
    x[rows] = y[rows] = value
    assert np.flatnonzero(jumps(x, [y])).tolist() == rows
    named = lost_of(TipPath(T, [Reading("x", x), Reading("y", y)], name="log"))
    assert [each.text.partition(" readings")[0] for each in named] == [
        f"log: {axis} of tip: {len(rows)} of 60" for axis in "xy"
    ]


MOTIONS = {
    "a vibration that decays": lambda t: np.exp(-5.0 * t) * np.cos(20.0 * math.pi * t),
    "a fast vibration": lambda t: np.exp(-3.0 * t) * np.cos(48.0 * math.pi * t),
    "noise": lambda t: np.random.default_rng(0).standard_normal(t.size),
    "a step": lambda t: np.where(t > 1.0, 5.0, 0.0),
    "a pulse": lambda t: np.where((t > 1.0) & (t < 2.0), 5.0, 0.0),
    "a square wave": lambda t: np.sign(np.sin(7.0 * t)),
    "a coarse ruler": lambda t: np.round(3.0 * np.sin(5.0 * t)),
    "rest, then motion": lambda t: np.where(t > 1.0, np.sin(5.0 * (t - 1.0)), 0.0),
    "a jump from rest": lambda t: np.where(t > 1.0, 10.0 * np.exp(-10.0 * (t - 1.0)), 0.0),
}


@pytest.mark.parametrize("motion", MOTIONS)
def test_motions_that_are_sampled_are_not_taken_for_lost_markers(motion):
    t = 0.01 * np.arange(300)
    values = MOTIONS[motion](t)
    assert not jumps(values, [np.cos(t)]).any()
    lost = values.copy()
    lost[[50, 120, 121, 200]] = 9999.0
    assert np.flatnonzero(jumps(lost)).tolist() == [50, 120, 121, 200]


def test_a_sensor_that_freezes_is_named_and_one_that_is_slow_is_not():
    t = 0.01 * np.arange(300)
    x, y = 0.1 * np.sin(3.0 * t), 0.1 * np.cos(3.0 * t)

    def named(x):
        return [each.text for each in lost_of(TipPath(t, [Reading("x", x), Reading("y", y)]))]

    frozen = np.where((t >= 1.0) & (t < 1.5), x[100], x)
    assert named(frozen) == [
        "path: x of tip: 50 readings in a row are the same while the finger moves, as if the sensor froze: leave "
        "their cells empty"
    ]
    assert named(np.repeat(x[::30], 30)) == []


def test_shapes_at_rest_that_are_the_same_under_different_loads_are_named():
    moments = np.linspace(0.005, 0.02, 8)
    x, y = np.array([on_arc(m, LENGTH) for m in moments]).T

    def named(x, y, moments):
        return [each.text for each in lost_of(Poses([Reading("x", x), Reading("y", y)], {"tip_moment": moments}))]

    assert named(x, y, moments) == []
    x[[2, 5]] = y[[2, 5]] = 0.0
    assert [text.partition(" have")[0] for text in named(x, y, moments)] == ["poses: rows 3, 6"]
    assert named(x, y, np.where(np.isin(np.arange(8), [2, 5]), 0.01, moments)) == []


@pytest.mark.deep
@pytest.mark.parametrize("case", ["late", "commands that hold"])
def test_the_stiffness_of_a_messy_log_is_that_of_the_finger(tmp_path, case):
    """A simulated finger of 5.4e-3 N m2, whose log begins an estimation at 6.5e-3 N m2."""
    commands = {"times": T.tolist(), "values": [4.0 * pull for pull in PULL]}
    stiff = {
        "rod": {"length": LENGTH, "linear_density": 0.02, "bending_stiffness": 5.4e-3},
        "damping": {"material": 1e-5},
    }
    finger = {**stiff, "tendons": {"offset": 0.005, "max_tension": 50.0}}
    plain = {"finger": finger, "gravity": (0.0, 0.0), "initial": {"pose": "equilibrium"}}
    motion = cg.simulate(
        cg.Scene(**plain, actuation={"tensions": [commands, 0.0]}, time={"duration": float(T[-1]), "step": 0.02})
    )
    rows = [
        (f"{t:.2f}", f"{u:.7f}" if k % 6 == 0 or case == "late" else "", "0" if k == 0 else "", f"{x:.8f}", f"{y:.8f}")
        for k, (t, u, (x, y)) in enumerate(zip(T, commands["values"], motion.tip, strict=True))
    ]
    soft = {**finger, "rod": {**stiff["rod"], "bending_stiffness": 6.5e-3}}
    rest = {"actuation": {"tensions": [4.0, 0.0]}, "estimate": [{"name": "bending_stiffness"}]}
    scene = IdentifyScene(**{**plain, "finger": soft}, **rest, data=[SETUP])
    file = tmp_path / "log.csv"
    file.write_text(text([rows[k] for k in (*range(30), 31, 30, *range(32, COUNT))]))
    fit = cg.identify(scene, file)
    assert fit["bending_stiffness"] == pytest.approx(5.4e-3, rel=2e-3 if case == "late" else 0.03)
    assert any("come after later ones" in warning for warning in fit.warnings)
