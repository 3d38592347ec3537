"""What a command said on its error stream, apart from how its work goes on: on a busy machine that takes a while."""

from __future__ import annotations

import re

_PROGRESS = re.compile(r".+: (\d+ %, )?\d+ s|compil(ing|ed) .+ s( the first time; cached afterwards)?")


def said(stderr: str) -> str:
    """The lines that are not of progress."""
    return "".join(line for line in stderr.splitlines(keepends=True) if not _PROGRESS.fullmatch(line.rstrip()))
