"""``continuum-grasp doctor``."""

from __future__ import annotations

import os
import shutil

import typer

from continuum_grasp.cli.options import verb
from continuum_grasp.cli.output import Output

_PACKAGES = ("casadi", "numpy", "scipy", "matplotlib", "pydantic", "pyyaml", "typer", "rich")


@verb("as_json")
def doctor(output: Output) -> None:
    """Print versions, solvers and compiler."""
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
    }
    output.pairs(facts)
    output.result(**facts)
    if facts["ipopt"] != "found":
        output.warn(["IPOPT is not in this CasADi: grasps cannot be optimized; install casadi from PyPI"])
        raise typer.Exit(1)
