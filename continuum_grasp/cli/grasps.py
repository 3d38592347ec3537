"""``continuum-grasp grasp``."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec

from continuum_grasp.base import InputError, SolverError, addons, named_value
from continuum_grasp.cli.options import option, run_verb
from continuum_grasp.cli.output import Output


def _trials() -> dict[str, str]:
    """Functions of add-ons that try a grasp in another program, by the word of ``--try-in``."""
    return {word: function for addon in addons().values() for word, function in addon.trials.items()}


@run_verb(pictures="Draw a picture and write the HTML report.")
def grasp(
    output: Output,
    seed: int | None = option("Seed for the draws of robust grasps (default: from the configuration).", metavar="N"),
    try_in: str | None = option(
        "Hands only: hold, turn and push the object in another program; status 1 if the object is lost.",
        words=tuple(_trials()),
    ),
    hold_only: bool = option(
        "With --try-in: only hold the object, in the grasp's posture at its tensions; takes seconds.", default=False
    ),
) -> None:
    """Find how fingers hold an object, or why they cannot."""
    from continuum_grasp.scene import GraspScene, HandScene, doubt

    seeding = [] if seed is None else [f"solver.random_seed={seed}"]
    output = replace(output, changes=[*(output.changes or ()), *seeding])
    scene = output.scene(GraspScene, HandScene)
    if try_in is not None and not isinstance(scene, HandScene):
        raise InputError("works only for hands; simulate a planar grasp by a mission", key="--try-in")
    if hold_only and try_in is None:
        raise InputError(f"needs --try-in ({', '.join(_trials())})", key="--hold-only")
    if try_in is not None and find_spec(try_in) is None:
        raise InputError(f"{try_in} is not installed: pip install 'continuum-grasp[{try_in}]'", key="--try-in")

    from continuum_grasp.grasp import optimize_grasp, overlaps_at_rest

    with output.doubting():
        for overlap in overlaps_at_rest(scene):
            doubt(overlap.key, f"is in the way: {overlap}")
    output.check_folder()  # by the files of its results
    with output.busy("searching") as report:
        result = optimize_grasp(scene, raise_on_failure=False, progress=lambda text: report(None, f"searching, {text}"))
    with output.saving():  # the grasp is safe before what can be computed again
        result.save(output.folder, quality=False)
    if try_in is not None and result.solved:
        with output.busy(f"trying in {try_in}") as report:
            shorter = {"hold_only": True} if hold_only else {}
            tried = named_value(_trials()[try_in])(
                result, lambda text: report(None, f"trying in {try_in}, {text}"), **shorter
            )
        result = replace(result, trial=tried)
    with output.drawing():
        result.save(output.folder)
        files = output.drawn(result) if output.pictures else []

    output.say(result.table())  # its first line is the verdict
    output.warn(result.warnings)
    output.conclude(result, files, table=result.table(), reasons=[reason.numbers for reason in result.reasons])
    if not result.solved:
        raise SolverError(result.message, status=result.status.value, result=result)
    if try_in is not None and not result.trial["holds"]:
        output.fail()
