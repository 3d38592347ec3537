"""Runs inside the interpreter that has the peer libraries: builds, records and times releases on request.

One JSON object per line on standard input, one answer per line on standard output:
``{"make": name, "kind": ..., "rod": ..., "settings": ..., "frames": ...}`` builds one, and with frames simulates one
second and answers with the tip; ``{"run": name, "seconds": ...}`` steps and answers when done;
``{"version": package}``.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from importlib.metadata import version
from typing import Any


def build(kind: str, rod: dict, settings: dict) -> Any:
    """A simulation of one library."""
    if kind == "mujoco":
        from mujoco_chain import Chain

        return Chain(rod, **settings)
    if kind == "pyelastica":
        from pyelastica_rod import Rod

        return Rod(rod, **settings)
    from segment_release import Segments

    return Segments(rod, kind, **settings)


def answer(request: dict, made: dict[str, Any]) -> dict:
    """What one request asks for."""
    if "version" in request:
        return {"version": version(request["version"])}
    if "run" in request:
        made[request["run"]].run(request["seconds"])
        return {}
    began = time.perf_counter()
    one = made[request["make"]] = build(request["kind"], request["rod"], request["settings"])
    one.run(1.0 / one.steps)
    cold = time.perf_counter() - began
    tips = one.tips(math.gcd(request["frames"], one.steps)) if request["frames"] else None
    return {"cold": cold, "steps": one.steps, "tip": None if tips is None else tips.tolist()}


def main() -> None:
    """Serve until the input ends; what libraries print goes to the error stream."""
    out = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)
    made: dict[str, Any] = {}
    for line in sys.stdin:
        try:
            reply = answer(json.loads(line), made)
        except Exception as error:
            reply = {"error": f"{type(error).__name__}: {error}"}
        out.write(json.dumps(reply) + "\n")


if __name__ == "__main__":
    main()
