"""Texts of the package with places to fill: <<word>>."""

from __future__ import annotations

from collections.abc import Mapping

from continuum_grasp.core.source import filled, template


def fill(name: str, words: Mapping[str, object]) -> str:
    """Fill a template, by its path below ``templates``, of some of the words; ``P`` is the prefix ``p`` in capitals."""
    return filled(template("export", name), {"P": str(words.get("p", "")).upper(), **words})
