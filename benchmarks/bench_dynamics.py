"""Forward dynamics: against the paper, instructions, batches, growth with the elements.

Run ``python -m benchmarks.bench_dynamics`` in the root of the repository; see README.md beside this file.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.harness import STATES, CLoop, Timing, one_core, race, time_c_loop
from benchmarks.paper import PaperModel
from benchmarks.report import Report, arguments
from continuum_grasp.core import compile
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.finger import BasePose, Damping, Finger, PointMass, Rod, Tendons

LENGTH, LINEAR_DENSITY, STIFFNESS = 0.6, 6450 * math.pi * 0.001**2, 60e9 * math.pi * 0.002**4 / 64
TIP_MASS, DAMPING, TENDON_OFFSET = 0.02, 1e-4, 0.005
FAMILIES = ("arc", "clothoid", "matched_clothoid")
ELEMENTS = (1, 2, 4, 8, 16, 32)
BATCH = 4096
OURS = "two arcs"


def finger(tip_mass: float = TIP_MASS, damping: float = DAMPING, tendons: bool = True) -> Finger:
    """The paper's rod along world +X, with a tip mass, the paper's friction and tendons."""
    return Finger(
        rod=Rod(length=LENGTH, linear_density=LINEAR_DENSITY, bending_stiffness=STIFFNESS),
        damping=Damping(per_arc=damping),
        masses=(PointMass(at=LENGTH, mass=tip_mass),) if tip_mass else (),
        tendons=Tendons(offset=TENDON_OFFSET, max_tension=40.0) if tendons else None,
        base=BasePose(angle=-math.pi / 2),
    )


def full_model(family: str = "arc", **settings: Any) -> FingerModel:
    """Everything in: tip mass, gravity, forces at contact and tip, damping, tendons; constants folded."""
    return FingerModel(finger(), contacts=(0.3,), family=family, **settings)


def bare_model() -> FingerModel:
    """Two arcs without gravity, mass, damping, or forces; the tip moment drives them."""
    bare = finger(tip_mass=0.0, damping=0.0, tendons=False)
    return FingerModel(bare, elements=2, family="arc", gravity=(0.0, 0.0), tip_force=False)


def paper_dynamics(variant: str, **settings: Any) -> ca.Function:
    """The same by the paper's equations as one would write them for speed."""
    return PaperModel(finger(), variant, contacts=(0.3,), **settings).forward_dynamics


def random_arguments(model: FingerModel, rng: np.random.Generator) -> list[np.ndarray]:
    """``STATES`` random x, u, w and p; bends up to 0.9 of the declared range, the chain at most 4 rad."""
    reach = min(0.9 * min(model.ranges), 4.0 / len(model.lengths))
    scale = reach if model.family == "arc" else reach / max(model.lengths) / 2
    x = rng.uniform(-1.0, 1.0, (STATES, model.nx))
    x[:, : model.n] *= scale
    x[:, model.n :] *= 5.0 * scale
    u = rng.uniform(0.0, 20.0 if model.nu == 2 else 0.1, (STATES, model.nu))
    return [x, u, rng.uniform(-0.5, 0.5, (STATES, model.nw)), np.tile(model.p_nominal, (STATES, 1))]


def count_instructions(function: Any) -> dict[str, int]:
    """Instructions of a CasADi SX function.

    ``total`` is ``Function.n_instructions()``: every operation, and every load of an input entry, store of
    an output entry and constant as one instruction each. Limits on instruction counts in this project mean
    ``total``. ``arithmetic`` leaves loads, stores and constants out; ``divisions`` and ``libm`` (sin, cos,
    sqrt, exp, ...) are part of it.
    """
    if not function.is_a("SXFunction"):
        raise TypeError(f"expected an SX function, got {function.class_name()}: expand() it")
    ids = [function.instruction_id(k) for k in range(function.n_instructions())]
    plain = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}
    library = {
        getattr(ca, f"OP_{name}")
        for name in (
            *("SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN", "ATAN2", "SINH", "COSH", "TANH", "ASINH", "ACOSH"),
            *("ATANH", "EXP", "EXPM1", "LOG", "LOG1P", "POW", "CONSTPOW", "SQRT", "ERF", "HYPOT", "FMOD"),
        )
    }
    return {
        "total": len(ids),
        "loads": ids.count(ca.OP_INPUT),
        "stores": ids.count(ca.OP_OUTPUT),
        "constants": ids.count(ca.OP_CONST),
        "arithmetic": sum(i not in plain for i in ids),
        "divisions": sum(i in (ca.OP_DIV, ca.OP_INV) for i in ids),
        "libm": sum(i in library for i in ids),
    }


def against_the_paper(report: Report, rng: np.random.Generator) -> None:
    """Two arcs with everything in against the paper's closed forms and its appendix."""
    model = full_model()
    functions = {
        OURS: model.forward_dynamics,
        "closed forms, Lagrange": paper_dynamics("closed_corrected", bias="lagrange"),
        "closed forms, Christoffel": paper_dynamics("closed_corrected"),
        "energy by quadrature, Lagrange": paper_dynamics("closed_corrected", bias="quadrature"),
        "appendix, corrected": paper_dynamics("appendix_corrected"),
    }
    given = random_arguments(model, rng)
    extra = {}
    for name, function in functions.items():
        counts = count_instructions(function)
        difference = _difference(function, model.forward_dynamics, given)
        extra[name] = [counts["total"], counts["arithmetic"], difference]
    columns = ["instructions", "arithmetic", "greatest difference"]
    note = "Difference of xd, relative to its greatest entry, over states with both angles beyond 0.3 rad."
    found = {}
    for title, dependent in (
        ("Two arcs, everything in, each evaluation waiting for the one before", True),
        ("Two arcs, everything in, evaluations overlapping", False),
    ):
        timings = time_c_loop(functions, dict.fromkeys(functions, given), seed=report.seed, dependent=dependent)
        found[dependent] = report.add_race(title, timings, OURS, extra=extra, extra_columns=columns, note=note)
    ratio = found[True]
    slower = ratio["closed forms, Lagrange"]
    report.claim("closed forms in the paper's style take so many times as long", slower, ">=", 8)
    report.claim("two arcs take so many times the appendix", 1 / ratio["appendix, corrected"], "<=", 1.1)


