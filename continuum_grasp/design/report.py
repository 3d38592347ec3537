"""A design as YAML."""

from __future__ import annotations

from typing import TYPE_CHECKING

from continuum_grasp.results.yaml_text import yaml_text

if TYPE_CHECKING:
    from continuum_grasp.design.result import DesignResult

_HEAD = """\
# The best design found: values of the variables, cost, quantities of every case, sensitivities. SI units. `set` are the
# values as changes of the scene; result.npz holds every design tried, grasp_CASE/ the grasps.
"""


def result_yaml(result: DesignResult) -> str:
    """The design as YAML."""
    return _HEAD + yaml_text(
        {
            "status": result.status.value,
            "message": result.message,
            "set": result.values,
            **result.details(),
            "statistics": dict(result.statistics),
        }
    )
