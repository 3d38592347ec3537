"""The C of ``control/c`` with the names, the type and the literals of a package."""

from __future__ import annotations

import re
from collections.abc import Collection

from continuum_grasp.core.precision import TOKEN, literal

_MODULES = {
    "rti": "rti",
    "ekf": "ekf",
    "contact": "contact",
    "controller": "loop",
    "supervisor": "supervisor",
    "mission": "phases",
    "cg": "checks",
}
"""Beginnings of names in ``control/c``, and behind the prefix of a package."""
_NAME = re.compile(rf"\b(?:{'|'.join(_MODULES)})_\w+|\b(?:{'|'.join(module.upper() for module in _MODULES)})_\w+")
_HEADER = re.compile(r"\b(?:rti|ekf|contact_detector|supervisor|controller|mission|checks)\.h\b")
_INCLUDE = re.compile(r'^#include "\w+\.h"\n', re.MULTILINE)
_PROTOTYPE = re.compile(
    r"^(?:/\*(?:(?!\*/).)*\*/\n)?(?:int|void) \w+\([^;{}]*\);\n",
    re.MULTILINE | re.DOTALL,
)


def renamed(source: str, prefix: str, real: str, functions: Collection[str] = ()) -> str:
    """C of ``control/c`` with the names, in comments too, the type and the literals of a package, and without includes.

    ``functions`` are the names of what calls the kernels, which get ``call_`` behind the prefix.
    """

    def of_package(match: re.Match[str]) -> str:
        if match[0].startswith(f"{prefix}_kernel_"):  # of the package already, whose prefix may be a module's
            return match[0]
        module, rest = match[0].split("_", 1)
        if module.isupper():
            return f"{prefix.upper()}_{_MODULES[module.lower()].upper()}_{rest}"
        return f"{prefix}_{_MODULES[module]}_{rest}"

    def changed(match: re.Match[str]) -> str:
        if match["comment"]:
            text = _NAME.sub(of_package, match[0]).replace("`real`", f"`{prefix}_real`")
            return _HEADER.sub(f"{prefix}_memory.h", text)
        if match["number"]:
            return literal(float(match["number"]), real, match["number"])
        if not match["name"]:
            return match[0]
        if match[0] == "real":
            return f"{prefix}_real"
        if match[0] in functions:
            return f"{prefix}_call_{match[0]}"
        return _NAME.sub(of_package, match[0])

    return TOKEN.sub(changed, _INCLUDE.sub("", source))


def without_prototypes(header: str) -> tuple[str, str]:
    """Macros and types of a header, and the functions that it declares."""
    return _PROTOTYPE.sub("", header), "".join(match[0] for match in _PROTOTYPE.finditer(header))


def without(macro: str, source: str) -> str:
    """C in which the branches ``#ifdef macro`` and ``#ifndef macro`` are settled as if it were not defined."""
    lines: list[str] = []
    inside: list[bool | None] = []  # of each open condition: whether it is the macro's, and its branch is read
    for line in source.splitlines(keepends=True):
        word = line.split()
        directive = word[0] if word else ""
        if directive in ("#if", "#ifdef", "#ifndef"):
            inside.append(directive == "#ifndef" if directive != "#if" and word[1] == macro else None)
            settled = inside[-1] is not None
        elif directive == "#else" and inside and inside[-1] is not None:
            inside[-1], settled = not inside[-1], True
        elif directive == "#endif":
            settled = inside.pop() is not None
        else:
            settled = False
        if not settled and False not in inside:
            lines.append(line)
    return "".join(lines)
