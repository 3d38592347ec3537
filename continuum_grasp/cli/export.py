"""``continuum-grasp export``."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from continuum_grasp.base import ExportTarget, InputError, addons, named_value
from continuum_grasp.cli.options import option, resolved_scene, verb
from continuum_grasp.cli.output import Output, out_option

if TYPE_CHECKING:
    from continuum_grasp.export import Package

_CORE = {"c": "continuum_grasp.cli.export:PackageTarget", "casadi": "continuum_grasp.cli.export:FunctionsTarget"}


def _targets() -> dict[str, str]:
    """Subclasses of `ExportTarget` of the core and of add-ons, by the word of ``--to``."""
    found = dict(_CORE)
    for name, addon in addons().items():
        if again := found.keys() & addon.exports.keys():
            raise InputError(f"add-on {name!r}: the export {min(again)!r} already exists")
        found |= addon.exports
    return found


_OUT = out_option("Target (default: runs/export/TO/NAME-OF-CONFIG); an earlier export is replaced.", "DIR|FILE")


@verb("config", "out", "changes", "as_json", "quiet", out=_OUT)
def export(
    output: Output,
    to: str = option(
        "C package, FMUs, page for a browser, chain for MuJoCo, functions of CasADi.",
        default=...,
        words=tuple(_targets()),
    ),
    what: str | None = option(
        "c: some of dynamics, step, implicit_step, kinematics, statics, linearization, shape, velocities, contact; "
        "of a closed loop also estimator and mpc, of a mission mpc and mission (default: of loops and "
        "missions those two, else dynamics, step, kinematics and statics). fmu: plant, controller or both of a closed "
        "loop (default: both). casadi: functions of FingerModel (default: all).",
        metavar="PART,...",
    ),
    ranges: list[str] | None = option(
        "c, fmu: range of a run-time parameter; repeatable.", "--range", metavar="NAME=MIN:MAX"
    ),
    step: float | None = option("c, fmu: longest or internal step (default: the scene's).", metavar="SECONDS"),
    substeps: int | None = option("c, fmu: Runge-Kutta steps per step (default: enough for stability).", metavar="N"),
    real: str | None = option("c: number type (default: the target's).", metavar="float|double"),
    prefix: str | None = option("c: prefix of all names (default: finger).", metavar="NAME"),
    target: str | None = option("c: host (default), cortex-m4f, cortex-m7 or wasm.", metavar="NAME"),
    sections: int | None = option("c: sections in one call of shape, velocities (default: 25).", metavar="N"),
    error: float | None = option("c: greatest relative error within the ranges.", metavar="NUMBER"),
    measured: bool | None = option("c: run on the emulated target; note sizes and counts.", "--measure"),
    clock: str | None = option(
        "c: with --measure, such as 168MHz: print calls as shares of the period; status 1 if a call is longer.",
        metavar="FREQUENCY",
    ),
    finger: str | None = option("c, fmu: finger to export, of a mission with several.", metavar="NAME"),
    fmi: str | None = option("fmu: version of the standard (default: both).", words=("2", "3", "both")),
    name: str | None = option("fmu: name of files and symbols (default: the name of CONFIG).", metavar="NAME"),
    preview: bool | None = option("fmu: setpoints of every stage of the controller's horizon.", "--preview"),
    binary: bool | None = option("fmu: with this machine's binary (default) or without.", "--binary/--no-binary"),
    hinges: int | None = option("mjcf: hinges per finger (default: 40; in a hand 24).", metavar="N"),
) -> None:
    """Write a finger, loop, mission or hand for use elsewhere.

    C99 for microcontrollers and hosts (c), functional mock-up units for Simulink, Dymola and others (fmu), a page in
    which finger and controller run as WebAssembly (web), chains of hinges for MuJoCo (mjcf), functions as
    CasADi loads them (casadi). An option says which of these it is for.
    """
    given = {
        key: value for key, value in locals().items() if key not in ("output", "to", "clock") and value is not None
    }
    _export(output, to, given, clock)


def _export(output: Output, to: str, options: dict[str, Any], clock: str | None) -> None:
    """Export by the function of ``to`` with the options that were given, and print what it wrote."""
    from continuum_grasp.results import hold_folder
    from continuum_grasp.scene import kinds

    target: ExportTarget = named_value(_targets()[to])()
    for key in options.keys() - inspect.signature(target.write).parameters.keys():
        raise InputError(f"has no effect on --to {to}", key=f"--{_SPELLED.get(key, key)}")
    rates = [] if clock is None else [_frequency(clock, "measured" in options)]
    options = {key: _READ[key](value) if key in _READ else value for key, value in options.items()}
    output = replace(output, out=output.out or Path("runs/export") / to / f"{output.config.stem}{target.suffix}")
    loops = [kind.scene_class for kind in kinds().values() if kind.name == "mpc" or kind.loop]
    scene = _exported(output, target, loops)
    if rates and not isinstance(scene, tuple(loops)):
        raise InputError("needs the period of a closed loop or mission", key="--clock")
    options = {**target.defaults(output.config, scene), **options}
    target.check(scene, output.folder, **options)
    hold_folder(output.folder)
    if kind := next((kind for kind in kinds().values() if kind.prepare and isinstance(scene, kind.scene_class)), None):
        with output.busy(kind.preparing):
            scene = named_value(kind.prepare)(scene, options.get("finger"))
        output.pairs(scene.pairs())
    with output.busy("writing") as report:
        # What takes long reports how far it is.
        more = {"progress": report} if "progress" in inspect.signature(target.write).parameters else {}
        written = target.write(scene, output.out, **options, **more)
    target.report(written, output, *rates)


def _exported(output: Output, target: ExportTarget, loops: Sequence[type]) -> Any:
    """The scene that is exported, or the folder of a hand's grasp."""
    from continuum_grasp.scene import HandScene

    if target.takes_hands and output.config.is_dir():
        if output.changes:
            raise InputError("has no effect on a stored grasp", key="--set")
        return output.config
    others = (*(loops if target.takes_loops else ()), *([HandScene] if target.takes_hands else ()))
    return resolved_scene(output, *others)


