"""What C packages cost on emulated microcontrollers: instructions, code, stack and memory.

Run ``python -m benchmarks.bench_embedded`` in the root of the repository (3 min; gcc-arm-none-eabi, qemu-system-arm).
Steps and controllers of the tests, and the controller of docs/embedded.md, are exported, and run their test vectors on
a Cortex-M4F in float and a Cortex-M7 in double. The limits of instructions are what trials of other formulations took.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import continuum_grasp as cg
from benchmarks.report import Report, arguments
from continuum_grasp.export.targets import TOOLS
from tests.export_cases import TENDONS, loop_scene, two_arcs

BOARDS = (("float", "cortex-m4f"), ("double", "cortex-m7"))
STAGES = (8, 20, 30)
TRIALS = {"step": {"cortex-m4f": 5_492, "cortex-m7": 6_736}, "mpc": {"cortex-m4f": 568_000, "cortex-m7": 589_000}}
"""Instructions of a step of two arcs, and of an iteration with eight stages of bounded inputs, in a trial."""
DOCUMENTED = Path(__file__).parents[1] / "configs/mpc/steady_tip.yaml"
CHANGES = {"fidelity.family": "arc", "controller.horizon.stages": 8}
MOST_CODE = 100_000
"""Bytes of code that the same configuration as it is may have, two matched clothoids over 30 stages."""


def measured(given: Any, real: str, board: str, **options: Any) -> dict[str, Any]:
    """Manifest of a package that was run on its board."""
    with tempfile.TemporaryDirectory() as folder:
        return dict(cg.export_c(given, folder, real=real, target=board, measured=True, **options).manifest)


def row(found: dict[str, Any], name: str, functions: tuple[str, ...]) -> list[Any]:
    """Instructions of some functions, mean and most; code, and the deepest stack."""
    counts = found["measured"]["functions"]
    cells = [counts[f][f"{which}_instructions"] for f in functions for which in ("mean", "most")]
    code = sum(size["text"] for size in found["measured"]["sizes"].values())
    return [name, *cells, code, max(counts[f]["stack_bytes"] for f in functions)]


def main() -> None:
    arguments(__doc__)
    report = Report("embedded", 0)
    steps, calls = [], []
    for real, board in BOARDS:
        found = measured(two_arcs(), real, board)
        steps.append(row(found, f"two arcs, {board}, {real}", ("step",)))
        report.claim(f"two arcs, {board}: instructions of a step", steps[-1][2], "<=", TRIALS["step"][board])
        steps.append(row(measured(TENDONS, real, board), f"two matched clothoids, {board}, {real}", ("step",)))
    for stages in STAGES:
        for real, board in BOARDS:
            found = measured(loop_scene(stages, observed=False), real, board)
            calls.append(row(found, f"{stages} stages, {board}, {real}", ("mpc", "mpc_start", "mpc_hard")))
            if stages == STAGES[0]:
                most = calls[-1][2]
                report.claim(f"{stages} stages, {board}: instructions of usual calls", most, "<=", TRIALS["mpc"][board])
    for real, board in BOARDS:
        found = measured(cg.load(DOCUMENTED, CHANGES), real, board)
        calls.append(row(found, f"docs/embedded.md, {board}, {real}", ("mpc", "mpc_start", "mpc_hard")))
    for real, board in BOARDS:
        found = measured(cg.load(DOCUMENTED), real, board)
        calls.append(row(found, f"steady_tip.yaml, {board}, {real}", ("mpc", "mpc_start", "mpc_hard")))
        if real == "float":
            report.claim(f"steady_tip.yaml, {board}: bytes of code", calls[-1][-2], "<=", MOST_CODE)
    report.machine |= {tool: found["measured"][key] for tool, key in zip(TOOLS, ("compiler", "emulator"), strict=True)}
    report.table("Steps", ["", "mean", "most", "code of all parts [bytes]", "stack [bytes]"], steps)
    kinds = [f"{kind}, {which}" for kind in ("usual", "start", "hard") for which in ("mean", "most")]
    note = "usual: goes on from a plan; start: without one; hard: limits change under way, states jump."
    report.table("Calls of controllers", ["", *kinds, "code [bytes]", "stack [bytes]"], calls, note)
    report.finish()


if __name__ == "__main__":
    main()
