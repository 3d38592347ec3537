"""Functional mock-up units of every shipped finger and closed loop: validated, simulated, compared.

Run ``python -m benchmarks.bench_fmu`` in the root of the repository (10 min), with the extras fmu and test; ``--only``
takes some and leaves the others as they were found before. A finger takes 100 steps by its FMUs and by the C package,
which is compiled and called apart from them. Of a closed loop plant and controller take 100 periods together, with the
plant's noise set to 0, beside ``run_closed_loop``. All is compiled quickly: what the strict C computes does not depend
on that.
"""

from __future__ import annotations

import os

os.environ.setdefault("CONTINUUM_GRASP_QUICK_COMPILE", "1")

import argparse
import json
import tempfile
import time
import zipfile
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.validation import validate_fmu

import continuum_grasp as cg
from benchmarks.report import RESULTS, Report
from continuum_grasp.closed_loop.plant_model import PlantModel
from continuum_grasp.control.ocp.cost_terms import Outputs
from continuum_grasp.control.ocp.setpoints import setpoints
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.errors import ContinuumGraspError
from continuum_grasp.export import FunctionalMockupUnit, export_c, export_fmu
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.load import load
from continuum_grasp.scene.simulate import Scene
from tests.export_cases import shared_library
from tests.fmu_cases import Instance
from tests.rods import ROOT

RECORD = RESULTS / "fmu.json"
STEPS = 100
"""Internal steps of a finger, periods of a closed loop."""
ROUNDING = 1e-6
"""Largest difference of a loop's commands, per the largest of them, that rounding explains."""
HELD = 1e-3
"""The same where loads vary within a step, over which an FMU holds them at what they are in its middle."""


def opened(unit: FunctionalMockupUnit) -> Instance:
    """An instance of a unit in which validation finds nothing."""
    if problems := validate_fmu(str(unit.file)):
        raise RuntimeError(f"{unit.file.name}: {problems}")
    fmpy.extract(str(unit.file), str(unit.file.with_suffix("")))
    return Instance(unit)


def finger(scene: Scene, units: dict[tuple[str, str], FunctionalMockupUnit], folder: Path) -> tuple[str, float, float]:
    """What steps are compared with, the largest difference of a state, and what it may be."""
    one = units["plant", "2"]
    with zipfile.ZipFile(one.file) as archive:
        substeps = json.loads(archive.read("resources/MANIFEST.json"))["steps"]["step"]["substeps"]
    package = folder / "package"
    export_c(scene, package, real="double", what=["dynamics", "step"], step=one.step, substeps=substeps)
    module, library = shared_library(package, folder)
    far = 0.0
    for unit in units.values():
        fmu = opened(unit)
        x = module.State(*fmu.get("state."))
        given = [module.Input(*fmu.get("input."))]
        given += [module.Forces(*fmu.get("forces."))] if fmu.names("forces.") else []
        for k in range(STEPS):
            fmu.step(k * unit.step, unit.step)
            x = library.step(x, *given, unit.step)
            far = max(far, float(np.abs(fmu.get("state.") - [getattr(x, name) for name, _ in x._fields_]).max()))
    return "C package", far, 0.0


def loop(scene: ControlScene, units: dict[tuple[str, str], FunctionalMockupUnit]) -> tuple[str, float, float]:
    """What commands are compared with, their largest difference per the largest of them, and what it may be."""
    period, horizon = scene.controller.step, scene.controller.horizon
    scene = scene.replaced(plant=scene.plant.replaced(noise=0.0), duration=STEPS * period)
    run = cg.run_closed_loop(scene)
    rows = setpoints(Outputs.of(scene.controller.cost, Prediction(scene)), scene.reference).rows
    model, h = PlantModel(scene), units["plant", "2"].step
    ahead, far = horizon.stage * np.arange(horizon.stages + 1), 0.0
    for fmi in ("2", "3"):
        control, plant = opened(units["controller", fmi]), opened(units["plant", fmi])
        for k in range(STEPS):
            t = k * period
            control.set("measurement.", plant.get("measurement."))
            control.set("reference.", rows(t + ahead).T)
            control.step(t, period)
            u = control.get("command.")
            plant.set("command.", u)
            for n in range(round(period / h)):  # loads of the scene, which change meanwhile
                if plant.names("forces."):
                    plant.set("forces.", model.forces(t + (n + 0.5) * h)[0])
                plant.step(t + n * h, h)
            far = max(far, float(np.abs(u - run.u[k]).max() / np.abs(run.u).max()))
    return "closed loop", far, ROUNDING if model.steady else HELD


def row(config: Path, folder: Path) -> list[Any]:
    """What was found of a configuration."""
    began = time.monotonic()
    scene = load(config)
    kinds = ["plant"] if isinstance(scene, Scene) else ["plant", "controller"]
    units, refused = {}, []
    for kind in kinds:
        try:
            made = export_fmu(scene, folder, what=[kind], name=config.stem, preview=kind == "controller")
            units |= {(kind, unit.fmi): unit for unit in made}
        except ContinuumGraspError as error:
            refused.append(f"{kind} refused: {error}")
    if refused:
        for unit in units.values():
            opened(unit)
        beside, far, verdict = "", None, "; ".join(refused)
    else:
        beside, far, most = finger(scene, units, folder) if isinstance(scene, Scene) else loop(scene, units)
        verdict = "equal" if far == 0.0 else f"equal within {most:g}" if far <= most else "**differs**"
    size = sum(unit.file.stat().st_size for unit in units.values()) / 1000.0
    name = f"{config.parent.name}/{config.stem}"
    return [name, len(units), size, beside, far, verdict, time.monotonic() - began]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", metavar="NAME", help="configurations, such as mpc/steady_tip")
    asked = parser.parse_args()
    shipped = [path for kind in ("simulate", "mpc") for path in sorted((ROOT / "configs" / kind).glob("*.yaml"))]
    report, rows, earlier = Report("fmu", 0), list[list[Any]](), dict[str, list[Any]]()
    if asked.only and RECORD.exists():
        earlier = {row[0]: row for row in json.loads(RECORD.read_text())["tables"][0]["rows"]}
    for config in shipped:
        if asked.only and (name := f"{config.parent.name}/{config.stem}") not in asked.only:
            if name in earlier:
                rows.append(earlier[name])
            else:
                report.missing.append(name)
            continue
        with tempfile.TemporaryDirectory() as folder:
            try:
                rows.append(row(config, Path(folder)))
            except Exception as error:
                name = f"{config.parent.name}/{config.stem}"
                rows.append([name, 0, 0.0, "", None, f"**failed**: {type(error).__name__}: {error}", 0.0])
        print(*rows[-1], sep=" | ", flush=True)
    report.claim("configurations whose units are neither equal nor refused", sum("**" in r[5] for r in rows), "<=", 0)
    columns = ["configuration", "units", "kB", "beside", "largest difference", "verdict", "s"]
    note = f"{STEPS} steps of a finger, differences of states; {STEPS} periods of a loop, of commands per the largest."
    report.table("Functional mock-up units of the shipped configurations", columns, rows, note)
    report.finish()


if __name__ == "__main__":
    main()
