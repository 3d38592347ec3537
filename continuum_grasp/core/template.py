"""Templates of C and of text: words in marks, and blocks by conditions and loops."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache, lru_cache, reduce
from importlib.resources import files
from typing import Any, NamedTuple

_MARK = re.compile(
    r"<<(?:(?P<end>end)|(?P<else>else)|if (?P<no>not )?(?P<if>[\w.]+)"
    r"|for (?P<names>[\w, ]+) in (?P<in>[\w.]+)(?:\|(?P<between>.*?))?|(?P<word>\w[\w.]*):?(?P<format>[\w.]*))>>"
)


class Template(NamedTuple):
    """A text with marks in it."""

    text: str

    @staticmethod
    @cache
    def of(package: str, name: str) -> Template:
        """Template of a file in the folder ``templates`` of a package."""
        file = files(f"continuum_grasp.{package}").joinpath("templates", name)
        return Template(file.read_text(encoding="utf-8"))

    def filled(self, words: Mapping[str, object]) -> str:
        r"""Return the text with its words for ``<<word>>`` and with its blocks, which may be nested.

        ``<<word.name:format>>`` is an attribute or an entry of a word, in a format of Python. ``<<if word>>...<<end>>``
        is written if the word is neither false nor empty, ``<<if not word>>...<<end>>`` otherwise; it may contain
        ``<<else>>``. ``<<for a in word>>...<<end>>`` is written for each entry, ``<<for a, b in word>>`` for each
        tuple; the text after a bar, as in ``<<for a in word|, >>``, separates them, with ``\n`` for the end of a line.
        """
        return _written(_pieces(self.text), words)


@lru_cache(256)
def _pieces(text: str) -> list[Any]:
    """Texts and marks of a template in their order, each mark with the pieces of its block and behind its ``else``."""
    top: list[Any] = []
    open_blocks, at = [top], 0
    for mark in _MARK.finditer(text):
        open_blocks[-1].append(text[at : mark.start()])
        at, blocks = mark.end(), (list[Any](), list[Any]())
        if mark["end"] or mark["else"]:
            open_blocks.pop()
        if mark["else"]:
            open_blocks.append(open_blocks[-1][-1][1][1])
        elif not mark["end"]:
            open_blocks[-1].append((mark, blocks))
            open_blocks += [] if mark["word"] else [blocks[0]]
    top.append(text[at:])
    return top


def _part(of: Any, name: str) -> Any:
    return of[name] if isinstance(of, Mapping) else getattr(of, name)


def _written(pieces: list[Any], words: Mapping[str, object]) -> str:
    texts: list[str] = []
    for piece in pieces:
        if isinstance(piece, str):
            texts.append(piece)
            continue
        mark, (block, other) = piece
        first, *names = (mark["word"] or mark["if"] or mark["in"]).split(".")
        value: Any = reduce(_part, names, words[first])
        if mark["word"]:
            texts.append(format(value, mark["format"]))
        elif mark["if"]:
            texts.append(_written(block if bool(value) != bool(mark["no"]) else other, words))
        else:
            block_names = mark["names"].split(", ")
            rows = [dict(zip(block_names, each if len(block_names) > 1 else (each,), strict=True)) for each in value]
            between = (mark["between"] or "").replace("\\n", "\n")
            texts.append(between.join(_written(block, {**words, **row}) for row in rows))
    return "".join(texts)
