"""Commands, in this process or in one of their own, and what they said on their error stream."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from click.testing import Result
from typer.testing import CliRunner

from continuum_grasp.cli import app

ROOT = Path(__file__).resolve().parents[1]
_PROGRESS = re.compile(r".+: (\d+ %, )?\d+ s|compil(ing|ed) .+ s( the first time; cached afterwards)?")


def run(*arguments: object) -> Result:
    """``continuum-grasp`` with these arguments, in this process."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def environment(**more: str) -> dict[str, str]:
    """Variables of a process that has this checkout's package and draws into files alone."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg", **more}


def python(*arguments: object, more: dict[str, str] | None = None, **options: Any) -> subprocess.CompletedProcess[str]:
    """A new interpreter with these arguments, to its end, with more variables of the environment."""
    options = {"capture_output": True, "text": True, "check": False, **options}
    return subprocess.run([sys.executable, *map(str, arguments)], env=environment(**more or {}), **options)


def said(stderr: str) -> str:
    """The lines that are not of progress: on a busy machine how work goes on is said after a while."""
    return "".join(line for line in stderr.splitlines(keepends=True) if not _PROGRESS.fullmatch(line.rstrip()))
