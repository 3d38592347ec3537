"""The functions of a finger as files of CasADi."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

import casadi as ca

from continuum_grasp import __version__
from continuum_grasp.base import CheckedArgument, check_arguments, interruptible
from continuum_grasp.core import CReal
from continuum_grasp.export.manifest import Package, model_description, write_package
from continuum_grasp.export.source import Given, source_of
from continuum_grasp.model import FingerModel
from continuum_grasp.results import check_folder


@interruptible()
@check_arguments
def export_casadi(given: Given, folder: str | os.PathLike[str], *, what: Sequence[str] | None = None) -> Package:
    """Write the functions of a finger as files of CasADi, for programs that have CasADi and not this package.

    ``casadi.Function.load("tip.casadi")`` in Python, ``casadi::Function::load`` in C++ and ``casadi.Function.load`` in
    MATLAB return the function, which can be evaluated, differentiated, and used in an NLP. For a closed loop or a
    mission the finger is as in the controller's prediction; surroundings and objects are no part of it.

    Parameters
    ----------
    given : FingerModel, Scene, ControlScene, AssignedMission, MissionRun, Controller, Estimator or path
        The object to export, or the path of its configuration.
    folder : path-like
        Target folder. An earlier export there is replaced; other files, and changed ones, are not.
    what : sequence of str, optional
        Names of functions of `FingerModel`, such as forward_dynamics and tip; all by default.

    Returns
    -------
    Package
        One file per function; the manifest has inputs and outputs of each, names and units of their entries, nominal
        parameters, and the version of CasADi, which reads files of its own version and of older ones.

    Raises
    ------
    InputError
        If a function is not known, or the folder holds other files of the same names.
    SolverError
        If no model keeps the scene's tolerance.

    Examples
    --------
    >>> import tempfile
    >>> import casadi as ca
    >>> import continuum_grasp as cg
    >>> files = cg.export_casadi("configs/simulate/hanging.yaml", tempfile.mkdtemp(), what=["tip"])
    >>> files.files
    ('MANIFEST.json', 'tip.casadi')
    >>> ca.Function.load(str(files.folder / "tip.casadi")).name_out()
    ['r']
    """
    check_folder(folder, "export")
    names = functions_of(what)
    source = source_of(given, CReal.KINDS["double"])
    model = source.finger
    functions = {name: getattr(model, name) for name in names}
    files = {f"{name}.casadi": _stored(function) for name, function in functions.items()}
    digests = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in sorted(files.items())}
    described = {}
    for name, function in functions.items():
        inputs = {key: list(function.size_in(key)) for key in function.name_in()}
        described[name] = {
            "inputs": inputs,
            "outputs": {key: list(function.size_out(key)) for key in function.name_out()},
        }
    values = {
        "name": source.name,
        "versions": {"continuum_grasp": __version__, "casadi": str(ca.CasadiMeta.version())},
        "configuration_hash": hashlib.sha256("".join(digests.values()).encode()).hexdigest()[:16],
        "model": model_description(model),
        "functions": described,
        "entries": {vector: getattr(model, f"{vector}_names") for vector in "qxuwp"},
        "nominal_parameters": dict(zip(model.p_names, map(float, model.p_nominal), strict=True)),
        "configuration": source.configuration,
        "sha256": digests,
    }
    return write_package(Path(folder), files, values)


def functions_of(what: Sequence[str] | None = None) -> list[str]:
    """Functions of a model by their names, all where none is named; InputError for a name of none."""
    known = FingerModel.function_names()
    return list(known) if what is None else CheckedArgument("what", what).some_of(known, "function")


def _stored(function: ca.Function) -> str:
    """A function as CasADi stores it in a file: letters alone. OSError where the disk is full."""
    with tempfile.TemporaryDirectory() as work:
        file = Path(work) / "function.casadi"
        function.save(str(file))
        return file.read_text(encoding="ascii")
