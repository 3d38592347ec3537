"""``continuum-grasp doctor``."""

from __future__ import annotations

import os
import shutil
from typing import Any

import typer

from continuum_grasp.cli.options import verb
from continuum_grasp.cli.output import Output

_PACKAGES = ("casadi", "numpy", "scipy", "matplotlib", "pydantic", "pyyaml", "typer", "rich")


@verb("as_json")
def doctor(output: Output) -> None:
    """Print versions, solvers and compiler. How fast the finger runs here is measured."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    import casadi

    from continuum_grasp import __version__
    from continuum_grasp.core.compiler import find_compiler

    compiler = find_compiler()
    facts = {"continuum_grasp": __version__, "python": platform.python_version(), "platform": platform.platform()}
    for package in _PACKAGES:
        try:
            facts[package] = version(package)
        except PackageNotFoundError:
            facts[package] = "not found"
    facts |= {
        "processors": str(os.cpu_count()),
        "ipopt": "found" if casadi.has_nlpsol("ipopt") else "not found",
        "compiler": f"{' '.join(compiler.command)}, {compiler.version}"
        if compiler
        else "not found: everything runs on CasADi's virtual machine, slower",
        "ffmpeg": shutil.which("ffmpeg") or "not found: animations as GIF only",
        **_speed(),
    }
    output.pairs(facts)
    output.result(**facts)
    if facts["ipopt"] != "found":
        output.warn(["IPOPT is not in this CasADi: grasps cannot be optimized; install casadi from PyPI"])
        raise typer.Exit(1)


def _speed() -> dict[str, str]:
    """Time of one forward dynamics of the 0.6 m rod, on CasADi's virtual machine and compiled."""
    import timeit

    import casadi
    import numpy as np

    from continuum_grasp.core import compile as compile_model
    from continuum_grasp.model import FingerModel
    from continuum_grasp.scene import Finger, Rod

    rod = Rod(length=0.6, diameter=0.002, density=6450.0, youngs_modulus=60e9)
    model = FingerModel(Finger(rod=rod))
    core = compile_model(model)
    arguments = [np.full(size, 0.1) for size in (model.nx, model.nu, model.nw, model.np)]

    def microseconds(call: Any) -> str:
        timer = timeit.Timer(call)
        count, _ = timer.autorange()
        # The least of three: interruptions only add time.
        return f"{min(timer.repeat(3, count)) / count * 1e6:.3g} us per call from Python"

    # Converted beforehand: the call alone is compared.
    dense = [casadi.DM(argument) for argument in arguments]
    found = {"forward dynamics, virtual machine": microseconds(lambda: model.forward_dynamics(*dense))}
    if core.compiled:
        found["forward dynamics, compiled"] = microseconds(lambda: core.forward_dynamics(*arguments))
    return found
