"""Parts of a web page, texts of HTML, and their style."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

_STYLE = """
:root { --ink: #222; --quiet: #666; --line: #ddd; --good: #00694b; --bad: #a03000; --accent: #0072b2; }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1rem 1rem 3rem; max-width: 62rem; color: var(--ink); background: #fff;
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, Helvetica, Arial, sans-serif; }
h1 { font-size: 1.6rem; line-height: 1.2; margin: .6rem 0 .2rem; }
h2 { font-size: 1.15rem; margin: 2.2rem 0 .5rem; padding-top: .6rem; border-top: 1px solid var(--line); }
p { margin: .4rem 0 .8rem; max-width: 46rem; }
.quiet, figcaption, dt { color: var(--quiet); }
.badge { display: inline-block; padding: .1rem .6rem; border-radius: 1rem; font-size: .85rem; color: #fff;
  background: var(--bad); vertical-align: middle; }
.badge.good { background: var(--good); }
.why, .warning { border-left: 4px solid var(--bad); padding: .1rem 0 .1rem 1rem; }
.warning { border-color: #b38600; }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(9.5rem, 1fr)); gap: .7rem; margin: 1rem 0; }
.cards div { border: 1px solid var(--line); border-radius: .5rem; padding: .5rem .8rem; }
.cards dd { margin: 0; font-size: 1.3rem; font-variant-numeric: tabular-nums; }
.cards dt { font-size: .85rem; }
figure { margin: 1rem 0; }
figure svg { display: block; width: 100%; height: auto; }
figure.drawing { max-width: 42rem; }
figure.polygon { max-width: 24rem; }
figcaption { font-size: .9rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .92rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .28rem .9rem .28rem 0; border-bottom: 1px solid var(--line); vertical-align: top; }
th { font-weight: 600; color: var(--quiet); white-space: nowrap; }
td.n, th.n { text-align: right; white-space: nowrap; }
td.bad { color: var(--bad); font-weight: 600; }
td.good { color: var(--good); }
pre { overflow-x: auto; background: #f6f6f4; padding: .8rem; border-radius: .4rem; font-size: .82rem;
  line-height: 1.4; }
summary { cursor: pointer; margin: .6rem 0; }
@media (max-width: 30rem) { body { font-size: 15px; padding: .6rem .8rem 2rem; } h1 { font-size: 1.35rem; } }
@media print { h2 { break-after: avoid; } figure, table { break-inside: avoid; } }
"""


def document(title: str, body: str) -> str:
    """A whole page."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escaped(title)}</title>\n<style>{_STYLE}</style>\n</head>\n"
        f"<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def figure(kind: str, drawing: str, caption: str) -> str:
    """A drawing in SVG and what it shows."""
    return f'<figure class="{kind}">\n{drawing}\n<figcaption>{escaped(caption)}</figcaption>\n</figure>'


def nested(values: Mapping[str, Any]) -> str:
    """Names and values, however deep, and a folded table of each list of mappings."""
    simple, tables = [], []
    for name, value in _flattened(values):
        if isinstance(value, (list, tuple)) and value and all(isinstance(v, Mapping) for v in value):
            head = list(dict.fromkeys(key for row in value for key in row))
            rows = [[_said(row.get(key)) for key in head] for row in value]
            summary = f"{name.replace('_', ' ')} ({len(value)})"
            tables.append(details(summary, table([key.replace("_", " ") for key in head], rows)))
        else:
            simple.append((name.replace("_", " "), _said(value)))
    return "\n".join((table((), simple, (1,)), *tables))


def _flattened(values: Mapping[str, Any], before: str = "") -> list[tuple[str, Any]]:
    found: list[tuple[str, Any]] = []
    for key, value in values.items():
        name = f"{before}{key}"
        found += _flattened(value, f"{name}, ") if isinstance(value, Mapping) else [(name, value)]
    return found


def _said(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, (list, tuple)):
        return ", ".join(_said(v) for v in value)
    return str(value)


def escaped(value: object) -> str:
    """A text for a page."""
    return html.escape(str(value), quote=True)


def section(title: str, *body: str, kind: str = "") -> str:
    """A heading and what belongs to it; empty where nothing does."""
    inner = "\n".join(part for part in body if part)
    opening = f'<section class="{kind}">' if kind else "<section>"
    return f"{opening}\n<h2>{escaped(title)}</h2>\n{inner}\n</section>" if inner else ""


def table(head: Sequence[str], rows: Iterable[Sequence[object]], numbers: Sequence[int] = ()) -> str:
    """A table, without an empty head; ``numbers`` stand on the right, and a cell of ok or FAILED is colored."""
    kinds = {"ok": "good", "FAILED": "bad"}

    def cell(tag: str, k: int, value: object) -> str:
        kind = "n" if k in numbers else kinds.get(str(value), "")
        return f'<{tag} class="{kind}">{escaped(value)}</{tag}>' if kind else f"<{tag}>{escaped(value)}</{tag}>"

    lines = ["<tr>" + "".join(cell("td", k, v) for k, v in enumerate(row)) + "</tr>" for row in rows]
    if not lines:
        return ""
    top = "".join(cell("th", k, v) for k, v in enumerate(head))
    top = f"<thead><tr>{top}</tr></thead>\n" if top else ""
    body = "\n".join(lines)
    return f'<div class="wide"><table>\n{top}<tbody>\n{body}\n</tbody>\n</table></div>'


def cards(pairs: Iterable[tuple[str, str]]) -> str:
    """Key numbers: what it is, and how much."""
    inner = "\n".join(f"<div><dt>{escaped(name)}</dt><dd>{escaped(value)}</dd></div>" for name, value in pairs)
    return f'<dl class="cards">\n{inner}\n</dl>' if inner else ""


def items(texts: Iterable[str]) -> str:
    """A list of sentences."""
    inner = "\n".join(f"<li>{escaped(text)}</li>" for text in texts)
    return f"<ul>\n{inner}\n</ul>" if inner else ""


def details(summary: str, body: str) -> str:
    """What opens when it is asked for."""
    return f"<details>\n<summary>{escaped(summary)}</summary>\n{body}\n</details>"


def badge(text: str, good: bool) -> str:
    """A word in a colored field."""
    return f'<span class="badge{" good" if good else ""}">{escaped(text)}</span>'
