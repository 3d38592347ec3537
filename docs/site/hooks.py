"""Hooks of MkDocs that build the site from the repository: see ``mkdocs.yml``.

On the site each file has the path that it has in the repository, so that relative links mean the same in both. Pages
are those that the navigation names and, beyond them, all that a page links to: configurations and sources as
highlighted code, notebooks with the outputs that they were saved with, folders as lists of their files.

``python3 start.py docs`` builds it strictly into ``build/docs``, ``mkdocs serve`` while one writes. The build fails at
a dead link or anchor, at an error in a docstring, at anything that would be loaded from another site, and at what
Markdown shows differently on the site and in the browser of a repository: indent what belongs to a list by four spaces,
and leave a fenced block outside of it. Formulas between ``$`` become MathML.
"""

from __future__ import annotations

import json
import logging
import os
import posixpath
import re
from pathlib import Path
from textwrap import indent
from typing import Any

import latex2mathml.converter
import notebook_pages
import pages
import reference
from charts import with_charts
from mkdocs.structure.files import File, Files, InclusionLevel

ROOT = pages.ROOT
RESULTS = "benchmarks/results/"
LANGUAGES = {".py": "python", ".yaml": "yaml", ".json": "json", ".c": "c", ".h": "c", ".sh": "bash", ".txt": "text"}
"""Files that are shown as code, by suffix, or by name in ``NAMED``; others are copied."""
NAMED = {"CMakeLists.txt": "cmake", "CITATION.cff": "yaml", "LICENSE": "text", "run": "bash"}
MACHINE = re.compile(r"^- cpu: .*\n(?:- .*\n)*", re.MULTILINE)
"""What a benchmark ran on, which is folded away."""
FENCE = re.compile(r"^ {0,3}(`{3,}|~{3,}).*?^ {0,3}\1`*\s*$", re.MULTILINE | re.DOTALL)
TAG = re.compile(r"<(?:img|a|video|source)\b[^>]*>")
CODE = re.compile(r"(?<!</span>)(?<!<pre>)<code>([\w./]+)(?:\([^<]*\))?</code>(?!</a>)")
LIVE = re.compile(r'<a href="((?:[\w./]*/)?live/\w+\.html)">\s*(<img\b[^>]*\balt="([^"]*)"[^>]*>)\s*</a>')
"""A picture that leads to a live page, which stands in its place."""
MATH = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
BOLD = re.compile(r'<mi mathvariant="bold">([A-Za-z])</mi>')
"""A bold letter, for which browsers want the character of Unicode."""
OUTSIDE = re.compile(
    r"<(?:script|img|iframe|video|source)\b[^>]*\bsrc=[\"']?(?:https?:)?//[^>]*"
    r"|<link\b[^>]*\bhref=[\"']?(?:https?:)?//[^>]*|@import[^;]*//[^;]*",
)
"""What a browser would load from another site."""
log = logging.getLogger("mkdocs.hooks.repository")


class Source(File):
    """A file of the repository under its path there, or a page made from one."""

    def __init__(self, path: str, config: Any, content: str | bytes | None = None, linked: bool = False) -> None:
        inclusion = InclusionLevel.NOT_IN_NAV if linked else InclusionLevel.INCLUDED
        self.is_page = path.endswith(".md") or isinstance(content, str)
        super().__init__(
            path, str(ROOT), config.site_dir, False, dest_uri=destination(path, self.is_page), inclusion=inclusion
        )
        if content is not None:
            self._content, self.abs_src_path, self.generated_by = content, None, "hooks"

    def is_documentation_page(self) -> bool:
        """Whether it becomes a page, also where it is no Markdown."""
        return self.is_page


def destination(path: str, is_page: bool) -> str:
    """Where a file of the repository stands on the site."""
    if path == "README.md":
        return "readme.html"  # the front page is docs/README.md
    path = path.removeprefix("docs/")
    if not is_page:
        return path
    folder, name = posixpath.split(path)
    if name in ("README.md", "index.md"):
        return posixpath.join(folder, "index.html")
    return (path.removesuffix(".md").removesuffix(".ipynb")) + ".html"


