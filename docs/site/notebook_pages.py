"""Notebooks as pages of Markdown, with the outputs that they were saved with."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

PICTURES = {"image/png": ".png", "image/jpeg": ".jpg", "image/gif": ".gif", "image/svg+xml": ".svg"}


def convert(path: Path) -> tuple[str, dict[str, bytes]]:
    """A notebook as Markdown, and the pictures that it shows, by name; they belong beside the page."""
    pictures: dict[str, bytes] = {}
    parts = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
        elif cell["cell_type"] == "code" and source.strip():
            parts.append(fenced(source, "python"))
            parts += [shown(output, path.stem, pictures) for output in cell["outputs"]]
    return "\n\n".join(part for part in parts if part) + "\n", pictures


def shown(output: dict[str, Any], name: str, pictures: dict[str, bytes]) -> str:
    """One output of a cell as Markdown; its picture goes to ``pictures``."""
    if output["output_type"] == "stream":
        return fenced("".join(output["text"]), "text") if output["name"] == "stdout" else ""
    if output["output_type"] == "error":
        raise ValueError(f"{name}.ipynb was saved with an error: {output['ename']}: {output['evalue']}")
    data = {kind: "".join(value) if isinstance(value, list) else value for kind, value in output["data"].items()}
    for kind, suffix in PICTURES.items():
        if kind in data:
            file = f"{name}_{len(pictures) + 1}{suffix}"
            text = kind == "image/svg+xml"
            pictures[file] = data[kind].encode() if text else base64.b64decode(data[kind])
            return f"![]({file})"
    if "text/markdown" in data:
        return str(data["text/markdown"])
    if "text/html" in data:
        # A blank line would end the block of HTML.
        lines = [line for line in data["text/html"].splitlines() if line.strip()]
        return "<div class='output'>" + "\n".join(lines) + "</div>"
    return fenced(str(data["text/plain"]), "text")


def fenced(text: str, language: str) -> str:
    """A block of code; its fence is longer than any in it."""
    fence = "```"
    while fence in text:
        fence += "`"
    return f"{fence}{language}\n{text.rstrip()}\n{fence}"
