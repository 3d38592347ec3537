"""Parts of a web page, texts of HTML, and their style."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from continuum_grasp.results import yaml_text

_STYLE = """
:root { color-scheme: light dark; --paper: #fff; --ink: #222; --quiet: #5f5f5f; --line: #ddd; --panel: #f6f6f4;
  --good: #00694b; --bad: #a03000; --note: #8a6500; --on-badge: #fff; }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1rem 1rem 3rem; max-width: 62rem; color: var(--ink); background: var(--paper);
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, Helvetica, Arial, sans-serif; }
body, h1 { overflow-wrap: anywhere; }
h1 { font-size: 1.6rem; line-height: 1.2; margin: .6rem 0 .2rem; }
h2 { font-size: 1.15rem; margin: 2.2rem 0 .5rem; padding-top: .6rem; border-top: 1px solid var(--line); }
p { margin: .4rem 0 .8rem; max-width: 46rem; }
.quiet, figcaption, dt { color: var(--quiet); }
.badge { display: inline-block; padding: .1rem .6rem; border-radius: 1rem; font-size: .85rem; color: var(--on-badge);
  background: var(--bad); vertical-align: middle; }
.badge.good { background: var(--good); }
.why, .warning { border-left: 4px solid var(--bad); padding: .1rem 0 .1rem 1rem; }
.why h2 { margin-top: 0; border-top: 0; }
.warning { border-color: var(--note); }
.cards { display: grid; grid-template-columns: repeat(var(--wide), 1fr); gap: .7rem; margin: 1rem 0; }
.cards div { border: 1px solid var(--line); border-radius: .5rem; padding: .5rem .8rem; display: flex;
  flex-direction: column; justify-content: space-between; }
.cards dd { margin: 0; font-size: 1.2rem; font-variant-numeric: tabular-nums; }
.cards dt { font-size: .85rem; }
figure { margin: 1rem 0; }
figure svg { display: block; width: 100%; height: auto; }
figure.drawing { max-width: 42rem; }
figure.polygon, figure.friction { max-width: 24rem; }
figcaption { font-size: .9rem; }
table { border-collapse: collapse; font-size: .92rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .28rem .9rem .28rem 0; border-bottom: 1px solid var(--line); vertical-align: top; }
th { font-weight: 600; color: var(--quiet); vertical-align: bottom; }
th, td { overflow-wrap: break-word; }
td.n, th.n { text-align: right; }
td.n { white-space: nowrap; }
td.bad { color: var(--bad); font-weight: 600; }
td.good { color: var(--good); }
pre { white-space: pre-wrap; background: var(--panel); padding: .8rem; border-radius: .4rem; font-size: .82rem;
  line-height: 1.4; }
summary { cursor: pointer; margin: .6rem 0; }
@media (max-width: 46rem) { .cards { grid-template-columns: repeat(var(--narrow), 1fr); }
  /* a row becomes a block of lines, each with the head of its column */
  table.headed, .headed tbody, .headed tr { display: block; }
  .headed thead { display: none; }
  .headed tr { border-bottom: 1px solid var(--line); padding: .4rem 0; }
  .headed td { display: grid; grid-template-columns: 9rem 1fr; gap: .8rem; padding: .1rem 0; border: 0;
    text-align: left; white-space: normal; overflow-wrap: anywhere; }
  .headed td::before { content: attr(data-head); color: var(--quiet); font-weight: 400; }
  .headed td:first-child { display: block; font-weight: 600; }
  .headed td:first-child::before, .headed td:empty { display: none; } }
