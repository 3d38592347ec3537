"""Progress on the error stream: a bar on a terminal, else lines; and notes on compiling."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

_PATIENCE = 2.0
"""After which anything is shown [s]: shorter work needs nothing."""
_SILENCE = 10.0
"""After which there is another line without a terminal [s], however little was done: a day of work is 8,640 lines."""


@dataclass
class Progress:
    """Display of progress: called with the share that is done, 0 to 1, or None where it is not known."""

    what: str
    share: float | None = None
    start: float = field(default_factory=time.monotonic)

    def __call__(self, share: float | None, what: str | None = None) -> None:
        """Note the share, and the current work where it says more than the work's name."""
        self.share = share
        self.what = what or self.what


@contextmanager
def shown(progress: Progress) -> Iterator[None]:
    """Show the progress of the work that is done within."""
    done = threading.Event()
    show = _bar if sys.stderr.isatty() else _lines
    watcher = threading.Thread(target=show, args=(progress, done), daemon=True)
    watcher.start()
    try:
        with _compiling_shown():
            yield
    finally:
        done.set()
        watcher.join()


def _lines(progress: Progress, done: threading.Event) -> None:
    """A line at first, with each tenth of the work, and after a while without one."""
    tenth = -1
    last = -_SILENCE
    wait = _PATIENCE
    # When a share was known, and that: work may go on from an earlier run, or begin once more.
    first: tuple[float, float] | None = None
    while not done.wait(wait):
        wait = 1.0
        now = time.monotonic() - progress.start
        share = progress.share
        if first and share is not None and share < first[1]:
            tenth = -1
            first = None
        if now - last < _SILENCE and int(10.0 * (share or 0.0)) <= tenth:
            continue
        tenth = int(10.0 * (share or 0.0))
        last = now
        known, left = "", ""
        if share is not None:
            first = first or (now, share)
            known = f"{100.0 * share:.0f} %, "
            if first[1] < share < 1.0:
                left = f", about {(now - first[0]) * (1.0 - share) / (share - first[1]):.0f} s left"
        _say(f"{progress.what}: {known}{now:.0f} s{left}")


def _bar(progress: Progress, done: threading.Event) -> None:
    if done.wait(_PATIENCE):
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bars

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Bars(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(progress.what, total=None)
        # The bar shows the time since the work began, not since it appeared.
        bars.tasks[0].start_time = bars.get_time() - (time.monotonic() - progress.start)
        while not done.wait(0.1):
            # None leaves the bar without a length, as of work that does not know its share.
            total = None if progress.share is None else 1.0
            bars.update(task, total=total, completed=progress.share, description=progress.what)


@contextmanager
def _compiling_shown() -> Iterator[None]:
    """Print what the package logs: what it compiles, and how long that takes."""
    import logging

    class Lines(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            _say(record.getMessage())

    log = logging.getLogger("continuum_grasp")
    lines = Lines(logging.INFO)
    level = log.level
    log.addHandler(lines)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.setLevel(level)
        log.removeHandler(lines)


def _say(text: str) -> None:
    with suppress(OSError):  # whoever read it has gone; the work matters more
        print(text, file=sys.stderr, flush=True)  # not typer.echo, which passes by what a bar puts in place
