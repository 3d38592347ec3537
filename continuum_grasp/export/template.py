"""Texts of the package with places to fill: <<word>>."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files

_PLACE = re.compile(r"<<(\w+)>>")


def fill(name: str, words: Mapping[str, str]) -> str:
    """A template of the package, filled.

    Parameters
    ----------
    name : str
        Path below ``templates``.
    words : mapping
        What stands in each place; more than the template asks for may be given.
    """
    return filled(_text(name), words)


def filled(text: str, words: Mapping[str, str]) -> str:
    """A text with every place filled; KeyError where a word is missing."""
    return _PLACE.sub(lambda match: words[match[1]], text)


@cache
def _text(name: str) -> str:
    return files("continuum_grasp.export").joinpath("templates", name).read_text(encoding="utf-8")
