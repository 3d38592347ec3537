"""The source distribution holds every file of the project, and so all that its tests read."""

from __future__ import annotations

import fnmatch
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
ALWAYS = ("/pyproject.toml", "/LICENSE", "/.gitignore")
"""What the build puts in by itself."""


def included():
    """Patterns of what the source distribution holds, from its root."""
    options = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    return [*options["tool"]["hatch"]["build"]["targets"]["sdist"]["include"], *ALWAYS]


def is_included(path):
    """Whether a path, or a folder that it lies in, is packed."""
    parts = Path(path).parts
    above = ["/" + "/".join(parts[: k + 1]) for k in range(len(parts))]
    return any(fnmatch.fnmatchcase(one, pattern) for one in above for pattern in included())


def test_patterns_name_what_there_is():
    missing = [pattern for pattern in included() if not list(ROOT.glob(pattern.lstrip("/")))]
    assert not missing


def test_every_file_of_the_project_is_packed():
    if not ROOT.joinpath(".git").exists() or shutil.which("git") is None:
        pytest.skip("not in a clone: this may be the source distribution itself")
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    left = [path for path in listed.split("\0") if path and not is_included(path)]
    assert not left


def test_tests_read_only_what_is_packed():
    """Also where there is no clone: what tests look for below the root exists, and is packed."""
    named = {
        path
        for file in (ROOT / "tests").rglob("*.py")
        for path in re.findall(r'(?:ROOT|parents\[\d\]) / "([^"]+)"', file.read_text(encoding="utf-8"))
    }
    assert len(named) > 20
    assert [path for path in named if not is_included(path) or not (ROOT / path).exists()] == []


def test_version_is_the_same_everywhere():
    version = re.search(r'__version__ = "(.+)"', (ROOT / "continuum_grasp/__init__.py").read_text(encoding="utf-8"))[1]
    cited = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)[1]
    newest = re.search(r"^## ([\d.]+)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)[1]
    assert cited == newest == version


def test_the_conda_recipe_asks_for_the_same():
    recipe = yaml.safe_load((ROOT / "packaging/conda/recipe.yaml").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    version = re.search(r'__version__ = "(.+)"', (ROOT / "continuum_grasp/__init__.py").read_text(encoding="utf-8"))[1]
    assert recipe["context"] == {"version": version, "python_min": project["requires-python"].removeprefix(">=")}
    asked = {
        text.replace(" ", "").replace("matplotlib-base", "matplotlib") for text in recipe["requirements"]["run"][1:]
    }
    assert asked == set(project["dependencies"])
    scripts = [f"{name} = {place}" for name, place in project["scripts"].items()]
    assert recipe["build"]["python"]["entry_points"] == scripts
