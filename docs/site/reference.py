"""Pages of the API reference: every public name once, under the shortest path by which it is imported."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import continuum_grasp

FOLDER = "docs/api/"
TOP = "continuum_grasp"
PAGE = Path(__file__).parents[1] / "public_names.md"
HIDDEN = {"cli"}
"""The command line has a guide and its own help."""


@dataclass(frozen=True)
class Name:
    """A public name: the path that users import it by, the package that defines it, and its summary."""

    path: str
    package: str
    summary: str


@cache
def public() -> list[Name]:
    """All public names, those of the top level first."""
    root = Path(continuum_grasp.__file__).parent
    doors = sorted(stub.parent.relative_to(root).parts for stub in root.glob("*/**/__init__.pyi"))
    packages = [".".join((TOP, *parts)) for parts in doors if parts[0] not in HIDDEN]
    found: dict[int, Name] = {}
    for package in (TOP, *packages):
        module = import_module(package)
        for name in getattr(module, "__all__", ()):
            value = getattr(module, name)
            if name.startswith("__") or id(value) in found:
                continue
            found[id(value)] = Name(f"{package}.{name}", home(value, package), summary(value))
    return list(found.values())


def home(value: Any, package: str) -> str:
    """Package that defines a value: ``continuum_grasp.scene``, or the top level for its own modules."""
    parts = str(getattr(value, "__module__", package)).split(".")
    if parts[0] != TOP:
        return package
    path = ".".join(parts[: 3 if parts[1:2] == ["addons"] else 2])
    return path if len(parts) > 1 and hasattr(import_module(path), "__path__") else TOP


def summary(value: Any) -> str:
    """First line of a docstring."""
    text = inspect.getdoc(value) if callable(value) else ""
    return (text or "").partition("\n")[0].strip().replace("|", "&#124;")


def pages() -> dict[str, str]:
    """Markdown of the reference by path in the repository, where these pages do not lie; the index comes first."""
    names = public()
    packages = sorted({name.package for name in names}, key=by_layer)
    found = {f"{FOLDER}index.md": index(names, packages)}
    for package in packages:
        about = inspect.getdoc(import_module(package)) or ""
        blocks = [entry(name) for name in sorted(names, key=in_order) if name.package == package]
        found[f"{FOLDER}{package}.md"] = f"# {package}\n\n{about}\n\n" + "\n\n".join(blocks) + "\n"
    return found


def entry(name: Name) -> str:
    """Directive for a public name. Values of a scene have a constructor of their fields, which are listed anyway."""
    value = value_of(name.path)
    fields = getattr(value, "model_fields", None)
    if fields is None:
        return f"::: {name.path}"
    # What all of them inherit stands with those that users build first.
    inherited = "true" if name.path.count(".") == 1 else f"[{', '.join(fields)}]"
    return f"::: {name.path}\n    options:\n      merge_init_into_class: false\n      inherited_members: {inherited}"


def value_of(path: str) -> Any:
    """What a public path names."""
    package, _, name = path.rpartition(".")
    return getattr(import_module(package), name)


def index(names: list[Name], packages: list[str]) -> str:
    """One table per package of its public names."""
    parts = [
        "# API reference",
        "All public names, grouped by the package that defines them, under the path that they are imported by. "
        f"Names of the top level are for users, `import {TOP} as cg`; the others are for those who build on it. "
        "Names that are not here may change without notice.",
    ]
    for package in packages:
        rows = [
            f"| [`{name.path.removeprefix(TOP + '.')}`]({package}.md#{name.path}) | {name.summary} |"
            for name in sorted(names, key=in_order)
            if name.package == package
        ]
        parts += [f"## {package}", "| name | what it is |\n|---|---|\n" + "\n".join(rows)]
    return "\n\n".join(parts) + "\n"


def names_page() -> str:
    """Markdown of a page with all public names, which is readable without the site."""
    names = public()
    parts = [
        "# Public names",
        "Every public name with the first sentence of its docstring, as `python -m docs.site.reference` writes them. "
        f"Editors show the whole docstring. `cg` is `{TOP}`; import other names from the package in the heading.",
    ]
    for package in sorted({name.package for name in names}, key=by_layer):
        rows = []
        for name in sorted(names, key=in_order):
            if name.package == package:
                at, _, last = name.path.rpartition(".")
                rows.append(f"| `{'cg.' if at == TOP else ''}{last}` | {name.summary} |")
        parts += [f"## {package}", "| name | summary |\n|---|---|\n" + "\n".join(rows)]
    return "\n\n".join(parts) + "\n"


def by_layer(package: str) -> tuple[bool, bool, str]:
    """The top level before packages of the core, and these before add-ons."""
    return package != TOP, ".addons" in package, package


def in_order(name: Name) -> tuple[int, bool, str]:
    """Names of the top level before others, functions before classes, each by the alphabet."""
    last = name.path.rpartition(".")[2]
    return name.path.count("."), last[0].isupper(), last.lower()


if __name__ == "__main__":
    PAGE.write_text(names_page(), encoding="utf-8")
