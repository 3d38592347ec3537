"""What a page of Markdown links to and which anchors it has, as browsers of repositories (CommonMark) see it."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from urllib.parse import unquote, urlsplit

from markdown_it import MarkdownIt
from markdown_it.token import Token

ROOT = Path(__file__).parents[2]
PARSER = MarkdownIt("commonmark").enable(["table", "strikethrough"])
REFERENCE = re.compile(r'\b(src|href|poster)="([^"]*)"')
"""Attributes of HTML in Markdown that name a file."""


def tokens(text: str) -> Iterator[Token]:
    """Blocks of a page and what stands in them, in order."""
    for token in PARSER.parse(text):
        yield token
        yield from token.children or ()


def links(text: str) -> list[str]:
    """Targets of all links and pictures that are not on another site."""
    found = []
    for token in tokens(text):
        found += [str(value) for key, value in token.attrs.items() if key in ("href", "src")]
        if token.type in ("html_block", "html_inline"):
            found += [value for _, value in REFERENCE.findall(token.content)]
    return [link for link in found if not urlsplit(link).scheme and not urlsplit(link).netloc]


def target(source: str, link: str) -> tuple[str, str]:
    """Path of the file or folder that a link names, from the root of the repository, and its anchor.

    A path that leads out of the repository starts with ``../``.
    """
    parts = urlsplit(link)
    if not parts.path:
        return source, unquote(parts.fragment)
    path = (ROOT / source).parent.joinpath(unquote(parts.path)).resolve()
    return Path(os.path.relpath(path, ROOT)).as_posix(), unquote(parts.fragment)


def anchors(text: str) -> set[str]:
    """Anchors of headings, as repository browsers derive them from their text, and those given in HTML."""
    found: Counter[str] = Counter()
    blocks = PARSER.parse(text)
    for opening, content in pairwise(blocks):
        if opening.type == "heading_open":
            written = "".join(part.content for part in content.children or () if part.type in ("text", "code_inline"))
            slug = re.sub(r"[^\w\- ]", "", written.lower()).replace(" ", "-")
            found[f"{slug}-{found[slug]}" if found[slug] else slug] += 1
    html = "".join(token.content for token in tokens(text) if token.type in ("html_block", "html_inline"))
    return {*found, *re.findall(r'\b(?:id|name)="([^"]+)"', html)}


def structure(html: str) -> Counter[str]:
    """How many of each block a page of HTML has, but for empty rows, which a table without any is given."""
    html = re.sub(r"<tr>\s*(<td[^>]*></td>\s*)+</tr>", "", html)
    return Counter(re.findall(r"<(h[1-6]|li|pre|table|tr|blockquote|img)\b", html))
