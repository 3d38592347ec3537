"""C of sweeps along the chain: one loop over the links in place of CasADi's, which copies what it hands on."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from continuum_grasp.model.sweep import SECTION, SWEEPS, Kernels

_FUNCTION = re.compile(r"^/\* (\w+):\(.*\*/\nstatic int (\w+)\((.*)\) \{\n", re.MULTILINE)


def with_loops(source: str, fill: Callable[..., str]) -> str:
    """CasADi's C with a loop in place of each sweep; ``fill`` is that of the templates."""
    found = {match[1]: match for match in _FUNCTION.finditer(source)}
    # Backwards, so that the places of those before stay as they are.
    for name, match in reversed(found.items()):
        if name not in SWEEPS:
            continue
        made = SWEEPS[name]
        calls = [found[f.name()][2] if f.name() in found else "" for f in made.functions]
        end = source.index("\n}\n", match.end()) + 3
        head = source[match.start() : match.end()].rstrip("{\n").replace("* w,", "* work,")
        source = f"{source[: match.start()]}{head}\n{fill('sweep.c', **_words(made, calls))}\n{source[end:]}"
    return source


def _words(made: Kernels, calls: list[str]) -> dict[str, object]:
    head, outward, loads, inward, root, onward = made.functions
    sizes = {
        "drive": head.size1_out("drive"),
        "end": head.size1_out("end"),
        "start": root.size1_out("start"),
        "spin": outward.size1_in("spin"),
        "shape": outward.size1_out("shape"),
        "body": outward.size1_out("body"),
        "gain": inward.size1_out("gain"),
        "force": inward.size1_in("force"),
        "row": made.rows.shape[1],
        "r": outward.size1_in("r"),
    }
    implicit, tip = outward.size1_in("part") > 0, head.size1_out("tip") > 0
    return {
        # Arrays have an entry at least.
        **{name: max(size, 1) for name, size in sizes.items()},
        **dict(zip(("head", "outward", "load", "inward", "root", "onward"), calls, strict=True)),
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
        "spun": sizes["spin"],
        "lagged": head.size1_out("lagging"),
        "implicit": implicit,
        "explicit": not implicit,
        "row_of": "rows[k]" if made.rows.size else "0",
        "r_of": "r[k]" if implicit else "0",
        "force_of": "force[k]" if made.loaded else "0",
    }
