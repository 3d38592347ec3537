"""The command line: one file per verb."""

from continuum_grasp.cli.app import app, main

__all__ = ["app", "main"]
