"""Commands as users type them: messages name the package as it was started, so that what they say works there."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path

COMMAND = "continuum-grasp"
"""The command that an installation adds to the folder of its Python."""
STARTED_BY = "CONTINUUM_GRASP_STARTED_BY"
"""Environment variable with the Python that runs ``start.py`` and the path of ``start.py``, as JSON."""


def command_words(*arguments: str, folder: str | os.PathLike[str] = ".") -> list[str]:
    """Return the words that run the command line with these arguments, typed in ``folder``."""
    return [*_start(folder), *arguments]


def command_line(*arguments: str) -> str:
    """Return the line that runs the command line with these arguments, typed in the working directory."""
    return quoted_line(command_words(*arguments))


def tool_words(module: str, *arguments: str, folder: str | os.PathLike[str] = ".") -> list[str]:
    """Return the words that run a module of an extra, which ``start.py`` installs by itself, typed in ``folder``."""
    start = _start(folder) if _started_by() else [_python(), "-m"]
    return [*start, module, *arguments]


def has_tool(module: str) -> bool:
    """Whether the command of `tool_words` needs no installation before it."""
    return bool(_started_by()) or find_spec(module) is not None


def install_line(extra: str) -> str:
    """Return the line that installs what an extra of the package asks for."""
    words = (
        command_words("install", extra) if _started_by() else [_python(), "-m", "pip", "install", f"{COMMAND}[{extra}]"]
    )
    return quoted_line(words)


def quoted_line(words: Sequence[str]) -> str:
    """Return words as one line, quoted as the system's shell reads them."""
    return subprocess.list2cmdline(words) if os.name == "nt" else shlex.join(words)


def _start(folder: str | os.PathLike[str]) -> list[str]:
    program = Path(sys.argv[0])
    if started := _started_by():
        python, script = started
        return [_typed(python), _seen_from(folder, script)]
    if program.parts[-2:] == ("continuum_grasp", "__main__.py"):
        return [_python(), "-m", "continuum_grasp"]
    if program.stem == COMMAND and program.exists() and not _is_found(program):
        return [str(program.absolute())]
    return [COMMAND]


def _started_by() -> list[str]:
    return list(json.loads(os.environ.get(STARTED_BY, "[]")))


def _python() -> str:
    return _typed(sys.executable)


@cache
def _typed(python: str) -> str:
    """Return the name of a Python if a shell finds it by this name, also by a shim of pyenv; otherwise its path."""
    name = os.path.basename(python)
    found = shutil.which(name)
    if name == python or found is None:
        return python
    asked = [found, "-c", "import sys; print(sys.executable)"]
    said = subprocess.run(asked, capture_output=True, text=True, encoding="utf-8", check=False).stdout.strip()
    return name if said == python else python


def _is_found(program: Path) -> bool:
    """Whether a shell finds this program by its name."""
    found = shutil.which(COMMAND)
    return found is not None and os.path.samefile(found, program)


def _seen_from(folder: str | os.PathLike[str], file: str) -> str:
    """A path as one types it in a folder: relative, unless the absolute one is shorter."""
    try:
        return min(os.path.relpath(file, os.path.realpath(folder)), file, key=len)
    except ValueError:  # another drive of Windows
        return file
