"""Functions of a finger as CasADi generates them, for programs that follow its calling convention."""

from __future__ import annotations

import errno
import hashlib
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import casadi as ca

from continuum_grasp import __version__, interrupt
from continuum_grasp.arguments import check_arguments
from continuum_grasp.core.integrators import step_function
from continuum_grasp.export.destination import check_package
from continuum_grasp.export.fields import REALS
from continuum_grasp.export.kernel import check_size
from continuum_grasp.export.manifest import MANIFEST, manifest_text, model_description, write_package
from continuum_grasp.export.package import Package
from continuum_grasp.export.source import Given, chosen, prefix_of, source_of
from continuum_grasp.model.finger_model import FUNCTIONS

_MOST_INSTRUCTIONS = 60_000
"""Instructions of one function of a controller, without loops: what is compiled once for a plant may take a minute and
1.4 GB."""
STEP = "rk4_step"
"""Name of the Runge-Kutta step, beside those of the model's functions."""


@interrupt.listening()
@check_arguments
def export_casadi(
    given: Given,
    folder: str | os.PathLike[str],
    *,
    functions: Sequence[str] | None = None,
    prefix: str = "finger",
) -> Package:
    """Write functions of a finger as plain CasADi C: a source, its header and a manifest.

    The functions have CasADi's interface, ``int PREFIX_NAME(const double **arg, double **res, casadi_int *iw,
    double *w, int mem)``, and check nothing; ``export_c`` writes a package that does.

    Parameters
    ----------
    given : FingerModel, Scene, ControlScene, Controller, Estimator or path of a configuration
        The finger; of a closed loop the model that its controller predicts with.
    folder : path-like
        Where to. An earlier export there is replaced; files that are none of its own, or were changed, are not.
    functions : sequence of str, optional
        Names of functions of ``FingerModel``, and ``rk4_step``; default: all of them.
    prefix : str
        Of the files and of all names, a C identifier.

    Returns
    -------
    Package
        Files ``PREFIX.c``, ``PREFIX.h`` and ``MANIFEST.json``, which names inputs and outputs with their sizes.

    Raises
    ------
    InputError
        If an argument is wrong, or the folder holds other files of the same names.
    OSError
        If the files cannot be written.
    SolverError
        If no model satisfies the scene's tolerance.

    Examples
    --------
    >>> import tempfile
    >>> from continuum_grasp import FingerModel, Finger, Rod
    >>> from continuum_grasp.export import export_casadi
    >>> rod = Rod(length=0.18, linear_density=0.02, bending_stiffness=0.01)
    >>> model = FingerModel(Finger(rod=rod), elements=2)
    >>> export_casadi(model, tempfile.mkdtemp(), functions=["tip"]).files
    ('MANIFEST.json', 'finger.c', 'finger.h')
    """
    check_package(Path(folder))
    model = source_of(given, REALS["double"]).finger
    known = (*FUNCTIONS, STEP)
    names = chosen(known if functions is None else functions, known, "function", "functions")
    prefix = prefix_of(prefix)
    asked = {name: step_function(model, "rk4") if name == STEP else getattr(model, name) for name in names}
    renamed = {name: _renamed(function, f"{prefix}_{name}") for name, function in asked.items()}
    source, header = generated_c(prefix, renamed.values())
    files = {f"{prefix}.c": source, f"{prefix}.h": header}
    digests = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in files.items()}
    manifest = {
        "name": prefix,
        "versions": {"continuum_grasp": __version__, "casadi": str(ca.CasadiMeta.version())},
        "configuration_hash": digests[f"{prefix}.c"][:16],
        "model": model_description(model),
        "functions": {name: _interface(function) for name, function in renamed.items()},
        "sha256": digests,
    }
    files[MANIFEST] = manifest_text(manifest)
    write_package(Path(folder), files)
    return Package(Path(folder), tuple(sorted(files)), manifest)


def _renamed(function: ca.Function, name: str) -> ca.Function:
    # An SX function stays one: called with MX symbols its C would be a wrapper around another function.
    symbols: Any = function.sx_in() if function.is_a("SXFunction") else function.mx_in()
    return ca.Function(name, symbols, function.call(symbols), function.name_in(), function.name_out())


def _interface(function: ca.Function) -> dict[str, Any]:
    """Names and shapes of inputs and outputs, and the work space that a call needs."""
    return {
        "inputs": {function.name_in(k): list(function.size_in(k)) for k in range(function.n_in())},
        "outputs": {function.name_out(k): list(function.size_out(k)) for k in range(function.n_out())},
        "work": {"arg": function.sz_arg(), "res": function.sz_res(), "iw": function.sz_iw(), "w": function.sz_w()},
    }


def generated_c(prefix: str, functions: Any) -> tuple[str, str]:
    """Source and header; InputError where a function is too large, OSError where the disk is full."""
    options = {"with_header": True, "with_export": False, "static_aux": True, "with_mem": False}
    generator = ca.CodeGenerator(f"{prefix}.c", options)
    for function in functions:
        for part in (function, *function.find_functions()):
            check_size(part.name(), part.n_instructions() if part.is_a("SXFunction") else 0, _MOST_INSTRUCTIONS)
        generator.add(function)
    with tempfile.TemporaryDirectory() as folder:
        generator.generate(f"{folder}/")
        texts = [(Path(folder) / f"{prefix}.{suffix}").read_text() for suffix in ("c", "h")]
    # CasADi writes to files alone, and reports nothing where the disk is full.
    if not all(text.endswith("#endif\n") for text in texts):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), folder)
    return texts[0], texts[1]
