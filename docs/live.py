"""The pages of docs/live: python -m docs.live."""

from __future__ import annotations

from pathlib import Path

import continuum_grasp as cg

FOLDER = Path(__file__).parent / "live"
PAGES = {
    "follow_a_target": ("mpc/steady_tip", {"name": "Follow a target"}),
    "grasp_a_mug": ("simulate/close_on_mug", {"name": "Grasp a mug"}),
    "release": ("simulate/nitinol_release_020g", {"name": "Release of a rod with a mass", "parameters": ["tip_mass"]}),
}
"""Configuration and changes by the name of the page."""


def main() -> None:
    """Write all of them."""
    total = 0
    for name, (config, changes) in PAGES.items():
        scene = cg.load(Path("configs") / f"{config}.yaml").changed(changes)
        page = cg.export_web(scene, FOLDER / f"{name}.html")
        total += page.size
        print(f"{page.file}: {page.size} bytes")
    print(f"{total} bytes in all")


if __name__ == "__main__":
    main()
