"""Frames per second of the shipped pages in real time, while something in them is dragged.

Run ``python -m benchmarks.bench_pages`` in the root of the repository (3 min on a quiet machine), with the extra test,
which has playwright, and Chromium; ``--browser firefox`` needs Firefox and ``pip install marionette_driver`` instead.
Each page of ``docs/live`` runs headless in windows of three widths. The mouse holds the target, the mug or the tip of
the rod, and leads it round a circle; times are those that ``requestAnimationFrame`` gives.
"""

from __future__ import annotations

import math
import shutil
import time
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import ROOT
from benchmarks.report import begun

PAGES = ROOT / "docs" / "live"
WIDTHS = (390, 900, 1280)
HEIGHT = 1100
"""Of the windows, as the widths in CSS pixels: the finger of every page is inside."""
READY = """window.page !== undefined && page.world.origin !== undefined
  && page.world.time > (page.controller?.mission?.begin[4] ?? 0.3)"""
"""A mission has lifted its object by then."""
HELD = """(() => {
  const at = page.plant.object?.state ?? null, last = page.memory.section_x.length - 1;
  if (page.world.target) return page.world.target;
  return at !== null ? [...page.memory.x.slice(at, at + 2)] : page.section(last);
})()"""
"""What the mouse takes hold of: the target, else an object that moves, else the tip [m]."""
RECORD = """(() => {
  window.seen = [];
  const note = (now) => { seen.push(now); requestAnimationFrame(note); };
  requestAnimationFrame(note);
})()"""
CIRCLE, TURN = 0.06, 2.0
"""Radius of the circle per length of the finger, and time of a turn [s]."""
LATE = 20.0
"""A frame that comes later than a fiftieth of a second after the one before [ms]."""


class Chromium:
    """Headless Chromium by playwright."""

    def __init__(self, binary: str | None) -> None:
        from playwright.sync_api import sync_playwright

        self.driver = sync_playwright().start()
        program = binary or shutil.which("chromium") or shutil.which("google-chrome")
        self.browser = self.driver.chromium.launch(executable_path=program, args=["--no-sandbox"])
        self.version = f"Chromium {self.browser.version}"
        self.page = self.browser.new_page()

    def open(self, file: Path, width: int) -> None:
        """Open a page in a window of its own."""
        self.page.close()
        self.page = self.browser.new_page(viewport={"width": width, "height": HEIGHT})
        self.page.goto(file.as_uri())

    def ask(self, script: str) -> Any:
        """Value of an expression in the page."""
        return self.page.evaluate(script)

    def move(self, x: float, y: float) -> None:
        """Move the mouse to a place in the window."""
        self.page.mouse.move(x, y)

    def press(self, down: bool) -> None:
        """Press the mouse's button, or release it."""
        self.page.mouse.down() if down else self.page.mouse.up()

    def close(self) -> None:
        """End the browser."""
        self.browser.close()
        self.driver.stop()


class Firefox:
    """Headless Firefox by Mozilla's own driver."""

    def __init__(self, binary: str | None) -> None:
        from marionette_driver.marionette import Marionette

        program = binary or shutil.which("firefox") or shutil.which("firefox-esr")
        self.browser = Marionette(bin=program, headless=True)
        self.version = f"Firefox {self.browser.start_session()['browserVersion']}"

    def open(self, file: Path, width: int) -> None:
        """Open a page in a window of this width, or of 500 px, which windows of Firefox have at least."""
        frame = self.browser.execute_script("return outerHeight - innerHeight")
        self.browser.set_window_rect(width=width, height=HEIGHT + frame)
        self.browser.navigate(file.as_uri())

    def ask(self, script: str) -> Any:
        """Value of an expression in the page."""
        return self.browser.execute_script(f"return {script}", sandbox=None)

    def _mouse(self) -> Any:
        return self.browser.actions.sequence("pointer", "mouse", {"pointerType": "mouse"})

    def move(self, x: float, y: float) -> None:
        """Move the mouse to a place in the window."""
        self._mouse().pointer_move(round(x), round(y)).perform()

    def press(self, down: bool) -> None:
        """Press the mouse's button, or release it."""
        (self._mouse().pointer_down() if down else self._mouse().pointer_up()).perform()

    def close(self) -> None:
        """End the browser."""
        self.browser.quit()


def drag(browser: Chromium | Firefox, file: Path, width: int, seconds: float) -> list[Any]:
    """Frames of a page while something in it is dragged."""
    browser.open(file, width)
    patience = time.monotonic() + 60.0
    while not browser.ask(f"Boolean({READY})"):
        if time.monotonic() > patience:
            raise RuntimeError(f"{file.name} does not run in {browser.version}")
        time.sleep(0.1)
    inside = browser.ask("innerWidth")
    x, y = browser.ask(HELD)
    radius, moves = CIRCLE * browser.ask("page.plant.length"), 0

    def to(angle: float) -> None:
        browser.move(
            *browser.ask(f"page.toScreen({x + radius * math.sin(angle)}, {y + radius * (math.cos(angle) - 1)})")
        )

    to(0.0)
    browser.press(True)
    browser.ask(RECORD)
    began = time.monotonic()
    while (passed := time.monotonic() - began) < seconds:
        to(2.0 * math.pi * passed / TURN)
        moves += 1
        time.sleep(0.01)
    # The page's own share of real time: a mug that is lost starts its time anew.
    share, frames = browser.ask("[page.world.real, seen]")
    browser.press(False)
    gaps = np.diff(np.array(frames))
    real = (frames[-1] - frames[0]) / 1e3
    shares = [float(np.quantile(gaps, q)) for q in (0.5, 0.95, 1.0)]
    late = 100.0 * float(np.mean(gaps > LATE))
    return [file.stem, inside, len(gaps) / real, *shares, late, share, moves / seconds]


def main() -> None:
    asked, report = begun(
        __doc__,
        lambda asked: "pages" if asked.browser == "chromium" else "pages_firefox",
        browser=("chromium", "", ("chromium", "firefox")),
        binary=(str, "program of the browser"),
        seconds=(10.0, "of each page and width"),
    )
    browser = (Chromium if asked.browser == "chromium" else Firefox)(asked.binary)
    columns = ["page", "width [px]", "frames/s", "frame, median [ms]", "95 % [ms]", "worst [ms]"]
    columns += [f"later than {LATE:g} ms [%]", "simulated s per s", "moves of the mouse/s"]
    note = f"Headless {browser.version}, {asked.seconds:g} s each, {HEIGHT} px high, while the mouse drags."
    table = report.table("Frames of the pages in real time", columns, note=note)
    for file, width in product(sorted(PAGES.glob("*.html")), WIDTHS):
        table.add(*drag(browser, file, width, asked.seconds))
    browser.close()
    report.claim("frames/s, least of all", min(row[2] for row in table.rows), ">=", 50.0)
    report.claim("simulated seconds per second, least of all", min(row[7] for row in table.rows), ">=", 0.98)
    report.finish()


if __name__ == "__main__":
    main()