@media (max-width: 30rem) { body { font-size: 15px; padding: .6rem .8rem 2rem; } h1 { font-size: 1.35rem; } }
@media print { h2 { break-after: avoid; } figure, tr { break-inside: avoid; } }
@media (prefers-color-scheme: dark) {
  :root { --paper: #171717; --ink: #e4e4e4; --quiet: #a8a8a8; --line: #3c3c3c; --panel: #222; --good: #4fc79a;
    --bad: #ff9a70; --note: #d6a93c; --on-badge: #171717; }
  /* drawings are made on white, which this turns into --paper; hues stay */
  figure svg { filter: invert(.91) hue-rotate(180deg); } }
"""


def report(title: str, status: str, message: str, warnings: Sequence[str], *parts: str, solved: bool) -> str:
    """A whole page on a result: how it ended, what to know before it is used, and the parts that it has."""
    warned = f'<div class="warning">{items(warnings)}</div>' if warnings else ""
    badge = f'<span class="badge{" good" if solved else ""}">{escaped(status.replace("_", " "))}</span>'
    verdict = f"<p>{badge} {escaped(message)}</p>"
    body = "\n".join(part for part in (f"<h1>{escaped(title)}</h1>", verdict, warned, *parts) if part)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escaped(title)}</title>\n<style>{_STYLE}</style>\n</head>\n"
        f"<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def folded(summary: str, values: Mapping[str, Any], *, exact: bool = False) -> str:
    """Names and values, however deep, as YAML that opens when it is asked for; empty where there are none."""
    return details(summary, f"<pre>{escaped(yaml_text(values, exact=exact))}</pre>") if values else ""


def escaped(value: object) -> str:
    """A text for a page."""
    return html.escape(str(value), quote=True)


def section(title: str, *body: str, kind: str = "") -> str:
    """A heading and what belongs to it; empty where nothing does."""
    inner = "\n".join(part for part in body if part)
    opening = f'<section class="{kind}">' if kind else "<section>"
    return f"{opening}\n<h2>{escaped(title)}</h2>\n{inner}\n</section>" if inner else ""


def table(head: Sequence[str], rows: Iterable[Sequence[object]], numbers: Sequence[int] = ()) -> str:
    """A table, without an empty head; ``numbers`` stand on the right, and a cell of ok or FAILED is colored.

    On a narrow screen each row of a table with a head becomes a block, so that nothing is cut off.
    """
    kinds = {"ok": "good", "FAILED": "bad"}
    names = [escaped(name) for name in head]

    def cell(tag: str, k: int, value: object) -> str:
        kind = "n" if k in numbers else kinds.get(str(value), "")
        look = f' class="{kind}"' if kind else ""
        look += f' data-head="{names[k]}"' if tag == "td" and names else ""
        return f"<{tag}{look}>{escaped(value)}</{tag}>"

    lines = ["<tr>" + "".join(cell("td", k, v) for k, v in enumerate(row)) + "</tr>" for row in rows]
    if not lines:
        return ""
    body = "<tbody>\n" + "\n".join(lines) + "\n</tbody>\n</table>"
    if not names:
        return f"<table>\n{body}"
    top = "".join(cell("th", k, v) for k, v in enumerate(head))
    return f'<table class="headed">\n<thead><tr>{top}</tr></thead>\n{body}'


def cards(pairs: Iterable[tuple[str, str]]) -> str:
    """Key numbers: what it is, and how much; all rows of them are full on a wide and on a narrow screen."""
    inner = [f"<div><dt>{escaped(name)}</dt><dd>{escaped(value)}</dd></div>" for name, value in pairs]
    if not inner:
        return ""
    wide, narrow = (next(k for k in counts if len(inner) % k == 0) for counts in ((7, 6, 5, 4, 3, 2, 1), (2, 3, 1)))
    return f'<dl class="cards" style="--wide: {wide}; --narrow: {narrow}">\n' + "\n".join(inner) + "\n</dl>"


def items(texts: Iterable[str]) -> str:
    """A list of sentences."""
    inner = "\n".join(f"<li>{escaped(text)}</li>" for text in texts)
    return f"<ul>\n{inner}\n</ul>" if inner else ""


def details(summary: str, body: str) -> str:
    """A part that opens on demand."""
    return f"<details>\n<summary>{escaped(summary)}</summary>\n{body}\n</details>"
