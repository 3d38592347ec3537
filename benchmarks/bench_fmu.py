"""Functional mock-up units of every shipped finger and closed loop: validated, simulated, compared.

Run ``python -m benchmarks.bench_fmu`` in the root of the repository (10 min), with the extras fmu and test; ``--only``
takes some. A finger takes 100 steps by its FMUs and by the C package,
which is compiled and called apart from them. Of a closed loop plant and controller take 100 periods together, with the
plant's noise set to 0, beside ``run_closed_loop``. All is compiled quickly: what the strict C computes does not depend
on that.

``--tools`` takes units to tools that share nothing with fmpy instead (3 min): Ecos and libcosim, which are C++ (``pip
install ecospy libcosimpy``; Ecos needs oneTBB, Debian: ``libtbb12``). Each tool steps the finger of
``configs/simulate/tendon_step.yaml``, and plant and controller of ``configs/mpc/steady_tip.yaml``, connected by equal
names. Both tools step all units at once and exchange values afterwards, which delays a command by a period; the plant
is therefore exported without the 10 ms by which its sensors are late. Beside them: the same exchange by fmpy.
"""

from __future__ import annotations

import os

os.environ.setdefault("CONTINUUM_GRASP_QUICK_COMPILE", "1")

import json
import tempfile
import time
import zipfile
from collections.abc import Callable
from importlib import metadata
from itertools import product
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.validation import validate_fmu

import continuum_grasp as cg
from benchmarks.harness import CONFIGS
from benchmarks.report import Report, begun
from continuum_grasp.addons.fmu import FunctionalMockupUnit
from continuum_grasp.addons.fmu.write import export_fmu
from continuum_grasp.base import ContinuumGraspError
from continuum_grasp.closed_loop import PlantModel
from continuum_grasp.control import Outputs, Prediction, Setpoints
from continuum_grasp.export import export_c
from continuum_grasp.scene import ControlScene, Scene, load
from tests.export_cases import shared_library
from tests.fmu_cases import Instance

STEPS = 100
"""Internal steps of a finger, periods of a closed loop."""
ROUNDING = 1e-6
"""Largest difference of a loop's commands, per the largest of them, that rounding explains."""
HELD = 1e-3
"""The same where loads vary within a step, over which an FMU holds them at what they are in its middle."""


PULL = {"input.tension_1": 12.0}
"""Inputs of the finger alone [N]."""
Unit = FunctionalMockupUnit


def opened(unit: Unit) -> Instance:
    """An instance of a unit in which validation finds nothing."""
    if problems := validate_fmu(str(unit.file)):
        raise RuntimeError(f"{unit.file.name}: {problems}")
    if not unit.file.with_suffix("").exists():  # a library that is loaded must not be written again
        fmpy.extract(str(unit.file), str(unit.file.with_suffix("")))
    return Instance(unit)


def finger(scene: Scene, units: dict[tuple[str, str], Unit], folder: Path) -> tuple[str, float, float]:
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


def loop(scene: ControlScene, units: dict[tuple[str, str], Unit]) -> tuple[str, float, float]:
    """What commands are compared with, their largest difference per the largest of them, and what it may be."""
    period, horizon = scene.controller.step, scene.controller.horizon
    scene = scene.replaced(plant=scene.plant.replaced(noise=0.0), duration=STEPS * period)
    run = cg.run_closed_loop(scene)
    rows = Setpoints.of(Outputs.of(scene.controller.cost, Prediction(scene)), scene.reference).rows
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
    return [len(units), size, beside, far, verdict, time.monotonic() - began]


def links(units: list[Unit]) -> list[tuple[int, int, str]]:
    """From which unit to which, and under which name, a value is handed over between a plant and its controller."""
    if len(units) == 1:
        return []
    names = [(0, 1, name) for name in units[0].outputs if name.startswith("measurement.")]
    return names + [(1, 0, name) for name in units[0].inputs if name.startswith("command.")]


def by_fmpy(units: list[Unit]) -> list[list[float]]:
    """Tips after each step; inputs are handed over at the start, and after each step of all units."""
    ones = [opened(unit) for unit in units]
    tips, h = [], max(unit.step for unit in units)
    for name, value in PULL.items() if len(ones) == 1 else ():
        ones[0].set(name, [value])

    def exchange() -> None:
        if len(ones) > 1:
            measured, command = ones[0].get("measurement."), ones[1].get("command.")
            ones[1].set("measurement.", measured)
            ones[0].set("command.", command)

    exchange()
    for k in range(STEPS):
        for one in ones:
            one.step(k * h, h)
        tips.append(ones[0].get("tip.")[:2].tolist())
        exchange()
    return tips


