"""Sweeps at work: every scene gets its row once, whatever happens to workers, tables and the sweep itself."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest

from continuum_grasp import sweep, sweep_table
from continuum_grasp.base import InputError, Interrupted, SolverError
from continuum_grasp.results import read_run
from tests.sweep_cases import BROKEN, DEADLY, LOG, MUG, ROOT, STUCK, held, masses, slow


def with_threads(config, folder, **more):
    """The sweep in this process."""
    with ThreadPoolExecutor(1) as executor:
        return sweep(config, folder=folder, executor=executor, **{"evaluate": held, **more})


def calls(log):
    """How often each mass was evaluated."""
    return Counter(float(line.split()[1]) for line in log.read_text().splitlines())


def test_a_table_of_grasps(tmp_path):
    config = masses(30, record=["quality.epsilon", "statistics.starts"])
    reported = []
    table = sweep(config, folder=tmp_path, workers=2, evaluate=held, progress=lambda *now: reported.append(now))
    mass = np.arange(1.0, 31.0)
    assert table.finished
    assert len(table) == 30
    assert list(table["index"]) == list(range(30))
    assert list(table["object.mass"]) == list(mass)
    np.testing.assert_allclose(table["tension_max"], mass / 0.5, rtol=1e-15)
    np.testing.assert_allclose(table["tension_sum"], mass / 0.5 + 0.01, rtol=1e-15)
    assert set(table["normal_force_max"]) == {3.0}
    assert set(table["friction_margin"]) == {0.1}
    assert set(table["contacts"]) == {3}
    np.testing.assert_array_equal(table["quality.epsilon"], mass / 2)
    assert set(table["statistics.starts"]) == {2}
    assert table.counts == {"optimal": 30}
    assert len(set(table["scene"])) == 30
    assert read_run(table.run_folder(7)).arrays["mass"] == 8.0
    assert reported[-1] == (1.0, "30 of 30 (30 optimal)")
    rows = list(csv.DictReader((tmp_path / "table.csv").open(encoding="utf-8")))
    assert [float(row["tension_max"]) for row in rows] == list(table["tension_max"])
    assert [int(row["index"]) for row in rows] == list(range(30))


def test_failures_are_rows(tmp_path):
    inside = [[0.04, 0.0], [0.0, -0.055]]  # the first within the mug
    config = {
        "scene": str(MUG),
        "vary": {"finger.base.position": {"values": inside}, "object.mass": {"values": [0.3, STUCK, BROKEN]}},
    }
    table = with_threads(config, tmp_path)
    assert list(table["status"]) == ["invalid"] * 3 + ["optimal", "infeasible", "error"]
    assert list(table["reason"]) == [""] * 4 + ["too heavy", ""]
    assert "inside the object" in table["message"][0]
    assert table["message"][5] == "ZeroDivisionError: a bug"
    assert table["reason_needed"][4] == 0.5
    assert np.isnan(table["tension_max"][[0, 1, 2, 4, 5]]).all()
    assert list(table.solved) == [False] * 3 + [True] + [False] * 2
    assert table.failures == {"invalid": 3, "too heavy": 1, "error": 1}
    assert table["finger.base.position"][0] == "[0.04,0.0]"


@pytest.mark.deep
def test_a_scene_that_ends_its_process_is_a_row_and_no_other_is_lost(tmp_path, monkeypatch):
    monkeypatch.setenv(LOG, str(tmp_path / "log"))
    values = [1.0 + k for k in range(40)]
    values[5] = values[31] = DEADLY
    config = masses(1, vary={"object.mass": {"values": values}})
    table = sweep(config, folder=tmp_path / "out", workers=2, evaluate=held)
    assert [k for k, status in enumerate(table["status"]) if status != "optimal"] == [5, 31]
    assert list(table["status"][[5, 31]]) == ["crashed"] * 2
    assert "worker process died" in table["message"][5]
    assert calls(tmp_path / "log")[DEADLY] == 4  # each twice


@pytest.mark.deep
def test_the_same_rows_whoever_does_the_work(tmp_path):
    config = masses(20)
    made = [
        sweep(config, folder=tmp_path / "one", workers=1, evaluate=held),
        sweep(config, folder=tmp_path / "three", workers=3, evaluate=held),
        with_threads(config, tmp_path / "threads"),
    ]
    with ProcessPoolExecutor(2) as executor:
        made.append(sweep(config, folder=tmp_path / "pool", executor=executor, evaluate=held))
    for other in made[1:]:
        for name in set(made[0].columns) - {"seconds"}:
            np.testing.assert_array_equal(made[0][name], other[name])


@pytest.mark.parametrize("cut", [1, 2, 40, 10_000])
def test_a_torn_or_damaged_table_is_mended(cut, tmp_path, monkeypatch):
    config = masses(12)
    with_threads(config, tmp_path)
    whole = (tmp_path / "table.jsonl").read_bytes()
    lines = whole.splitlines(keepends=True)
    torn = b"".join(lines[:6])[:-cut] if cut < 10_000 else whole.replace(b'"optimal"', b'"OPTIMAL"', 1)
    (tmp_path / "table.jsonl").write_bytes(torn)
    monkeypatch.setenv(LOG, str(tmp_path / "log"))
    table = with_threads(config, tmp_path)
    assert list(table["index"]) == list(range(12))
    assert table.counts == {"optimal": 12}
    missing = 7 if cut < 10_000 else 1
    assert sum(calls(tmp_path / "log").values()) == missing
    # What is damaged in the middle stays where it is, beside its row made anew.
    rows = (tmp_path / "table.jsonl").read_bytes().splitlines()
    assert len(rows) == (12 if cut < 10_000 else 13)


def test_a_line_of_which_one_bit_is_wrong_is_computed_again(tmp_path, monkeypatch):
    config, table = masses(1), tmp_path / "table.jsonl"
    with_threads(config, tmp_path)
    line = table.read_bytes()
    for k in range(0, len(line) - 1, 11):
        table.write_bytes(line[:k] + bytes([line[k] ^ 1]) + line[k + 1 :])
        monkeypatch.setenv(LOG, str(tmp_path / f"log{k}"))
        assert with_threads(config, tmp_path).counts == {"optimal": 1}
        assert sum(calls(tmp_path / f"log{k}").values()) == 1


@pytest.mark.deep
def test_a_killed_sweep_goes_on_and_does_nothing_twice(tmp_path, monkeypatch):
    monkeypatch.setenv(LOG, str(tmp_path / "log"))
    folder = tmp_path / "out"
    command = [sys.executable, "-m", "tests.sweep_cases", str(folder)]
    for rows in (30, 90, 200):
        with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE) as process:
            wait_for_rows(folder, rows)
            process.kill()
        wait_until_gone(tmp_path / "log")
    assert with_threads(masses(400), folder, evaluate=slow).finished
    lines = (folder / "table.jsonl").read_bytes().splitlines(keepends=True)
    indices = [json.loads(line)["index"] for line in lines if line.endswith(b'"}\n')]
    assert sorted(indices) == list(range(400))
    in_hand = 3 * 2 * 25  # in each of three kills, what two workers had not handed in
    assert sum(calls(tmp_path / "log").values()) <= 400 + in_hand
    again = tmp_path / "log2"
    monkeypatch.setenv(LOG, str(again))
    assert with_threads(masses(400), folder, evaluate=slow).finished
    assert not again.exists()


def wait_for_rows(folder, count):
    until = time.monotonic() + 60
    while time.monotonic() < until:
        table = folder / "table.jsonl"
        if table.exists() and table.read_bytes().count(b"\n") >= count:
            return
        time.sleep(0.01)
    pytest.fail("no rows within a minute")


def wait_until_gone(log):
    """Until the workers of a killed sweep have ended, which they do by themselves."""
    workers = {int(line.split()[0]) for line in log.read_text().splitlines()}
    until = time.monotonic() + 20
    while time.monotonic() < until:
        if not any(alive(pid) for pid in workers):
            return
        time.sleep(0.05)
    pytest.fail("workers outlive the sweep that was killed")


def alive(pid):
    try:
        with open(f"/proc/{pid}/stat", encoding="ascii") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.deep
@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_stops_and_says_how_to_go_on(tmp_path):
    config = tmp_path / "sweep.yaml"
    config.write_text(
        f"schema_version: 1\nscene: {MUG}\nset: {{solver.effort: quick}}\n"
        "vary: {object.mass: {min: 0.1, max: 0.4, count: 2000}}\n",
        encoding="utf-8",
    )
    folder = tmp_path / "out"
    command = [sys.executable, "-m", "continuum_grasp", "sweep", str(config), "--out", str(folder), "--workers", "1"]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
        wait_for_rows(folder, 3)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=20)
    assert process.returncode == 130
    assert said.splitlines()[-1].startswith("interrupted: ")  # after lines of progress, where it took long
    assert f"of 2000 scenes are in {folder / 'table.jsonl'}; run the same command to resume" in said
    assert 3 <= len(sweep_table(folder)) < 2000


def test_interrupted_in_python(tmp_path):
    pressed = []

    def press(share, text):
        if share and not pressed:
            pressed.append(True)
            raise KeyboardInterrupt

    with pytest.raises(Interrupted, match=r"interrupted: \d+ of 300 scenes"):
        with_threads(masses(300), tmp_path, evaluate=slow, progress=press)
    assert 0 < len(sweep_table(tmp_path)) < 300


def test_a_folder_belongs_to_one_plan(tmp_path):
    with_threads(masses(3), tmp_path)
    with pytest.raises(InputError, match=r"another plan: scenes: 3 there, 4 here; vary.object.mass"):
        with_threads(masses(4), tmp_path)
    other = masses(3, maps=[{"x": "object.mass", "y": "contacts", "color": "tension_max"}])
    assert with_threads(other, tmp_path).requested["maps"][0]["y"] == "contacts"  # pictures are no part of it
    (tmp_path / "sweep.json").unlink()
    with pytest.raises(InputError, match=r"table.jsonl but no sweep.json"):
        with_threads(masses(3), tmp_path)


def test_one_sweep_at_a_time_in_a_folder(tmp_path):
    def another(*_):
        with pytest.raises(InputError, match="another sweep is using this folder"):
            with_threads(masses(3), tmp_path)

    assert sweep(masses(3), folder=tmp_path, executor=ThreadPoolExecutor(1), evaluate=held, progress=another).finished


@pytest.mark.parametrize(("keep", "stored"), [("all", {0, 1}), ("failed", {1}), ("none", set())])
def test_files_of_the_runs_that_are_wanted(keep, stored, tmp_path):
    table = with_threads(masses(1, vary={"object.mass": {"values": [1.0, STUCK]}}), tmp_path, keep=keep)
    assert {k for k in range(2) if (table.run_folder(k) / "result.npz").exists()} == stored


def test_leftovers_of_a_killed_sweep_are_replaced(tmp_path):
    table = with_threads(masses(2), tmp_path)
    (tmp_path / "table.jsonl").write_bytes(b"")
    for name in ("result.npz", ".tmp-result.npz"):
        (table.run_folder(0) / name).write_text("torn")
    table = with_threads(masses(2), tmp_path)
    assert [[file.name for file in table.run_folder(k).iterdir()] for k in range(2)] == [["result.npz"]] * 2
    assert read_run(table.run_folder(0)).arrays["mass"] == 1.0


def test_a_number_that_grasps_do_not_have_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"quality.epsilom: .*'epsilom' is not one of epsilon"):
        with_threads(masses(3, record=["quality.epsilom"]), tmp_path)


def test_an_executor_that_is_spent_stops_the_sweep(tmp_path):
    executor = ThreadPoolExecutor(1)
    executor.shutdown()
    with pytest.raises(SolverError, match="takes no more work"):
        sweep(masses(3), folder=tmp_path, executor=executor, evaluate=held)
    with ProcessPoolExecutor(1) as pool, pytest.raises(SolverError, match="resumes from there"):
        sweep(
            masses(1, vary={"object.mass": {"values": [DEADLY]}}), folder=tmp_path / "2", executor=pool, evaluate=held
        )


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"keep": "some"}, "keep: expected one of all, failed, none"),
        ({"workers": 0}, "workers: expected a whole number from 1 to 4096"),
        ({"scheduler": "tcp://127.0.0.1:1", "executor": ThreadPoolExecutor(1)}, "not both"),
        ({"folder": __file__}, "expected a folder, got a file"),
        ({"folder": None}, "needs a folder"),
    ],
)
def test_wrong_arguments(more, words, tmp_path):
    with pytest.raises(InputError, match=words):
        sweep(masses(3), **{"folder": tmp_path, "evaluate": held, **more})


def test_reading_a_folder_without_a_sweep(tmp_path):
    with pytest.raises(InputError, match="no sweep in this folder"):
        sweep_table(tmp_path)
    with pytest.raises(InputError, match="expected a sweep"):
        sweep(MUG, folder=tmp_path)
    with_threads(masses(3), tmp_path)
    with pytest.raises(InputError, match="no such column: 'tension_mox'; did you mean 'tension_max'"):
        sweep_table(tmp_path)["tension_mox"]