def _difference(function: Any, reference: Any, given: list[np.ndarray]) -> float:
    x = given[0]
    chosen = [k for k in range(STATES) if np.abs(x[k, :2]).min() > 0.3][:200]
    worst = 0.0
    for k in chosen:
        expected = reference(*[g[k] for g in given]).full()
        worst = max(
            worst,
            float(np.abs(function(*[g[k] for g in given]).full() - expected).max() / np.abs(expected).max()),
        )
    return worst


def instructions(report: Report) -> None:
    """Instruction counts of the forward dynamics."""
    models = {
        "two arcs, everything in, constants folded": full_model(),
        "two arcs, everything in, tip mass and stiffness at run time": full_model(
            parameters=("tip_mass", "bending_stiffness")
        ),
        "two arcs, no gravity, mass, damping or forces": bare_model(),
        "two clothoids, everything in": full_model("clothoid"),
        "two matched clothoids, everything in": full_model("matched_clothoid"),
    }
    counts = {name: count_instructions(model.forward_dynamics) for name, model in models.items()}
    columns = ["", *next(iter(counts.values()))]
    rows = [[name, *count.values()] for name, count in counts.items()]
    report.table("Instructions", columns, rows, "total: with loads, stores and constants.")
    totals = [count["total"] for count in counts.values()]
    report.claim("instructions, everything in, constants folded", totals[0], "<=", 650)
    report.claim("instructions, bare", totals[2], "<=", 380)


def batch(report: Report, rng: np.random.Generator) -> None:
    """A batch in one call against one state at a time, on one core."""
    rows = []
    for family in FAMILIES:
        model = full_model(family)
        given = random_arguments(model, rng)
        core = compile(model)
        many = [np.ascontiguousarray(np.tile(g, (BATCH // STATES, 1))) for g in given]

        def evaluate(count: int, core: Any = core, many: list[np.ndarray] = many) -> None:
            for _ in range(count):
                core.batch("forward_dynamics", *many)

        with one_core():
            timings = race({"one": CLoop(model.forward_dynamics, given), "batch": evaluate}, seed=report.seed)
        one, together = 1e9 * timings["one"].median, 1e9 * timings["batch"].median / BATCH
        rows.append([family, one, together, one / together, timings["batch"].reason or timings["batch"].status])
        if family == "arc":
            report.claim(f"a batch of {BATCH} is so many times as fast per state", one / together, ">=", 4)
    columns = ["", "one at a time [ns]", "in a batch [ns]", "gain", "status"]
    report.table(f"Batch of {BATCH} states, everything in", columns, rows)


def growth(report: Report, rng: np.random.Generator, most: int) -> None:
    """Cost of the forward dynamics over the number of elements of each family."""
    rows = []
    two: dict[str, Timing] = {}
    for count in [c for c in ELEMENTS if c <= most]:
        models = {
            family: FingerModel(finger(tendons=False), elements=count, family=family, tip_force=False)
            for family in FAMILIES
        }
        functions = {family: model.forward_dynamics for family, model in models.items()}
        given = {family: random_arguments(model, rng) for family, model in models.items()}
        flags = ("-O1" if count > 8 else "-O3", "-march=native", "-fPIC")
        timings = time_c_loop(functions, given, seed=report.seed, flags=flags, repeats=15)
        two = timings if count == 2 else two
        for family, timing in timings.items():
            total = functions[family].n_instructions()
            rows.append([family, count, models[family].n, total, 1e9 * timing.median, timing.status])
    columns = ["family", "elements", "unknowns", "instructions", "median [ns]", "status"]
    rows.sort(key=lambda row: (FAMILIES.index(row[0]), row[1]))
    note = "Tip mass, gravity, damping and tip moment; -O1 above 8 elements, where -O3 takes minutes to compile."
    report.table("Growth with the number of elements", columns, rows, note)
    if two:
        ratio = two["matched_clothoid"].median / two["arc"].median
        report.claim("two matched clothoids take so many times two arcs", ratio, "<=", 2)


PARTS = ("paper", "instructions", "batch", "growth")


def main() -> None:
    """Run what is asked for and write the report."""
    asked = arguments(__doc__, only=(PARTS, ""), elements=(max(ELEMENTS), "most elements in the growth table"), seed=0)
    report, rng = Report("dynamics", asked.seed), np.random.default_rng(asked.seed)
    if "paper" in asked.only:
        against_the_paper(report, rng)
    if "instructions" in asked.only:
        instructions(report)
    if "batch" in asked.only:
        batch(report, rng)
    if "growth" in asked.only:
        growth(report, rng, asked.elements)
    report.finish()


if __name__ == "__main__":
    main()