def _ranges(words: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Ranges as NAME=MIN:MAX."""
    ranges = {}
    for word in words:
        name, _, pair = word.partition("=")
        try:
            least, greatest = (float(part) for part in pair.split(":"))
        except ValueError:
            raise InputError(f"--range: expected NAME=MIN:MAX, got {word!r:.60}") from None
        if name in ranges:
            raise InputError(f"--range: {name} is given twice")
        ranges[name] = (least, greatest)
    return ranges


_READ: dict[str, Callable[[Any], Any]] = {
    "what": lambda text: [part.strip() for part in text.split(",")],
    "ranges": _ranges,
    "fmi": lambda text: ["2", "3"] if text == "both" else [text],
}
"""Arguments of options that are given as text."""
_SPELLED = {"measured": "measure", "ranges": "range"}
"""Options whose name differs from the argument in Python."""


def _frequency(text: str, measured: bool) -> float:
    """Cycles of a clock per second [Hz]."""
    from continuum_grasp.scene import to_si

    value = to_si(text, "Hz")
    if value is None or value <= 0.0:
        raise InputError(f"expected a frequency with its unit such as 168MHz, got {text!r:.60}", key="--clock")
    if not measured:
        raise InputError("needs --measure, which counts the instructions", key="--clock")
    return value


def calls_per_period(made: Mapping[str, Any], clock: float) -> dict[str, tuple[float, float]]:
    """Mean and greatest time of a call of each function that was measured, as shares of the period [1].

    At one instruction per cycle of the ``clock`` [Hz], which neither waits for memory nor takes long divisions.
    """
    cycles = clock * made["loop"]["period_s"]
    counts = made["measured"]["functions"]
    return {
        name: (count["mean_instructions"] / cycles, count["most_instructions"] / cycles)
        for name, count in counts.items()
    }


def _limits(made: Mapping[str, Any]) -> dict[str, str]:
    """Longest step, where the package steps; memory of estimator and controller."""
    limits = {}
    if "step" in made["functions"]:
        limits["longest step [s]"] = f"{made['stability']['longest_step_s']:g}"
    memory = {k: v for f in made["functions"].values() for k, v in f.get("memory_bytes", {}).items()}
    if memory:
        limits["memory [bytes]"] = ", ".join(f"{name} {size}" for name, size in memory.items())
    return limits


class PackageTarget(ExportTarget):
    """A C package in a folder."""

    @property
    def write(self) -> Callable[..., Any]:
        from continuum_grasp.export import export_c

        return export_c

    def check(self, scene: Any, path: Path, **options: Any) -> None:
        """Refuse options that no package has."""
        from continuum_grasp.export import PackageOptions

        PackageOptions(**options)

    def report(self, written: Package, output: Output, clock: float | None = None) -> None:
        """Print where a package is, its limits and errors, and what an emulated target counted.

        End with status 1 where a call does not fit into the period of a ``clock`` [Hz].
        """
        made = written.manifest
        errors = [f["relative_error"] for f in made["functions"].values() if "relative_error" in f]
        output.pairs(
            {
                "package": f"{written.folder} ({len(written.files)} files; start with README.md)",
                "computes in": made["real"],
                "configuration": made["configuration_hash"],
                **_limits(made),
                "test cases": sum(f["test_cases"] for f in made["functions"].values()),
                **({"greatest relative error": f"{max(errors):g}"} if errors else {}),
            }
        )
        for name, usage in ((made["measured"] or {}).get("functions", {})).items():
            output.say(
                f"{name}: {usage['most_instructions']} instructions, {usage['stack_bytes']} bytes of stack at most"
            )
        shares = {} if clock is None else calls_per_period(made, clock)
        for name, (mean, greatest) in shares.items():
            verdict = "fits" if greatest <= 1.0 else "does not fit"
            output.say(f"{name}: {mean:.0%} of the period in the mean, {greatest:.0%} at most: {verdict}")
        if clock is not None:
            output.say(f"at one instruction per cycle of {1e-6 * clock:g} MHz; waits for memory come on top")
        output.result(folder=written.folder, files=written.files, manifest=made, period_shares=shares)
        if any(greatest > 1.0 for _, greatest in shares.values()):
            raise typer.Exit(1)


class FunctionsTarget(ExportTarget):
    """Functions as files of CasADi, in a folder."""

    @property
    def write(self) -> Callable[..., Any]:
        from continuum_grasp.export import export_casadi

        return export_casadi

    def check(self, scene: Any, path: Path, **options: Any) -> None:
        """Refuse functions that a model has not."""
        from continuum_grasp.export import functions_of

        functions_of(**options)

    def report(self, written: Package, output: Output) -> None:
        """Print where the functions are, and how one is loaded."""
        names = list(written.manifest["functions"])
        output.pairs(
            {
                "functions": f"{written.folder} ({len(names)} files; names and units in MANIFEST.json)",
                "to load one": f'casadi.Function.load("{names[0]}.casadi")',
            }
        )
        output.result(folder=written.folder, files=written.files, manifest=written.manifest)
