"""What differs between systems: encodings of files, names that a system lacks, names of files."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = [ROOT / "start.py", *sorted((ROOT / "continuum_grasp").rglob("*.py"))]
OF_POSIX = re.compile(
    r"os\.(?:fork|getuid|geteuid|killpg|setsid|nice|mkfifo|sched_\w+|pthread_\w+)$"
    r"|signal\.(?:SIGALRM|SIGKILL|SIGURG|SIGHUP|SIGUSR[12]|setitimer|ITIMER_\w+|pthread_sigmask|SIG_BLOCK|SIG_SETMASK)$"
)
"""Attributes that Windows has not."""
GUARDED = {
    "base/workers.py": "hasattr in the same expression",
    "base/interrupt.py": "hasattr before",
    "closed_loop/drivers.py": "hasattr before, or AttributeError is an answer",
    "core/cache.py": "hasattr in the same expression",
}
RESERVED = re.compile(r"(?:con|prn|aux|nul|com\d|lpt\d)(?:\..*)?|.*[<>:\"|?*\\].*|.*[. ]", re.IGNORECASE)
"""Names of files that Windows does not take."""


def calls():
    for file in SOURCES:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
                yield f"{file.relative_to(ROOT)}:{node.lineno}", name, node


def test_text_has_its_encoding_wherever_it_is_read_or_written():
    """Windows has another default than UTF-8."""
    found = []
    for place, name, node in calls():
        keys = {keyword.arg for keyword in node.keywords}
        modes = [a.value for a in node.args if isinstance(a, ast.Constant) and isinstance(a.value, str)]
        of_file = isinstance(node.func, ast.Attribute) and ast.unparse(node.func.value) not in (
            "os",
            "Image",
            "archive",
        )
        is_open = name == "open" and (of_file or isinstance(node.func, ast.Name)) and not any("b" in m for m in modes)
        is_text = name == "read_text" or (name == "write_text" and of_file)
        if (is_open or is_text or ("text" in keys & {"text"} and name in ("run", "Popen"))) and "encoding" not in keys:
            found.append(f"{place}: {ast.unparse(node)[:80]}")
    assert found == []


def test_what_windows_lacks_is_asked_for_where_a_guard_stands():
    found = set()
    for file in SOURCES:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute) and OF_POSIX.match(ast.unparse(node)):
                found.add(
                    file.relative_to(ROOT / "continuum_grasp").as_posix() if file.name != "start.py" else "start.py"
                )
    assert found == set(GUARDED)


def test_modules_that_a_system_lacks_are_imported_under_a_guard():
    lacked = {"fcntl", "resource", "termios", "pty", "msvcrt", "pwd", "grp"}
    for file in SOURCES:
        text = file.read_text(encoding="utf-8")
        if not re.search(rf"^ *import .*\b({'|'.join(lacked)})\b", text, re.MULTILINE):
            continue
        tree = ast.parse(text)
        tried = {id(n) for t in ast.walk(tree) if isinstance(t, ast.Try | ast.With) for n in ast.walk(t)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Import) and {alias.name for alias in node.names} & lacked:
                assert id(node) in tried, f"{file}:{node.lineno}"


@pytest.mark.parametrize("place", ["continuum_grasp", "configs", "docs", "tests", "schema", "notebooks", "examples"])
def test_every_system_takes_the_names_of_files(place):
    """Also those that do not tell A from a."""
    names = [path.relative_to(ROOT).as_posix() for path in (ROOT / place).rglob("*") if "__pycache__" not in path.parts]
    assert [name for name in names if RESERVED.fullmatch(name.rpartition("/")[2])] == []
    assert len({name.lower() for name in names}) == len(names)
