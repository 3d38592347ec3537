"""Texts of the package with places to fill: <<word>>."""

from __future__ import annotations

from collections.abc import Mapping

from continuum_grasp.core.source import filled, template


def fill(name: str, words: Mapping[str, object]) -> str:
    """Fill a template, by its path below ``templates``; more words than it asks for may be given."""
    return filled(template("export", name), words)
