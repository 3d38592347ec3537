"""Verbs of measurements and logs: ``compare``, ``identify``, ``commission``, ``replay``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import NormalDist
from typing import TYPE_CHECKING, Annotated

import typer

from continuum_grasp.base import InputError
from continuum_grasp.cli import Output, option, run_verb

if TYPE_CHECKING:
    from continuum_grasp.addons.identification.comparison import Predicted
    from continuum_grasp.addons.identification.experiment_plan import ExperimentPlan
    from continuum_grasp.addons.identification.fit import Fit
    from continuum_grasp.scene import FingerScene, Scene


@run_verb()
def compare(
    output: Output,
    data: Annotated[
        list[Path] | None,
        typer.Argument(metavar="DATA", help="Tables of measurements, or folders. Default: the tables in CONFIG."),
    ] = None,
) -> None:
    """Compare a simulation with measurements. Nothing is estimated."""
    from continuum_grasp.scene import Scene

    compared(output.scene(Scene), data, output)


def compared(scene: Scene, data: list[Path] | None, output: Output) -> None:
    """Compare a scene with measurements, and save that."""
    from continuum_grasp.addons.identification.data_files import located
    from continuum_grasp.addons.identification.fitting import compare as run

    paths = list(data or located(scene, output.config.parent))
    prediction, files = output.run("comparing", lambda report: run(scene, paths, progress=report))
    show_channels(prediction, output)
    output.warn(prediction.warnings)
    output.conclude(prediction, files, **prediction.details())


def show_channels(predicted: Predicted, output: Output) -> None:
    """Print the errors of each channel."""
    from continuum_grasp.addons.identification.comparison import HEADINGS

    output.table(HEADINGS, *(channel.texts for channel in predicted.channels))


_SHOWN = 12
"""Values of single sets that are printed [1]: the coordinates of many starts say little."""


@run_verb()
def identify(
    output: Output,
    data: list[Path] | None = option(
        "Table of measurements, or a folder; repeatable. Default: the tables in CONFIG; with --design no table.",
        metavar="FILE",
    ),
    design: bool = option("Propose loads, poses and motions to measure next, in addition to --data.", default=False),
    apply: list[Path] | None = option(
        "Write this configuration with the estimates in it, beside the result; repeatable.", metavar="CONFIG"
    ),
    accept_implausible: bool = option("Write the finger although its data are implausible.", default=False),
) -> None:
    """Estimate parameters from measurements, with intervals. What to measure next is proposed by --design.

    Exit status 1 where this finger cannot have the data, or no experiment shows one of the unknowns.
    """
    from continuum_grasp.addons.identification.scene import IdentifyScene

    scene = output.scene(IdentifyScene)
    if design and apply:
        raise InputError("has no effect on --design", key="--apply")
    if not design and not scene.estimate:
        compared(scene, data, replace(output, verb="compare"))
        return
    targets = _targets(apply or ())
    if design:
        from continuum_grasp.addons.identification.experiments import design_experiments

        measured = tuple(data or ())
        plan = show_plan(
            lambda report: design_experiments(scene, measured, progress=report), replace(output, verb="experiments")
        )
        if plan.status != "designed":
            output.fail()
        return

    from continuum_grasp.addons.identification.data_files import located
    from continuum_grasp.addons.identification.fitting import identify as run

    paths = data or located(scene, output.config.parent)
    fit, files = output.run(
        "identifying", lambda report: run(scene, paths, accept_implausible=accept_implausible, progress=report)
    )
    files += [_written(fit, target, output, path) for path, target in targets if fit.usable]
    show_parameters(fit, files, output)
    if fit.reason:
        output.warn([fit.verdict])
        output.fail()


def _targets(paths: Sequence[Path]) -> list[tuple[Path, FingerScene]]:
    """Configurations into which estimates go."""
    from continuum_grasp.scene import FingerScene, load

    targets: list[tuple[Path, FingerScene]] = []
    for path in paths:
        target = load(path)
        if not isinstance(target, FingerScene):
            raise InputError("estimates can be written only into scenes with one finger", file=str(path))
        targets.append((path, target))
    return targets


def show_parameters(fit: Fit, files: Sequence[Path], output: Output) -> None:
    """Print estimates with their intervals, also of single sets, and the errors of each channel."""
    output.warn(fit.warnings)
    if fit.laws:
        rows = (
            (law.name, str(law.numbers), f"{law.fitted:.3g}", f"{law.held_out:.3g}", law.verdict) for law in fit.laws
        )
        output.table(("law", "numbers", "fitted [deviations]", "held out [deviations]", ""), *rows, left=(4,))
    columns = fit.names, fit.values, fit.deviations, fit.intervals, fit.units
    parameters = (
        (name, f"{value:.6g}", f"{deviation:.2g}", f"{low:.6g} to {high:.6g}", unit)
        for name, value, deviation, (low, high), unit in zip(*columns, strict=True)
    )
    output.table(("parameter", "value", "deviation", "95 % interval", "unit"), *parameters)
    of_sets = zip(fit.set_names, fit.set_values, fit.set_deviations, strict=True)
    shown = [(name, f"{value:.6g}", f"{deviation:.2g}") for name, value, deviation in of_sets][:_SHOWN]
    if shown:
        more = len(fit.set_names) - len(shown)
        output.table(("of one set" + (f" ({more} more in the result)" if more else ""), "value", "deviation"), *shown)
    output.say("")
    show_channels(fit, output)
    singular = " ".join(f"{value:.3g}" for value in fit.singular_values)
    output.conclude(fit, files, more={"singular values": singular}, **fit.summary())


def _written(fit: Fit, scene: FingerScene, output: Output, config: Path) -> Path:
    """The file of a scene with the estimates in it, named after its configuration."""
    plain = fit.apply(scene).model_dump(mode="json", exclude_unset=True)
    text = fit.as_yaml({"schema_version": 1, **plain}, exact=True)
    return output.write(text, f"{config.stem}_identified.yaml")


def show_plan(design: Callable[[Callable[[float], None]], ExperimentPlan], output: Output) -> ExperimentPlan:
    """Design experiments that show unknowns, save and print them."""
    plan, files = output.run("designing", design)
    output.warn(plan.warnings)
    if plan.pose_rows:
        output.table(
            ("measure", *plan.pose_headings), *((f"pose {k}", *row) for k, row in enumerate(plan.pose_rows, 1))
        )
        output.say("")
    if plan.segments:
        segments = ((each.name, f"{each.start:.3g} s", f"{each.end:.3g} s", each.shows) for each in plan.segments)
        output.table(("segment", "from", "to", "shows"), *segments, left=(3,))
        output.say("")
    columns = plan.names, plan.values, plan.before, plan.deviations, plan.units, plan.shown_by
    half = NormalDist().inv_cdf(0.975)  # of a 95 % interval, per standard deviation
    rows = []
    for name, value, *deviations, unit, shown in zip(*columns, strict=True):
        intervals = [f"+/- {half * deviation:.2g}" for deviation in deviations]
        rows.append((name, f"{value:.4g}", *intervals, unit, shown))
    output.table(("unknown", "assumed", "95 % now", "95 % then", "unit", "shown best by"), *rows, left=(5,))
    output.conclude(plan, files, **plan.details())
    return plan


@run_verb()
def commission(
    output: Output,
    log: Annotated[
        Path | None,
        typer.Argument(metavar="LOG", help="Table or bag of commands and readings. Without it, plan the commands."),
    ] = None,
    plant: bool = option("Play the plan on the configuration's simulated plant, and read its log.", default=False),
    duration: float = option("Duration of the plan [s].", default=10.0),
    reach: float = option("Share of bending range and tensions to use.", default=0.6),
) -> None:
    """Find how a bench is mounted and connected.

    Camera, order, signs and zeros of drives and load cells, lag and delay.

    Without LOG it writes the commands that a bench plays; with one, the corrected configuration. Exit status 1 where
    the log does not tell all.
    """
    from continuum_grasp.scene import ControlScene

    scene = output.scene(ControlScene)
    if plant and log is not None:
        raise InputError("--plant simulates the log itself: give either LOG or --plant")

    from continuum_grasp.addons.identification.commissioning.log import commission as run
    from continuum_grasp.addons.identification.commissioning.plan import design_commissioning

    if log is None and not plant:
        design = replace(output, verb="experiments")
        show_plan(lambda _: design_commissioning(scene, duration=duration, reach=reach), design)
        return
    commissioning, files = output.run(
        "commissioning", lambda report: run(scene, log, duration=duration, reach=reach, progress=report)
    )
    ways = {f"way {k}": alternative.what for k, alternative in enumerate(commissioning.alternatives, 1)}
    output.pairs({"status": commissioning.status, **ways})
    show_parameters(commissioning, files, output)
    output.warn(commissioning.undetermined)
    if not commissioning.usable:
        output.fail()


@run_verb()
def replay(
    output: Output,
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Table or bag of instants, measurements and commands.")],
) -> None:
    """Run a log through estimator, supervisor and controller.

    Names the sensor that disagrees, and noise, delay and lag of the log. Exit status 1 if sensors and model disagree.
    """
    from continuum_grasp.scene import ControlScene

    scene = output.scene(ControlScene)

    from continuum_grasp.addons.identification.replayed import replay as run

    prediction, files = output.run("replaying", lambda report: run(scene, log, progress=report))
    show_channels(prediction, output)
    output.say("")
    output.report(prediction, files, **prediction.details())
    if prediction.status != "consistent":
        output.fail()
