"""The report in a browser, of every status; from inside: verdicts of stability and pictures made here are put in.

The report in a browser: Chromium lays out pages of every status, wide and narrow, light and dark, and measures.
"""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from continuum_grasp.grasp import GraspResult, GraspStatus, certify
from continuum_grasp.grasp.page import page as page_of
from continuum_grasp.plotting import plot_grasp
from tests.made_up_grasps import REASON, failed, held, scene_of

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")

LONG = replace(
    REASON, name="friction", text="friction is too low: " + "as is said at length, " * 8, repair="roughen it " * 12
)
CIRCLE = np.stack([np.cos(np.arange(24) * np.pi / 12), np.sin(np.arange(24) * np.pi / 12)], axis=1)
ATTEMPT = {"start": "scan", "contacts": ["finger.middle", "finger.tip", "palm"], "outcome": "Solve_Succeeded"}
ATTEMPT |= {"iterations": 12, "seconds": 0.0123456, "objective": 1.25, "greatest_violation": None}
STATISTICS = {"interrupted": False, "cut_short": "", "attempts": [ATTEMPT] * 3, "effort": "normal " * 9}
WIDTHS = 1280, 420
SCHEMES = "light", "dark"
FONT = 8.0
"""Of the drawings [points]."""


def certified(result, stable=True, **changes):
    certificate = certify(result.scene, result.arrays)
    certificate.__dict__["stable"] = stable
    return replace(result, certificate=certificate, statistics=STATISTICS, **changes)


def pages():
    unnamed = replace(failed("slippery_bottle", arrays=False), reasons=(REASON, LONG), message=LONG.text)
    results = {
        "optimal": certified(held()),
        "in the plane": certified(held("table_peg")),
        "three fingers": certified(held("wrap")),
        "feasible": certified(held("egg"), status=GraspStatus.FEASIBLE, message=f"held; {LONG.text}"),
        "unstable": certified(held("pinch"), stable=False, status=GraspStatus.UNSTABLE),
        "unstable as the scene allows": certified(held("pinch"), stable=False),
        "infeasible": replace(failed(), reasons=(REASON, LONG), statistics=STATISTICS),
        "without numbers": unnamed,
        "not solved": GraspResult(scene_of("mug", name="m" * 90), GraspStatus.NOT_SOLVED, LONG.text, advice=LONG.text),
    }
    # the quality of made-up numbers means nothing: only its polygon is drawn
    drawn = {name: plot_grasp(r, resisted=CIRCLE if r.solved else False) for name, r in results.items()}
    return {name: page_of(r, pictures={"grasp": drawn[name]}) for name, r in results.items()}


MEASURE = """
const luminance = c => { const [r, g, b] = c.map(v => v / 255).map(v => v <= .04045 ? v / 12.92 :
  Math.pow((v + .055) / 1.055, 2.4)); return .2126 * r + .7152 * g + .0722 * b; };
const color = text => text.match(/[0-9.]+/g).map(Number);
function measured(frame) {
  const page = frame.contentDocument, view = frame.contentWindow, width = view.innerWidth, found = {};
  page.querySelectorAll('details').forEach(one => one.open = true);
  const every = [...page.body.querySelectorAll('*')].filter(one => one.getClientRects().length);
  const name = one => one.tagName + '.' + one.getAttribute('class') + ': ' + one.textContent.slice(0, 40);
  found.scrolls = page.documentElement.scrollWidth - width;
  const html = every.filter(one => !one.closest('svg') || one.tagName == 'svg');
  found.outside = html.filter(one => { const box = one.getBoundingClientRect();
    return box.left < -.5 || box.right > width + .5; }).map(name);
  found.cut = html.filter(one => one.tagName != 'svg' && one.scrollWidth > one.clientWidth + 1 &&
    view.getComputedStyle(one).display != 'inline').map(name);
  found.small = []; found.faint = [];
  const walker = page.createTreeWalker(page.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const one = walker.currentNode.parentElement;
    if (!walker.currentNode.textContent.trim() || one.closest('svg') || !one.getClientRects().length) continue;
    const style = view.getComputedStyle(one);
    let under = one;
    while (under.parentElement && color(view.getComputedStyle(under).backgroundColor)[3] === 0)
      under = under.parentElement;
    const both = [color(style.color), color(view.getComputedStyle(under).backgroundColor)]
      .map(c => luminance(c.slice(0, 3))).sort((a, b) => b - a);
    if ((both[0] + .05) / (both[1] + .05) < 4.5) found.faint.push(name(one));
    if (parseFloat(style.fontSize) < 11.5) found.small.push(name(one));
  }
  found.points = [...page.querySelectorAll('svg')].map(one =>
    one.getBoundingClientRect().width / one.viewBox.baseVal.width);  // [pixels of the page]
  found.paper = luminance(color(view.getComputedStyle(page.body).backgroundColor).slice(0, 3));
  return found;
}
onload = () => document.querySelector('#found').textContent =
  JSON.stringify([...document.querySelectorAll('iframe')].map(measured));
"""


COSTLY_FIXTURES = ("measured",)


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """What Chromium measures, by page, width and color scheme; a frame has the color scheme that it is given."""
    texts = pages()
    cases = [(name, width, scheme) for name in texts for width in WIDTHS for scheme in SCHEMES]
    frames = "".join(
        f'<iframe style="width:{width}px;height:900px;border:0;color-scheme:{scheme}" '
        f'srcdoc="{html.escape(texts[name])}"></iframe>\n'
        for name, width, scheme in cases
    )
    folder = tmp_path_factory.mktemp("browser")
    file = folder / "all.html"
    file.write_text(
        f'<!DOCTYPE html><meta charset="utf-8"><pre id="found"></pre>{frames}<script>{MEASURE}</script>',
        encoding="utf-8",
    )
    command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'profile'}"]
    done = subprocess.run([*command, "--dump-dom", file.as_uri()], capture_output=True, text=True, timeout=120)
    found = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.DOTALL)
    assert found is not None, done.stderr[-2000:]
    return dict(zip(cases, json.loads(html.unescape(found[1])), strict=True))


def each(measured):
    return [(" ".join(map(str, case)), found) for case, found in measured.items()]


@pytest.mark.deep
def test_nothing_is_cut_or_outside(measured):
    assert len(measured) == 9 * 4
    for case, found in each(measured):
        assert found["scrolls"] <= 0, case
        assert found["outside"] == [], case
        assert found["cut"] == [], case


@pytest.mark.deep
def test_everything_is_read(measured):
    for case, found in each(measured):
        assert found["faint"] == [], case
        assert found["small"] == [], case
        assert min(found["points"]) * FONT > 7.0, case


def test_pages_are_dark_where_that_is_wanted(measured):
    for (name, width, scheme), found in measured.items():
        assert (found["paper"] < 0.05) is (scheme == "dark"), (name, width)
