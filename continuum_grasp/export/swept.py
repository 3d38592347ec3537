"""Strict C of forward dynamics by sweeps: kernels of one link in a loop, and the same loop on numpy arrays."""

from __future__ import annotations

from collections import Counter

import casadi as ca
import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.core import CReal
from continuum_grasp.export.fields import fill
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.model import Kernels

_TEXTS = {
    "head": "What acts, from the input.",
    "carry": "What motion and friction depend on, from the start of a link to its end.",
    "tip": "Inertia at the tip.",
    "outward": "Shape, inertia and forces of a link.",
    "turn": "Rotation from the start of a link to its end.",
    "loads": "Forces of point loads on their links.",
    "inward": "Inertia and force that the start of a link feels.",
    "root": "Accelerations at the base.",
    "onward": "Accelerations from the start of a link to its end.",
    "driven": "Rates of drives and friction states that feel the motion.",
}


class SweptKernel(Kernel):
    """Forward dynamics (x, u, w, p) -> xd; see ``Kernel``.

    ``driven``: ``drive_rates`` of a model whose drives feel the motion.
    """

    def __init__(self, name: str, made: Kernels, text: str, driven: ca.Function | None = None) -> None:
        self.name = name
        self.text = text
        self._made = made
        parts = dict(zip(_TEXTS, [*made.functions, *([] if driven is None else [driven])], strict=False))
        if not made.loaded:
            del parts["turn"], parts["loads"]
        self._parts = {key: Kernel(f"{name}_{key}", f, _TEXTS[key]) for key, f in parts.items()}
        self._sizes = {key: {name: f.size1_out(name) for name in f.name_out()} for key, f in parts.items()}
        read = {name for part in self._parts.values() for name in part.inputs}
        loads = made.loads
        sizes = {"u": made.head.size1_in("u"), "w": loads.size1_in("w"), "p": made.head.size1_in("p")}
        nx = made.loads.size1_in("x")
        self.inputs = {"x": nx, **{key: size for key, size in sizes.items() if key in read}}
        self.outputs = {"xd": nx}

    @property
    def calls(self) -> set[str]:
        """Mathematical functions that its parts need."""
        return set().union(*(part.calls for part in self._parts.values()))

    @property
    def operations(self) -> Counter[str]:
        """Number of operations of each kind in an evaluation."""
        total: Counter[str] = Counter()
        for key, part in self._parts.items():
            times = 1 if key in ("head", "tip", "loads", "root", "driven") else self._made.links
            total.update({kind: times * count for kind, count in part.operations.items()})
        return total

    def c_source(self, prefix: str, real: CReal) -> str:
        """The C definition, with the definitions of its parts."""
        parts = [part.c_source(prefix, real).replace("\nvoid ", "\nstatic void ", 1) for part in self._parts.values()]
        return "\n".join([*parts, self._loop(prefix, real)])

    def _arguments(self, key: str) -> dict[str, str]:
        """C of the arguments of a part."""
        made = self._made
        window = f"k * {made.stride}"
        arguments = {"lag": f"x + {2 * made.unknowns}", "spin": "spins[k]", "spun": "spins[k + 1]"}
        arguments |= {"q": f"q + {window}", "qd": f"qd + {window}", "row": "rows[k]"}
        arguments |= {"shape": "shape[k]", "body": "body[k]", "gain": "gain[k]", "turn": "turns[k]"}
        arguments |= {"turned": "turns[k + 1]", "turns": "before", "handed": "end", "following": "start"}
        arguments |= {"rates": f"rates + {made.shared} + {window}", "force": "acting" if key == "loads" else "force[k]"}
        return arguments | ({"spin": f"spins[{made.links}]"} if key == "tip" else {})

    def _loop(self, prefix: str, real: CReal) -> str:
        made = self._made
        sizes = dict[str, int]()
        for of in self._sizes.values():
            sizes |= of
        calls = {key: part.call(prefix, **self._arguments(key)) for key, part in self._parts.items()}
        tip = sizes["tip"]
        rows = made.rows.tolist()
        return fill(
            "sweep.c",
            {
                **sizes,
                **{f"{key}_call": calls.get(key, "") for key in _TEXTS},
                "driven_call": f"\n  {calls['driven']}" if "driven" in calls else "",
                "text": self.text,
                "head": self.prototype(prefix),
                "real": f"{prefix}_real",
                "zero": real.literal(0.0),
                "one": real.literal(1.0),
                "rows": ",\n    ".join(f"{{{', '.join(map(real.literal, row))}}}" for row in rows if row),
                "row": made.rows.shape[1],
                "made": made,
                "drive": max(sizes["drive"], 1),
                "lags": self.outputs["xd"] - 2 * made.unknowns,
                "full": made.unknowns + tip,
                "end_size": sizes["end"],
                "loads": len(made.loaded),
                "loaded": ", ".join(map(str, made.loaded)),
                "force": made.section + made.local,
                "section": made.section,
            },
        )

    def evaluate(self, real: CReal, **rows: Array) -> dict[str, Array]:
        """Evaluate as the C does, to the last bit; see ``Kernel``."""
        made, t = self._made, real.dtype
        n = made.unknowns
        links = range(made.links)
        x = np.asarray(rows["x"], dtype=t)
        count = len(x)

        def part(key: str, **inputs: Array) -> dict[str, Array]:
            kernel = self._parts[key]
            read = {name: inputs[name] for name in kernel.inputs} or {"none": np.zeros((count, 0))}
            none = {name: np.zeros((count, size), dtype=t) for name, size in self._sizes[key].items()}
            return none | kernel.evaluate(real, **read)

        outer = {name: rows[name] for name in ("u", "w", "p") if name in rows} | {"x": x, "lag": x[:, 2 * n :]}
        head = part("head", **outer)
        q = np.hstack([x[:, :n], head["tip"]])
        qd = np.hstack([x[:, n : 2 * n], head["tip_rate"]])
        row = [np.tile(made.rows[k].astype(t), (count, 1)) for k in links]
        window = [slice(k * made.stride, k * made.stride + made.local) for k in links]
        spin = [np.zeros((count, self._sizes["carry"]["spun"]), dtype=t)]
        bodies = []
        for k in links:
            link_inputs = {"q": q[:, window[k]], "qd": qd[:, window[k]], "row": row[k], "spin": spin[k], **outer}
            spin.append(part("carry", **link_inputs)["spun"])
            bodies.append(part("outward", **link_inputs, drive=head["drive"]))
        force = [np.zeros((count, made.section + made.local), dtype=t) for _ in links]
        if made.loaded:
            turns = [np.tile(np.array([1, 0], dtype=t), (count, 1))]
            for k in links:
                turns.append(part("turn", turn=turns[k], shape=bodies[k]["shape"])["turned"])
            acting = part("loads", turns=np.hstack([turns[k] for k in made.loaded]), **outer)["force"]
            for link, load in zip(made.loaded, np.split(acting, len(made.loaded), axis=1), strict=True):
                force[link] = force[link] + load
        end = part("tip", spin=spin[-1], **outer)["end"]
        gains = []
        for k in reversed(links):
            results = part("inward", end=end, row=row[k], force=force[k], **bodies[k], **outer)
            end = results["handed"]
            gains.append(results["gain"])
        start = part("root", end=end, base=head["base"])["start"]
        rates = [start[:, made.section :]]
        for k in links:
            results = part("onward", start=start, shape=bodies[k]["shape"], gain=gains[-1 - k], row=row[k])
            start = results["following"]
            rates.append(results["rates"])
        lagging = (part("driven", **outer) if "driven" in self._parts else head)["lagging"]
        return {"xd": np.hstack([x[:, n : 2 * n], np.hstack(rates)[:, :n], lagging])}
