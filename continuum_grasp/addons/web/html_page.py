"""A page in one file."""

from __future__ import annotations

import html
import os
from dataclasses import dataclass, field, replace
from pathlib import Path

from continuum_grasp.export import check_file
from continuum_grasp.results import write_text


@dataclass(frozen=True)
class Page:
    """A page, which a notebook shows.

    Attributes
    ----------
    text : str
        HTML.
    modules : dict of str to int
        Size of each WebAssembly module, as it is before it is compressed [bytes].
    file : pathlib.Path or None
        Its path; None where a run shows it.
    """

    text: str = field(repr=False)
    modules: dict[str, int]
    file: Path | None = None

    @property
    def size(self) -> int:
        """Size of the text [bytes]."""
        return len(self.text.encode())

    def save(self, file: str | os.PathLike[str]) -> Page:
        """Write it to a file, whose folder is made where missing; an earlier page is replaced."""
        target = Path(file)
        check_file(target)
        write_text(self.text, target)
        return replace(self, file=target)

    def _repr_html_(self) -> str:
        """The page in a notebook."""
        text = html.escape(self.text)
        title = self.text.partition("<title>")[2].partition("</title>")[0]
        return f'<iframe srcdoc="{text}" title="{title}" style="width:100%;height:860px;border:0"></iframe>'
