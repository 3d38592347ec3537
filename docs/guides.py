"""Commands, files and pictures of the guides: ``python docs/guides.py first_finger simulate recipes`` draws them anew.

A guide is run from its text, block by block, in a folder of its own:

- ``sh``: commands, one a line; ``# status 1`` behind one names the exit status that it has, where that is not 0;
- ``python``: code, in one namespace per page, unless it begins with ``# NAME.py``;
- ``yaml``, ``toml``, ``python`` that begin with ``# NAME.SUFFIX``: that file is written; ``# in NAME.yaml``: an excerpt
  of a file there;
- ``c`` that begins with ``/* NAME.c */``: that file is written;
- ``diff`` that begins with ``--- NAME``: lines of that file are replaced;
- ``text``: lines of what the block before it prints, in their order.

A picture ``pictures/PAGE/simulate-sag-energy.png`` is ``runs/simulate/sag/energy.png`` of that folder.

A new page is a name in ``PAGES``; a recipe is a paragraph with its blocks in ``docs/recipes.md``. A page of the three
paths has one worked example from an empty folder to a picture, in 1,500 words at most; keys and methods belong to the
references, measured figures to benchmarks and appendices. ``tests/docs`` compares what the blocks print with the page.
"""

from __future__ import annotations

import argparse
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from contextlib import chdir, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_PICTURE = re.compile(r"!\[[^\]]*\]\(pictures/(\w+)/([\w-]+)\.(png|gif)\)")
_STATUS = re.compile(r"#\s*status (\d+)\s*$")


@dataclass(frozen=True)
class Block:
    """A fenced block of a page, from a line on."""

    kind: str
    text: str
    line: int


@dataclass(frozen=True)
class Quoted:
    """What a page says that a block prints, and what it prints."""

    line: int
    lines: list[str]
    output: str


def page_text(page: str) -> str:
    """Text of a guide by its name."""
    return (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")


def blocks(text: str) -> list[Block]:
    """Fenced blocks of a page."""
    return [Block(m[1], m[2], text[: m.start()].count("\n") + 1) for m in _FENCE.finditer(text)]


def pictures(text: str) -> dict[str, Path]:
    """Pictures of a page: where they are committed below ``docs/pictures``, and where a run draws them."""
    found = [(m[1], m[2], m[3]) for m in _PICTURE.finditer(text)]
    return {
        f"{page}/{name}.{kind}": Path("runs", *name.split("-")).with_suffix(f".{kind}") for page, name, kind in found
    }


class Run:
    """A page that is run in a folder; the working directory moves with the page's ``cd``."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.quoted: list[Quoted] = []
        self._output = ""
        self._installed = folder / "installed"
        self._namespace: dict[str, Any] = {"__name__": "guide"}

    def page(self, text: str) -> None:
        """Run all blocks of a page in their order."""
        for block in blocks(text):
            with chdir(self.folder):
                self._block(block)

    def _block(self, block: Block) -> None:
        first, _, rest = block.text.partition("\n")
        if block.kind == "sh":
            self._output = "".join(self._command(line) for line in block.text.splitlines() if line.strip())
        elif named := re.fullmatch(r"# ([\w/]+\.(?:py|toml|yaml))", first):
            file = Path(named[1])
            file.parent.mkdir(exist_ok=True)
            file.write_text(block.text if file.suffix == ".yaml" else rest, encoding="utf-8")
        elif block.kind == "python":
            printed = io.StringIO()
            with redirect_stdout(printed):
                exec(compile(block.text, f"line {block.line}", "exec"), self._namespace)
            self._output = printed.getvalue()
        elif block.kind == "text":
            lines = [line for line in block.text.splitlines() if line.strip() not in ("", "...")]
            self.quoted.append(Quoted(block.line, lines, self._output))
        elif block.kind == "yaml" and first.startswith("# in "):
            if rest not in Path(first.removeprefix("# in ")).read_text(encoding="utf-8"):
                raise ValueError(f"line {block.line}: {first.removeprefix('# in ')} has no such lines")
        elif block.kind == "c" and (named := re.fullmatch(r"/\* (\w+\.c) \*/", first)):
            Path(named[1]).write_text(block.text, encoding="utf-8")
        elif block.kind == "diff":
            self._change(Path(first.removeprefix("--- ")), rest)
        else:
            raise ValueError(f"line {block.line}: no such block: {block.kind!r}, {first!r}")

    def _command(self, line: str) -> str:
        words = shlex.split(line, comments=True)
        if not words:
            return ""
        if words[0] == "cd":
            self.folder = self.folder / words[1]
            return ""
        if words[0] == "continuum-grasp":
            words = [sys.executable, "-m", "continuum_grasp", *words[1:]]
        elif words[0] == "python":
            words = [sys.executable, *words[1:]]
        elif words[:2] == ["pip", "install"]:  # into a folder of this run: the environment stays as it is
            options = ["--quiet", "--no-deps", "--no-build-isolation", "--target", str(self._installed)]
            words = [sys.executable, "-m", "pip", "install", *options, *words[2:]]
        paths = [str(self._installed), str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
        own = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "MPLBACKEND": "Agg"}
        done = subprocess.run(words, capture_output=True, text=True, env=own, check=False)
        named = _STATUS.search(line)
        if done.returncode != (int(named[1]) if named else 0):
            raise RuntimeError(f"{line}: exit status {done.returncode}\n{done.stdout}\n{done.stderr}")
        return done.stdout + done.stderr

    def _change(self, file: Path, lines: str) -> None:
        text = file.read_text(encoding="utf-8")
        for line in lines.splitlines():
            if line.startswith("-"):
                old = line[1:]
                if text.count(old) != 1:
                    raise ValueError(f"{file} has {text.count(old)} times {old!r}")
            elif line.startswith("+"):
                text = text.replace(old, line[1:])
        file.write_text(text, encoding="utf-8")


def run(page: str, folder: Path) -> Run:
    """Run a guide in a folder, which is given the shipped configurations unless the guide takes an example itself."""
    text = page_text(page)
    if not any(block.kind == "sh" and "continuum-grasp new" in block.text for block in blocks(text)):
        for name in ("configs", "schema"):
            shutil.copytree(ROOT / name, folder / name)
    found = Run(folder)
    found.page(text)
    return found


def main() -> None:
    """Run guides and store their pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="+")
    for page in parser.parse_args().pages:
        with tempfile.TemporaryDirectory() as folder:
            done = run(page, Path(folder))
            for name, source in pictures(page_text(page)).items():
                target = ROOT / "docs" / "pictures" / name
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(done.folder / source, target)
                print(target.relative_to(ROOT))
            for one in done.quoted:
                print(f"--- {page}.md, line {one.line}", one.output, sep="\n")


if __name__ == "__main__":
    main()