def by_ecos(units: list[Unit]) -> list[list[float]]:
    """The same by Ecos."""
    from ecospy import EcosSimulation, EcosSimulationStructure

    structure = EcosSimulationStructure()
    for unit in units:
        structure.add_model(unit.what, unit.file)
    for source, sink, name in links(units):
        structure.make_real_connection(f"{units[source].what}::{name}", f"{units[sink].what}::{name}")
    if len(units) == 1:
        structure.add_parameter_set("start", {f"plant::{name}": value for name, value in PULL.items()})
    tips = []
    with EcosSimulation(max(unit.step for unit in units), structure=structure) as simulation:
        simulation.init(parameter_set="start" if len(units) == 1 else None)
        for _ in range(STEPS):
            simulation.step()
            tips.append([simulation.get_real(f"plant::tip.{name}") for name in "xy"])
    return tips


def by_libcosim(units: list[Unit]) -> list[list[float]]:
    """The same by libcosim."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.WARNING)
    execution = CosimExecution.from_step_size(round(1e9 * max(unit.step for unit in units)))
    at = [execution.add_local_slave(CosimLocalSlave(str(unit.file), unit.what)) for unit in units]
    numbers = [{v.name.decode(): v.reference for v in execution.slave_variables(k)} for k in at]
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    for name, value in PULL.items() if len(units) == 1 else ():
        execution.real_initial_value(at[0], numbers[0][name], value)
    for source, sink, name in links(units):
        execution.connect_real_variables(at[source], numbers[source][name], at[sink], numbers[sink][name])
    tips = []
    for _ in range(STEPS):
        if not execution.step():
            raise RuntimeError("libcosim refuses to step")
        tips.append(observer.last_real_values(at[0], [numbers[0][f"tip.{name}"] for name in "xy"]))
    return tips


TOOLS: dict[str, tuple[str, tuple[str, ...], Callable[[list[Unit]], Any]]] = {
    "Ecos": ("ecospy", ("2", "3"), by_ecos),
    "libcosim": ("libcosimpy", ("2",), by_libcosim),
}
"""By name: package, versions of the standard that it reads, and how it steps."""


def try_tools(report: Report) -> None:
    """Step units by every tool."""
    columns = ["tool", "FMI", "units", "tip, largest difference from fmpy [m]", "end, from run_closed_loop [mm]"]
    note = f"{STEPS} steps of 1 ms of a finger, {STEPS} periods of 10 ms of a loop; fmpy {metadata.version('fmpy')}."
    table = report.table("Functional mock-up units in other tools", columns, note=note)
    with tempfile.TemporaryDirectory() as folder:
        loop = load(CONFIGS / "mpc/steady_tip.yaml")
        prompt = loop.replaced(plant=loop.plant.replaced(delay=0.0))
        fingers = export_fmu(CONFIGS / "simulate/tendon_step.yaml", folder)
        plants = export_fmu(prompt, folder, what=["plant"], name="steady_tip")
        controllers = export_fmu(loop, folder, what=["controller"], name="steady_tip")
        groups = {"finger": fingers, "plant and controller": [*plants, *controllers]}
        silent = loop.replaced(plant=loop.plant.replaced(noise=0.0), duration=STEPS * loop.controller.step)
        end = cg.run_closed_loop(silent).tip[-1]
        for tool, (package, versions, steps) in TOOLS.items():
            try:
                name = f"{tool} ({package} {metadata.version(package)})"
            except metadata.PackageNotFoundError:
                report.missing.append(f"{tool}: {package} is not installed")
                continue
            for fmi, (what, made) in product(versions, groups.items()):
                units = [unit for unit in made if unit.fmi == fmi]
                expected, found = np.array(by_fmpy(units)), np.array(steps(units))
                far = float(np.abs(found - expected).max())
                away = 1e3 * float(np.linalg.norm(found[-1] - end)) if len(units) > 1 else None
                table.add(name, f"{fmi}.0", what, far, away)
                report.claim(f"{tool}, FMI {fmi}.0, {what}: difference from fmpy [m]", far, "<=", 0.0)


def try_shipped(report: Report, only: list[str]) -> None:
    """Compare the units of the shipped configurations, or of some."""
    columns = ["configuration", "units", "kB", "beside", "largest difference", "verdict", "s"]
    note = f"{STEPS} steps of a finger, differences of states; {STEPS} periods of a loop, of commands per the largest."
    table = report.table("Functional mock-up units of the shipped configurations", columns, note=note)
    for config in [path for kind in ("simulate", "mpc") for path in sorted((CONFIGS / kind).glob("*.yaml"))]:
        name = f"{config.parent.name}/{config.stem}"
        if only and name not in only:
            report.missing.append(name)
            continue
        with tempfile.TemporaryDirectory() as folder:
            try:
                table.add(name, *row(config, Path(folder)))
            except Exception as error:
                table.add(name, 0, 0.0, "", None, f"**failed**: {type(error).__name__}: {error}", 0.0)
    wrong = sum("**" in row[5] for row in table.rows)
    report.claim("configurations whose units are neither equal nor refused", wrong, "<=", 0)


def main() -> None:
    some, tools = ([str], "configurations, such as mpc/steady_tip"), (False, "other tools instead")
    asked, report = begun(__doc__, lambda asked: "fmu_tools" if asked.tools else "fmu", only=some, tools=tools)
    if asked.tools:
        try_tools(report)
    else:
        try_shipped(report, asked.only)
    report.finish()


if __name__ == "__main__":
    main()
