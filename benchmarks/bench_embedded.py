"""What C packages cost on emulated microcontrollers: instructions, code, stack and memory.

Run ``python -m benchmarks.bench_embedded`` in the root of the repository (3 min; gcc-arm-none-eabi, qemu-system-arm).
Steps and controllers of the tests, and the controller of docs/embedded.md, are exported, and run their test vectors on
a Cortex-M4F in float and a Cortex-M7 in double. The limits of instructions are what trials of other formulations took.
"""

from __future__ import annotations

import tempfile
from typing import Any

import continuum_grasp as cg
from benchmarks.harness import CONFIGS
from benchmarks.report import begun
from continuum_grasp.export.targets import TOOLS
from tests.export_cases import TENDONS, loop_scene, two_arcs

BOARDS = (("float", "cortex-m4f"), ("double", "cortex-m7"))
STAGES = (8, 20, 30)
TRIALS = {"step": {"cortex-m4f": 5_492, "cortex-m7": 6_736}, "mpc": {"cortex-m4f": 568_000, "cortex-m7": 589_000}}
"""Instructions of a step of two arcs, and of an iteration with eight stages of bounded inputs, in a trial."""
DOCUMENTED = CONFIGS / "mpc/steady_tip.yaml"
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
    _, report = begun(__doc__, "embedded")
    steps = report.table("Steps", ["", "mean", "most", "code of all parts [bytes]", "stack [bytes]"])
    kinds = [f"{kind}, {which}" for kind in ("usual", "start", "hard") for which in ("mean", "most")]
    note = "usual: goes on from a plan; start: without one; hard: limits change under way, states jump."
    calls = report.table("Calls of controllers", ["", *kinds, "code [bytes]", "stack [bytes]"], note=note)
    for real, board in BOARDS:
        for name, of in (("two arcs", two_arcs()), ("two matched clothoids", TENDONS)):
            steps.add(*row(measured(of, real, board), f"{name}, {board}, {real}", ("step",)))
        report.claim(f"two arcs, {board}: instructions of a step", steps.rows[-2][2], "<=", TRIALS["step"][board])
    controllers: dict[str, Any] = {f"{count} stages": loop_scene(count, observed=False) for count in STAGES}
    controllers |= {"docs/embedded.md": cg.load(DOCUMENTED, CHANGES), "steady_tip.yaml": cg.load(DOCUMENTED)}
    for name, of in controllers.items():
        for real, board in BOARDS:
            found = measured(of, real, board)
            calls.add(*row(found, f"{name}, {board}, {real}", ("mpc", "mpc_start", "mpc_hard")))
            if name == f"{STAGES[0]} stages":
                most = calls.rows[-1][2]
                report.claim(f"{name}, {board}: instructions of usual calls", most, "<=", TRIALS["mpc"][board])
            elif name == "steady_tip.yaml" and real == "float":
                report.claim(f"{name}, {board}: bytes of code", calls.rows[-1][-2], "<=", MOST_CODE)
    report.machine |= {tool: found["measured"][key] for tool, key in zip(TOOLS, ("compiler", "emulator"), strict=True)}
    report.finish()


if __name__ == "__main__":
    main()
