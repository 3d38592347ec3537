"""How far a run of tests is, and which tests its tier leaves out, as lines in the terminal."""

from __future__ import annotations

import time
from collections import Counter
from typing import Any

import pytest

from tests.tiers import LEFT_OUT

EVERY = 20.0
"""Time between two lines about the remaining time [s]."""


class Remaining:
    """Report the remaining time of a run, on one process or from the controller of several workers."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._count = 0
        self._done = 0
        self._first = self._said = time.monotonic()
        self._left_out = Counter[str]()

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        self._begin(len(session.items), self._config.stash.get(LEFT_OUT, Counter()))

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_node_collection_finished(self, node: Any, ids: list[str]) -> None:
        """Begin when the first worker has collected; all collect the same tests."""
        if self._count == 0:
            self._begin(len(ids), self._left_out)

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any, error: Any) -> None:
        self._left_out = Counter(getattr(node, "workeroutput", {}).get("left_out", self._left_out))

    def _begin(self, count: int, left_out: Counter[str]) -> None:
        self._count = count
        self._left_out = left_out
        self._first = self._said = time.monotonic()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when != "teardown":
            return
        self._done += 1
        now = time.monotonic()
        if now < self._said + EVERY or self._done >= self._count:
            return
        self._said = now
        left = (now - self._first) / self._done * (self._count - self._done)
        text = f"{left / 60.0:.0f} min" if left > 90.0 else f"{left:.0f} s"
        self._line(f"{self._done} of {self._count} tests, about {text} left")

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        if self._config.getoption("tier") != "first" or not self._left_out:
            return
        terminalreporter.section("first tier")
        folders = ", ".join(f"{folder} {count}" for folder, count in sorted(self._left_out.items()))
        terminalreporter.write_line(
            f"{self._done} tests, at least one of each file. Left out until the second tier (--tier rest): "
            f"{self._left_out.total()} quick tests ({folders}). Deep tests run with -m deep alone."
        )

    def _line(self, text: str) -> None:
        reporter = self._config.pluginmanager.get_plugin("terminalreporter")
        if reporter is not None:
            reporter.ensure_newline()
            reporter.write_line(text)


def pytest_configure(config: pytest.Config) -> None:
    """Report from the one process that writes to the terminal."""
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Remaining(config), "remaining")


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Send the controller what this worker left out."""
    output = getattr(session.config, "workeroutput", None)
    if output is not None and LEFT_OUT in session.config.stash:
        output["left_out"] = dict(session.config.stash[LEFT_OUT])
