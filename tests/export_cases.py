"""Packages and tools for the tests of the C package."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest

import continuum_grasp as cg
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import ControlScene, Finger, load
from tests.control_cases import driven_scene, hand_scene
from tests.model.test_many_elements import model_of
from tests.motor_cases import short_scene
from tests.rods import ROOT
from tests.rti_problems import cart_pole

TENDONS = ROOT / "configs/simulate/tendon_step.yaml"
CONTACT = ROOT / "configs/simulate/midpoint_contact.yaml"
DISC = ROOT / "configs/simulate/swing_against_disc.yaml"
MUG = ROOT / "configs/simulate/close_on_mug.yaml"
WITH_FRICTION = {
    "fidelity.family": "arc",
    "fidelity.elements": 2,
    "finger.tendons.friction": 0.1,
    "parameters": ["base_angle", "tip_mass", "tendon_friction", "bending_stiffness"],
}
"""Everything that kernels may call: sine, cosine, exponential, square root."""
WOUND = {
    "fidelity.family": "arc",
    "fidelity.elements": 2,
    "fidelity.bending_range": 1.5,
    "finger.tendons.max_tension": 20.0,
    "finger.tendons.friction_cells": 1,
    "finger.tendons.conduit_bend": 0.5,
}
PULLEY = {
    **WOUND,
    "finger.tendons.drive.backlash": 0.02,
    "finger.tendons.drive.gear_stiffness": 8.0,
    "finger.tendons.drive.position_gain": None,
    "finger.tendons.drive.rate_gain": 0.0,
    "parameters": ["tendon_offset", "tip_mass"],
    "actuation": {"torques": [0.0]},
}
"""Winches whose speed is limited, and a motor with dry friction and a gear with play on one pulley."""
MANY = {
    "many elements, lag": ("arc", "lag"),
    "many elements, everything": ("matched_clothoid", "everything"),
    "many elements, friction": ("clothoid", "friction"),
    "many elements, winches": ("arc", "winches"),
}
"""Fingers whose dynamics are a loop over the links: family and name of ``model_of`` in ``test_many_elements``."""
DRIVES = {f"loop with {drive}": drive for drive in ("servo", "winches", "torques")}
"""Drives of ``driven_scene`` under a controller."""
UNCORRECTED = ["controller.horizon.stages=12", "estimator.disturbances={tip_moment: 0.01}"]
"""Changes of a shipped loop that leave no state for what a camera is off: such an offset stays."""
OPTIONS: dict[str, dict[str, Any]] = {
    "friction": {"substeps": 12},
    "winches": {"substeps": 16},
    "motor": {"substeps": 16},
    "implicit": {"what": ["implicit_step"], "substeps": 2},
    "seen": {"what": ["shape", "velocities", "contact"], "sections": 5},
    **{name: {"what": ["dynamics", "step"], "step": 1e-7} for name in MANY},
}
"""How packages are made that do not come as they are."""
STRICT = ("-std=c99", "-ffp-contract=off", "-fno-math-errno")
SANITIZE = "-fsanitize=address,undefined,float-divide-by-zero,float-cast-overflow"
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wfloat-conversion", "-Wshadow")
WARNINGS += ("-Wundef", "-Wstrict-prototypes", "-Wmissing-prototypes", "-Werror")


@lru_cache
def scene(name: str):
    """Scenes: closed loops with and without estimator, tendons with friction, winches, a motor, a contact, tendons
    alone, two arcs.

    Also a servo, a solver of a cart-pole, a finger that is seen beside a disc and fingers of
    ``MANY`` elements. Of ``direct`` the inputs set the curvature of the tip at once, and a run-time parameter its
    range.
    """
    return {
        "observed": lambda: loop_scene(8),
        "given": lambda: loop_scene(8, observed=False),
        "adapting": lambda: loop_scene(
            8, adapt={"bending_stiffness": 0.3, "tip_mass": 0.003, "drive_time_constant": 0.4}
        ),
        "limited": lambda: loop_scene(8, observed=False, rate=300.0),
        "friction": lambda: load(TENDONS, WITH_FRICTION),
        "winches": lambda: load(ROOT / "configs/simulate/winch_loop.yaml", WOUND),
        "motor": lambda: load(ROOT / "configs/simulate/motor_pulley.yaml", PULLEY),
        "contact": lambda: load(CONTACT, {"fidelity.family": "matched_clothoid"}),
        "tendons": lambda: load(TENDONS),
        "arcs": lambda: load(TENDONS, {"fidelity.family": "arc", "fidelity.elements": 2}),
        "scenarios": scenarios,
        "held": lambda: load(ROOT / "configs/mpc/steady_tip.yaml", UNCORRECTED),
        **{name: lambda drive=drive: short_loop(drive) for name, drive in DRIVES.items()},
        "servo": short_scene,
        "cart-pole": lambda: cg.rti(cart_pole(name="cart-pole")),
        "implicit": lambda: scene("winches"),
        "seen": lambda: load(DISC),
        **{name: lambda made=made: model_of(*made) for name, made in MANY.items()},
        "direct": lambda: FingerModel(
            without_lag(load(TENDONS).finger), family="matched_clothoid", parameters=("bending_stiffness",)
        ),
    }[name]()


def short_loop(drive: str) -> ControlScene:
    """A driven finger under a controller of a short horizon."""
    controller: dict[str, Any] = {"horizon": {"stages": 6, "stage": 0.01}}
    if drive == "winches":
        # Those of configs/mpc/winches.yaml: with a weight of 1 s2/m2, as of tensions, the common length of both cables
        # is all but free, and an ulp of a measurement is 7e-12 m of the command ten steps later instead of 3e-17 m.
        controller["cost"] = {"tip": 2e4, "speed": 0.02, "effort": 100.0, "input_rate": 1e4}
    return driven_scene(drive, controller=controller)


def scenarios() -> ControlScene:
    """A controller that plans for three plants at once."""
    controller = {
        "horizon": {"stages": 5, "stage": 0.01},
        "cost": {"tip": {"running": 2e4, "terminal": 2e3}, "effort": 0.01, "input_rate": 5e-4},
        "input": {"rate_max": 600.0},
        "scenarios": ({"weight": 2.0}, {"time_constant": 0.04}, {"stiffness": 1.5, "tip_mass": 0.002}),
    }
    return hand_scene(estimator=None, controller=controller)


def without_lag(finger: Finger) -> Finger:
    """The same with drives that follow at once."""
    return finger.model_copy(update={"tendons": finger.tendons.model_copy(update={"time_constant": None})})


def loop_scene(
    stages: int, *, observed: bool = True, rate: float | None = None, adapt: dict[str, float] | None = None
) -> ControlScene:
    """Two arcs on two tendons under weight, that are to bend further than their bound; measured late, or known.

    Tensions change at a rate [N/s], or at once.
    """
    finger = scene("tendons").finger
    asked = {
        "measured": {"tip": 3e-4, "tension": 0.1},
        "disturbances": {"tip_moment": 0.02},
        "delay": 0.01,
    }
    if adapt is not None:
        asked |= {"adapt": adapt, "disturbances": {}}
    if not observed:
        finger = without_lag(finger)
    return ControlScene(
        name="two arcs under control",
        finger=finger,
        gravity=(0.0, -9.81),
        fidelity={"family": "arc", "elements": 2},
        parameters=tuple(adapt or ("bending_stiffness",)) if observed else (),
        controller={
            "horizon": {"stages": stages, "stage": 0.01, "substeps": 2},
            "cost": {"bending": {"running": 100.0, "terminal": 10.0}, "effort": 0.1 if observed else 1e-3},
            "bounds": {"curvature": 9.0},
            "input": {"rate_max": rate},
            "start_iterations": 5 if observed else 1,
        },
        reference={
            "bending": {
                "times": (0.0, 0.3, 0.6, 0.9),
                "values": ((0.0, 0.0), (0.7, 0.5), (-0.6, -0.4), (0.9, 0.9)),
                "interpolation": "hold",
            }
        },
        duration=1.2,
        estimator=asked if observed else None,
    )


def two_arcs() -> FingerModel:
    """The finger whose step is counted: two arcs, two tendons, a force at the tip, weight and damping, no lag."""
    return FingerModel(without_lag(scene("tendons").finger), family="arc", elements=2)


def needs(*tools: str):
    """Skip where a program is missing, and name it."""
    missing = [tool for tool in tools if shutil.which(tool) is None]
    return pytest.mark.skipif(bool(missing), reason=f"not installed: {', '.join(missing)}")


def values(struct: Any) -> list[Any]:
    """The fields of a struct of C, in their order."""
    return [getattr(struct, name) for name, _ in struct._fields_]


def run(*line: object, cwd: Path | None = None, expect: int = 0) -> str:
    """What a program says."""
    done = subprocess.run([str(word) for word in line], capture_output=True, text=True, cwd=cwd, check=False)
    assert done.returncode == expect, f"{line}\n{done.stdout}\n{done.stderr}"
    return done.stdout + done.stderr


def compile_programs(compiler: str, package: Path, folder: Path, programs: str, *flags: str) -> list[Path]:
    """Test programs of a package, all of it with the same flags."""
    line = [*compiler.split(), *flags, f"-I{package / 'include'}"]
    shared = [*sorted((package / "src").glob("*.c")), package / "tests/check.c"]
    run(*line, "-c", *shared, cwd=folder)
    objects = [folder / f"{path.stem}.o" for path in shared]
    found = [folder / f"{program}.run" for program in programs.split()]
    for program, path in zip(programs.split(), found, strict=True):
        run(*line, package / f"tests/{program}.c", *objects, "-o", path)
    return found


def shared_library(package: Path, out: Path, *flags: str):
    """The library by the Python binding of its own package, compiled here."""
    library = out / "libfinger.so"
    out.mkdir(parents=True, exist_ok=True)
    run(
        "cc",
        *STRICT,
        *flags,
        "-O2",
        "-shared",
        "-fPIC",
        f"-I{package / 'include'}",
        *(package / "src").glob("*.c"),
        "-o",
        library,
    )
    spec = importlib.util.spec_from_file_location("finger", package / "examples/python/finger.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module, module.Library(str(library))
