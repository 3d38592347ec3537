"""Functional mock-up units in tools that share nothing with fmpy: Ecos and libcosim, which are C++.

Run ``python -m benchmarks.fmu_tools`` in the root of the repository (3 min), with the extras fmu and test and
``pip install ecospy libcosimpy``; Ecos needs oneTBB (Debian: ``libtbb12``). Each tool steps the finger of
``configs/simulate/tendon_step.yaml``, and plant and controller of ``configs/mpc/steady_tip.yaml``, connected by equal
names. Both tools step all units at once and exchange values afterwards, which delays a command by a period; the plant
is therefore exported without the 10 ms by which its sensors are late. Beside them: the same exchange by fmpy.
"""

from __future__ import annotations

import os

os.environ.setdefault("CONTINUUM_GRASP_QUICK_COMPILE", "1")

import tempfile
from collections.abc import Callable
from importlib import metadata
from typing import Any

import fmpy
import numpy as np

import continuum_grasp as cg
from benchmarks.report import Report
from continuum_grasp.export import FunctionalMockupUnit, export_fmu
from continuum_grasp.scene.load import load
from tests.fmu_cases import Instance
from tests.rods import ROOT

STEPS = 100
PULL = {"input.tension_1": 12.0}
"""Inputs of the finger alone [N]."""
Unit = FunctionalMockupUnit


def shared(plant: Unit, control: Unit) -> tuple[list[str], list[str]]:
    """Names of measurements and of commands, which both units have."""
    measured = [name for name in plant.outputs if name.startswith("measurement.")]
    return measured, [name for name in plant.inputs if name.startswith("command.")]


def by_fmpy(units: list[Unit]) -> list[list[float]]:
    """Tips after each step; inputs are handed over at the start, and after each step of all units."""
    ones = []
    for unit in units:
        if not unit.file.with_suffix("").exists():  # a library that is loaded must not be written again
            fmpy.extract(str(unit.file), str(unit.file.with_suffix("")))
        ones.append(Instance(unit))
    tips, h = [], max(unit.step for unit in units)
    if len(ones) == 1:
        for name, value in PULL.items():
            ones[0].set(name, [value])
    else:
        ones[1].set("measurement.", ones[0].get("measurement."))
        ones[0].set("command.", ones[1].get("command."))
    for k in range(STEPS):
        for one in ones:
            one.step(k * h, h)
        tips.append(ones[0].get("tip.")[:2].tolist())
        if len(ones) > 1:
            command = ones[1].get("command.")
            ones[1].set("measurement.", ones[0].get("measurement."))
            ones[0].set("command.", command)
    return tips


def by_ecos(units: list[Unit]) -> list[list[float]]:
    """The same by Ecos."""
    from ecospy import EcosSimulation, EcosSimulationStructure

    structure = EcosSimulationStructure()
    for unit in units:
        structure.add_model(unit.what, unit.file)
    if len(units) == 1:
        structure.add_parameter_set("start", {f"plant::{name}": value for name, value in PULL.items()})
    else:
        measured, commands = shared(*units)
        for name in measured:
            structure.make_real_connection(f"plant::{name}", f"controller::{name}")
        for name in commands:
            structure.make_real_connection(f"controller::{name}", f"plant::{name}")
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
    if len(units) == 1:
        for name, value in PULL.items():
            execution.real_initial_value(at[0], numbers[0][name], value)
    else:
        measured, commands = shared(*units)
        for names, source, sink in ((measured, 0, 1), (commands, 1, 0)):
            for name in names:
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


def main() -> None:
    report, rows = Report("fmu_tools", 0), []
    with tempfile.TemporaryDirectory() as folder:
        loop = load(ROOT / "configs/mpc/steady_tip.yaml")
        prompt = loop.replaced(plant=loop.plant.replaced(delay=0.0))
        fingers = export_fmu(ROOT / "configs/simulate/tendon_step.yaml", folder)
        plants = export_fmu(prompt, folder, what=["plant"], name="steady_tip")
        controllers = export_fmu(loop, folder, what=["controller"], name="steady_tip")
        silent = loop.replaced(plant=loop.plant.replaced(noise=0.0), duration=STEPS * loop.controller.step)
        end = cg.run_closed_loop(silent).tip[-1]
        for tool, (package, versions, steps) in TOOLS.items():
            try:
                name = f"{tool} ({package} {metadata.version(package)})"
            except metadata.PackageNotFoundError:
                report.missing.append(f"{tool}: {package} is not installed")
                continue
            for fmi in versions:
                for what, group in (("finger", (fingers,)), ("plant and controller", (plants, controllers))):
                    units = [unit for made in group for unit in made if unit.fmi == fmi]
                    expected, found = np.array(by_fmpy(units)), np.array(steps(units))
                    far = float(np.abs(found - expected).max())
                    away = 1e3 * float(np.linalg.norm(found[-1] - end)) if len(units) > 1 else None
                    rows.append([name, f"{fmi}.0", what, far, away])
                    print(*rows[-1], sep=" | ", flush=True)
                    report.claim(f"{tool}, FMI {fmi}.0, {what}: difference from fmpy [m]", far, "<=", 0.0)
    columns = ["tool", "FMI", "units", "tip, largest difference from fmpy [m]", "end, from run_closed_loop [mm]"]
    note = f"{STEPS} steps of 1 ms of a finger, {STEPS} periods of 10 ms of a loop; fmpy {metadata.version('fmpy')}."
    report.table("Functional mock-up units in other tools", columns, rows, note)
    report.finish()


if __name__ == "__main__":
    main()
