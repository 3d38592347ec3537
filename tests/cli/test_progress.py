"""What is shown while work goes on; from inside: the clock and the patience of the display are replaced.

What is shown while work goes on: lines where there is no terminal, nothing when it is not wanted.
"""

from __future__ import annotations

import json
import logging
from types import SimpleNamespace

from continuum_grasp.cli import Output, progress
from tests.commands import ROOT, run

LOG = "continuum_grasp.core.compiler"


class Work:
    """Work that takes some seconds by a watch of its own, and reports its share where it knows it."""

    def __init__(self, seconds, shares):
        self.now, self.seconds, self.shares, self.before = 0.0, seconds, shares, 0.0
        self.progress = progress.Progress("working", start=0.0)

    def wait(self, seconds):
        self.now += seconds
        if self.shares:
            self.progress(self.before + (1.0 - self.before) * self.now / self.seconds)
        return self.now > self.seconds


def lines(monkeypatch, capsys, seconds, shares, before=0.0):
    work = Work(seconds, shares)
    work.before = before
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: work.now))
    progress._lines(work.progress, work)
    return capsys.readouterr().err.splitlines()


def test_short_work_shows_nothing(monkeypatch, capsys):
    assert lines(monkeypatch, capsys, 1.9, True) == []


def test_work_that_knows_its_share_shows_every_tenth(monkeypatch, capsys):
    assert lines(monkeypatch, capsys, 20.0, True) == [
        "working: 10 %, 2 s",
        *(f"working: {k} %, {k // 5} s, about {20 - k // 5} s left" for k in range(20, 100, 10)),
        "working: 100 %, 20 s",
    ]


def test_the_time_left_is_that_of_this_run_where_work_goes_on(monkeypatch, capsys):
    assert lines(monkeypatch, capsys, 20.0, True, before=0.5)[:2] == [
        "working: 55 %, 2 s",
        "working: 60 %, 4 s, about 16 s left",
    ]


def test_work_that_begins_once_more_has_a_time_of_its_own(monkeypatch, capsys):
    """As a motion with finer elements."""
    work = Work(1.0, False)
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: work.now))

    def wait(seconds):
        work.now += seconds
        work.progress((work.now if work.now < 10.0 else (work.now - 10.0) / 4.0) / 10.0)
        return work.now > 48.0

    monkeypatch.setattr(work, "wait", wait)
    progress._lines(work.progress, work)
    said = capsys.readouterr().err.splitlines()
    assert said[6:9] == [
        "working: 80 %, 8 s, about 2 s left",
        "working: 90 %, 9 s, about 1 s left",
        "working: 0 %, 10 s",
    ]
    assert "working: 50 %, 30 s, about 20 s left" in said


def test_long_work_shows_a_line_every_ten_seconds(monkeypatch, capsys):
    assert lines(monkeypatch, capsys, 25.0, False) == ["working: 2 s", "working: 12 s", "working: 22 s"]
    assert lines(monkeypatch, capsys, 2000.0, True)[:3] == [
        "working: 0 %, 2 s",
        "working: 1 %, 12 s, about 1988 s left",
        "working: 1 %, 22 s, about 1978 s left",
    ]


def test_json_alone_is_on_the_standard_output(monkeypatch, tmp_path):
    monkeypatch.setattr(progress, "_PATIENCE", 0.0)
    arguments = ["simulate", ROOT / "configs/simulate/hanging.yaml", "--no-pictures", "--out", tmp_path]
    done = run(*arguments, "--json")
    assert json.loads(done.stdout)["status"]
    assert "simulating: " in done.stderr
    assert run(*arguments, "--quiet").output == ""


def test_what_the_package_logs_is_shown_unless_quiet(capsys):
    for quiet in (False, True):
        with Output(quiet=quiet).busy("working"):
            logging.getLogger(LOG).info("compiling %s", "the model")
    logging.getLogger(LOG).info("no one listens")
    assert capsys.readouterr().err == "compiling the model\n"