def on_config(config: Any) -> Any:
    """Put the pages of the reference where the navigation names their folder."""
    config.nav = expanded(config.nav)
    return config


def expanded(nav: Any) -> Any:
    """The navigation with the list of its pages in place of the folder of the reference."""
    if isinstance(nav, dict):
        return {title: expanded(value) for title, value in nav.items()}
    if isinstance(nav, list):
        return [expanded(item) for item in nav]
    return list(reference.pages()) if nav == reference.FOLDER else nav


def on_files(files: Files, config: Any) -> Files:
    """Put every file under its path in the repository, and add what the pages link to, and the reference."""
    found = {path: Source(path, config, text) for path, text in reference.pages().items()}
    for file in [file for file in files if file.src_dir == config.docs_dir]:  # others are the theme's
        files.remove(file)
        if file.inclusion.is_included():
            path = f"docs/{file.src_uri}"
            found[path] = Source(path, config)
    named = {path for path in entries(config.nav) if (ROOT / path).is_file()}
    waiting = [*named - set(found), *(path for path, file in found.items() if path.endswith(".md"))]
    while waiting:
        path = waiting.pop()
        if path not in found:
            found |= sources(path, config, linked=path not in named)
        file = found.get(path)
        if file is not None and file.is_page and path.endswith(".md") and not path.startswith(reference.FOLDER):
            wanted = {pages.target(path, link)[0] for link in pages.links(file.content_string)}
            waiting += [one for one in wanted if one not in found and (ROOT / one).exists()]
    for file in found.values():
        files.append(file)
    return files


def entries(nav: Any) -> list[str]:
    """Paths that the navigation names."""
    if isinstance(nav, str):
        return [nav]
    return [path for item in (nav.values() if isinstance(nav, dict) else nav) for path in entries(item)]


