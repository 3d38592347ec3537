"""The commands and the Python of README.md, as they are written there."""

from __future__ import annotations

import re
import shlex

import pytest

from tests.commands import ROOT, python

PAGE = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = [block.strip().splitlines() for block in re.findall(r"^```sh\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)]
PYTHON = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def words(line):
    """What follows ``continuum-grasp``; ``start.py``, which ``.ci/run`` tries, gives its arguments to that."""
    found = shlex.split(line, comments=True)
    return found[found.index("start.py") + 1 if "start.py" in found else 1 :]


@pytest.fixture
def checkout(tmp_path):
    """A folder like a clone, in which results lie apart from those of the project."""
    for name in ("configs", "schema"):
        (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


def test_the_page_has_two_blocks_of_commands():
    assert [len(block) for block in COMMANDS] == [2, 11]
    home = (ROOT / "docs/README.md").read_text(encoding="utf-8")
    assert re.findall(r"^```sh\n(.*?)^```", home, re.MULTILINE | re.DOTALL) == ["\n".join(COMMANDS[0]) + "\n"]


@pytest.mark.deep
@pytest.mark.parametrize("block", COMMANDS)
def test_commands_run(block, checkout):
    for line in block:
        done = python("-m", "continuum_grasp", *words(line), cwd=checkout)
        expected = re.search(r"# status (\d)$", line)
        assert done.returncode == (int(expected[1]) if expected else 0), f"{line}\n{done.stdout}{done.stderr}"
    pictures = list(checkout.glob("runs/grasp/*/grasp.png"))
    assert pictures
    assert all(picture.stat().st_size > 10_000 for picture in pictures)


@pytest.mark.deep
def test_the_python_runs(checkout):
    (checkout / "example.py").write_text("\n".join(PYTHON), encoding="utf-8")
    done = python("example.py", cwd=checkout)
    assert done.returncode == 0, done.stderr
    assert "('mass', " in done.stdout
    assert "forward_dynamics:(x[4]" in done.stdout
