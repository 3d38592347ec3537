"""C of sweeps along the chain: one loop over the links in place of CasADi's, which copies what it hands on."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

import casadi as ca
import numpy as np

from continuum_grasp.core.lanes import lane_function
from continuum_grasp.model.sweep import SECTION, SWEEPS, Kernels

_FUNCTION = re.compile(r"^/\* (\w+):\(.*\*/\nstatic int (\w+)\((.*)\) \{\n", re.MULTILINE)
_STATIC = re.compile(r"^/\* \w+:\([^\n]*\*/\nstatic int (casadi_f\d+)\(.*?^}\n", re.MULTILINE | re.DOTALL)
_NAME = re.compile(r"\bcasadi_f\d+\b")
_MACRO = re.compile(r"^#define .*\n", re.MULTILINE)
_PRELUDE = "/* lanes */\n"


def with_loops(source: str, fill: Callable[..., str], prelude: str) -> str:
    """CasADi's C with a loop in place of each sweep.

    ``fill`` is that of the templates, ``prelude`` is what lanes need.
    """
    kernels = dict[str, re.Match[str]]()
    for match in _FUNCTION.finditer(source):
        kernels.setdefault(match[1], match)  # equal kernels of several sweeps: the first stands before all of them
    # Backwards, so that the places of those before stay as they are.
    for name, match in reversed(kernels.items()):
        if name not in SWEEPS:
            continue
        made = SWEEPS[name]
        symbols = {f.name(): kernels[f.name()][2] if f.name() in kernels else f.name() for f in made.functions}
        folded = "\n".join(_constant(f) for f in made.functions if f.name() not in kernels)
        end = source.index("\n}\n", match.end()) + 3
        head = source[match.start() : match.end()].rstrip("{\n").replace("* w,", "* work,")
        body = f"{_PRELUDE}{folded}{lane_function(made.outward)}\n{head}\n{fill('sweep.c', **_words(made, symbols))}\n"
        source = f"{source[: match.start()]}{body}{source[end:]}"
    return _used(source).replace(_PRELUDE, prelude, 1).replace(_PRELUDE, "") if _PRELUDE in source else source


def _constant(function: ca.Function) -> str:
    """C of a function that CasADi has left out of a source, since it does not depend on its inputs."""
    values = function.call([ca.DM.zeros(function.size_in(k)) for k in range(function.n_in())])
    entries = [(k, j, v) for k, value in enumerate(values) for j, v in enumerate(value.nonzeros())]
    lines = "".join(f"  res[{k}][{j}] = {v!r};\n" for k, j, v in entries)
    arguments = "const casadi_real** arg, casadi_real** res, casadi_int* iw, casadi_real* w, int mem"
    return f"static int {function.name()}({arguments})\n{{\n{lines}  return 0;\n}}\n"


def _used(source: str) -> str:
    """The source without the functions of CasADi that nothing calls any more."""
    parts, rest, last = dict[str, str](), "", 0
    for match in _STATIC.finditer(source):
        parts[match[1]] = match[0]
        rest += source[last : match.start()]
        last = match.end()
    rest += source[last:]
    # A macro gives each of them a prefix.
    calls = {name: set(_NAME.findall(text)) & parts.keys() - {name} for name, text in parts.items()}
    used, reached = set[str](), set(_NAME.findall(_MACRO.sub("", rest))) & parts.keys()
    while reached:
        used |= reached
        reached = {called for name in reached for called in calls[name]} - used
    return _STATIC.sub(lambda match: match[0] if match[1] in used else "", source)


def _words(made: Kernels, symbols: Mapping[str, str]) -> dict[str, object]:
    head, carry, last, outward, _, _, inward, root, _ = made.functions
    sizes = {
        "drive": head.size1_out("drive"),
        "section_end": last.size1_out("end"),
        "lagging": head.size1_out("lagging"),
        "start": root.size1_out("start"),
        "spin": carry.size1_in("spin"),
        "p": outward.size1_in("p"),
        "shape": outward.size1_out("shape"),
        "body": outward.size1_out("body"),
        "gain": inward.size1_out("gain"),
        "force": inward.size1_in("force"),
        "row": made.rows.shape[1],
    }
    implicit, tip = outward.size1_in("part") > 0, head.size1_out("tip") > 0
    return {
        # Arrays have an entry at least.
        **{name: max(size, 1) for name, size in sizes.items()},
        **{f"{f.name().partition('_')[0]}_of": symbols[f.name()] for f in made.functions},
        "outward": outward.name(),
        "widest": max(outward.size1_in(k) for k in range(5)) or 1,
        "drives": sizes["drive"],
        "ps": sizes["p"],
        "rows": ",\n".join(f"{{{', '.join(map(repr, row))}}}" for row in np.asarray(made.rows).tolist() if row),
        "loaded": ", ".join(map(str, made.loaded)),
        "loads": len(made.loaded),
        "links": made.links,
        "local": made.local,
        "shared": made.shared,
        "stride": made.stride,
        "section": SECTION,
        "n": made.unknowns,
        "lag": 2 * made.unknowns,
        "full": made.unknowns + tip,
        "tip": tip,
        "lagged": sizes["lagging"],
        "implicit": implicit,
        "row_of": "rows[k]" if made.rows.size else "0",
        "force_of": "force[k]" if made.loaded else "0",
    }
