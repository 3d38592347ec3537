"""Pictures of the examples: ``python -m docs.examples`` in the root of the repository runs all, or those that it names.

An example is a file ``examples/exNN_NAME.py`` of 20 to 60 lines: one idea, one picture and one asserted number of an
independent source. A new one needs a row in ``docs/examples.md``; ``tests/test_example_scripts.py`` runs it.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

ROOT = Path(__file__).absolute().parents[1]
PICTURES = ROOT / "docs" / "pictures" / "examples"
WIDTH = 420
"""Of a picture [pixels]."""


def scripts() -> list[Path]:
    """Files of the examples."""
    return sorted((ROOT / "examples").glob("ex[0-9][0-9]_*.py"))


def draw(script: Path) -> None:
    """Run an example and store its picture."""
    with TemporaryDirectory() as folder:
        drawn = Path(folder, "drawn.png")
        paths = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
        own = {**os.environ, "PYTHONPATH": paths, "MPLBACKEND": "Agg"}
        subprocess.run([sys.executable, str(script), "--out", str(drawn)], env=own, check=True)
        with Image.open(drawn) as picture:
            small = picture.convert("RGB").resize((WIDTH, round(picture.height * WIDTH / picture.width)))
        PICTURES.mkdir(exist_ok=True)
        small.save(PICTURES / f"{script.stem}.webp", quality=80, method=6)


if __name__ == "__main__":
    for one in scripts():
        if len(sys.argv) == 1 or one.stem in sys.argv[1:]:
            draw(one)