def sources(path: str, config: Any, linked: bool) -> dict[str, Source]:
    """The page that shows a file or folder of the repository, with its pictures."""
    file = ROOT / path
    name = file.name
    if file.is_dir():
        listed = sorted(one.name + "/" * one.is_dir() for one in file.iterdir() if not one.name.startswith((".", "_")))
        text = f"# {path}\n\n" + "\n".join(f"- `{one}`" for one in listed) + "\n"
        return {path: Source(path, config, text, linked)}
    if file.suffix == ".ipynb":
        text, pictures = notebook_pages.convert(file)
        beside = {posixpath.join(posixpath.dirname(path), one): data for one, data in pictures.items()}
        return {path: Source(path, config, text, linked)} | {
            one: Source(one, config, data, linked) for one, data in beside.items()
        }
    language = NAMED.get(name, LANGUAGES.get(file.suffix))
    if language is not None:
        text = f"# {name}\n\n`{path}`\n\n{notebook_pages.fenced(file.read_text(encoding='utf-8'), language)}\n"
        return {path: Source(path, config, text, linked)}
    return {path: Source(path, config, None, linked)}


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Give benchmarks their title and charts, and HTML in Markdown the addresses that it has on the site."""
    path = page.file.src_uri
    if path.startswith(RESULTS) and path.endswith(".md"):
        data = (ROOT / path).with_suffix(".json")
        markdown = re.sub(
            r"\| ([<>])= (\S+) \|", lambda m: f"| {'≤' if m[1] == '<' else '≥'}\N{NO-BREAK SPACE}{m[2]} |", markdown
        )
        markdown = markdown.replace("][", "]\\[")  # of code in tables, which refers to no page
        markdown = with_charts(markdown, data) if data.is_file() else markdown
        markdown = re.sub(r"\A# .*", f"# {page.title}", markdown)
        markdown = MACHINE.sub(lambda part: '??? note "Machine"\n' + indent(part[0], "    "), markdown, count=1)
    parts, end = [], 0
    for fence in FENCE.finditer(markdown):
        parts += [TAG.sub(lambda tag: addressed(tag[0], page, files), markdown[end : fence.start()]), fence[0]]
        end = fence.end()
    return "".join(parts) + TAG.sub(lambda tag: addressed(tag[0], page, files), markdown[end:])


def addressed(tag: str, page: Any, files: Files) -> str:
    """A tag of HTML whose files are named by their address on the site."""

    def address(match: re.Match[str]) -> str:
        link = match[2]
        if not link or link.startswith(("#", "mailto:", "data:")) or "://" in link:
            return match[0]
        path, anchor = pages.target(page.file.src_uri, link)
        file = files.get_file_from_path(path)
        if file is None:
            log.warning("%s: %s names no file of the site", page.file.src_uri, match[0])
            return match[0]
        return f'{match[1]}="{file.url_relative_to(page.file)}{"#" * bool(anchor)}{anchor}"'

    return pages.REFERENCE.sub(address, tag)


def on_page_content(html: str, page: Any, config: Any, files: Files) -> str:
    """Link code, turn formulas into MathML, and compare the page with how a repository browser shows it."""
    path = page.file.src_uri
    if page.file.generated_by is None and path.endswith(".md"):
        shown = pages.structure(pages.PARSER.render((ROOT / path).read_text(encoding="utf-8")))
        built = pages.structure(re.sub(r"<figure class=\"chart\">.*?</figure>", "", html))
        wrong = {name: (shown[name], built[name]) for name in shown | built if shown[name] != built[name]}
        if wrong:
            log.warning("%s: blocks by CommonMark and on the site differ: %s", path, wrong)
    html = LIVE.sub(r'<iframe class="live" src="\1" title="\3" loading="lazy"></iframe><noscript>\2</noscript>', html)
    html = html if path.startswith(reference.FOLDER) else linked(html, page, files)
    return MATH.sub(mathml, html)


def linked(html: str, page: Any, files: Files) -> str:
    """Code that names a public name (``cg.simulate``) or a file of the site leads there."""
    entries = {name.path: f"{reference.FOLDER}{name.package}.md" for name in reference.public()}

    def link(match: re.Match[str]) -> str:
        name = re.sub(r"^cg\.", "continuum_grasp.", match[1])
        file = files.get_file_from_path(entries.get(name, name))
        if file is None or file is page.file or (name not in entries and "/" not in name):
            return match[0]
        return f'<a href="{file.url_relative_to(page.file)}{"#" + name if name in entries else ""}">{match[0]}</a>'

    return CODE.sub(link, html)


def mathml(match: re.Match[str]) -> str:
    """A formula that browsers draw without a script."""
    display = "block" if match[1] == "div" else "inline"
    source = match[2].replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")
    formula = str(latex2mathml.converter.convert(source.strip(), display=display))
    return BOLD.sub(
        lambda letter: f"<mi>{chr(ord(letter[1]) + (0x1D3BF if letter[1].isupper() else 0x1D3B9))}</mi>", formula
    )


def on_post_build(config: Any) -> None:
    """Rank what the search finds, and verify that the site shows without a network."""
    index = Path(config.site_dir) / "search/search_index.json"
    found = json.loads(index.read_text(encoding="utf-8"))
    names = {name.path for name in reference.public()}
    for entry in found["docs"]:
        page, _, anchor = entry["location"].partition("#")
        if page.startswith((reference.FOLDER.removeprefix("docs/"), RESULTS)):
            # A title counts a thousandfold: what explains comes first, then public names, then their attributes.
            entry["boost"] = 0.02 if anchor in names else 0.001
    index.write_text(json.dumps(found, separators=(",", ":")), encoding="utf-8")
    for file in Path(config.site_dir).rglob("*"):
        if file.suffix in (".html", ".css"):
            for found in OUTSIDE.findall(file.read_text(encoding="utf-8")):
                log.warning("%s loads from another site: %s", os.path.relpath(file, config.site_dir), found[:120])
