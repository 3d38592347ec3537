"""The pages of docs/live, and the moving picture of the first one: python -m docs.live.

With names of pages these alone; ``--picture`` draws docs/pictures/demo.webp, which needs Chromium and playwright.
"""

from __future__ import annotations

import io
import shutil
import sys
from pathlib import Path

import continuum_grasp as cg
from continuum_grasp.addons.mission import assign_mission

FOLDER = Path(__file__).parent / "live"
DEMO = "hold_a_mug"
PAGES = {
    DEMO: (
        "mission/mug",
        {
            "name": "A controller holds a mug",
            # A reserve for a slippery mug, a plant that every browser follows in real time.
            "drive_tension": 90.0,
            "plant.fidelity.elements": 3,
            "plant.tendon_friction": 0,
            "phases.hold_until_release": True,
            "slip": {"height": 1.0e-4},  # m
        },
    ),
    "follow_a_target": ("mpc/steady_tip", {"name": "Follow a target"}),
    "grasp_a_mug": ("simulate/close_on_mug", {"name": "Grasp a mug"}),
    "hold_an_egg": ("hand/egg", {}),
    "release": ("simulate/nitinol_release_020g", {"name": "Release of a rod with a mass", "parameters": ["tip_mass"]}),
}
"""Configuration and changes by the name of the page."""
LIFTED = 2.4
"""Instant at which the mug is held and the table is gone [s]."""
FRAME, WIDTH, HEIGHT = 0.08, 720, 520
"""Time between frames of the picture [s]; its size [px]."""


def main() -> None:
    """Write all pages, or those that are named."""
    asked = [name for name in sys.argv[1:] if not name.startswith("-")]
    for name in asked or PAGES:
        config, changes = PAGES[name]
        scene = cg.load(f"configs/{config}.yaml").changed(changes)
        given = assign_mission(scene) if isinstance(scene, cg.MissionScene) else scene
        page = cg.export_web(given, FOLDER / f"{name}.html")
        print(f"{page.file}: {page.size} bytes")
    if "--picture" in sys.argv:
        print(picture())


def picture() -> Path:
    """Draw what a visitor does: the mug is pulled, then friction falls until the mission sets it down."""
    from PIL import Image
    from playwright.sync_api import sync_playwright

    frames = []
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.goto((FOLDER / f"{DEMO}.html").as_uri())
        page.wait_for_function("window.page !== undefined && page.world.origin !== undefined", timeout=60000)
        page.evaluate("document.body.classList.add('embedded')")
        page.click("#world", position={"x": 30, "y": 300})
        page.keyboard.press(" ")
        page.evaluate("page.world.real = 1; page.reset()")

        def on(seconds: float, act: str = "") -> None:
            for _ in range(round(seconds / FRAME)):
                page.evaluate(f"page.tick({FRAME}); {act}")
                frames.append(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))

        on(LIFTED + 0.6)
        x, y = page.evaluate(
            "page.toScreen(...page.plant.start.x.slice(page.plant.object.state, page.plant.object.state + 2))"
        )
        page.mouse.move(x, y)
        page.mouse.down()
        for k in range(12):
            page.mouse.move(x + 6 * k, y - 8 * k)
            on(FRAME)
        on(0.4)
        page.mouse.up()
        on(0.8)
        for friction in (0.4, 0.3, 0.2, 0.165, 0.16):
            page.fill("input[name=friction]", str(friction))
            on(0.5)
        on(1.0)
        browser.close()
    target = FOLDER.parent / "pictures" / "demo.webp"
    first, *others = frames
    first.save(target, save_all=True, append_images=others, duration=round(1000 * FRAME), loop=0, quality=55, method=6)
    return target


if __name__ == "__main__":
    main()
