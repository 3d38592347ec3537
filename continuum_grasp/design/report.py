"""A design as YAML and as a web page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from continuum_grasp.results.html import cards, figure, folded, items, report, section, table
from continuum_grasp.results.yaml_text import yaml_text
from continuum_grasp.scene.design import QUANTITIES

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


def page(result: DesignResult, *, pictures: Mapping[str, Any] | None = None) -> str:
    """The design as an HTML page that refers to no other file or site; ``pictures`` are those drawn, by name."""
    given = result.scene.model_dump(mode="json", exclude_unset=True)
    return report(
        result.name or "design",
        result.status.value,
        result.message,
        result.warnings,
        _picture(result, (pictures or {}).get("design")),
        cards(_key_numbers(result)),
        section("Variables", _variables(result)),
        section("Cases", _cases(result)),
        section("Limits", items(f"{one} is active" for one in result.active)),
        section("Sensitivities", *_sensitivities(result)),
        section("Errors of manufacture", *_errors(result)),
        section("The search", items([*result.switches, *result.kinks]), folded("Statistics", result.statistics)),
        section("The design", folded("Configuration, as it was read", given)),
        solved=result.solved,
    )


def _picture(result: DesignResult, drawn: Any) -> str:
    if not result.drawable():
        return ""
    from continuum_grasp.plotting.design import plot_design
    from continuum_grasp.plotting.drawing.axes import inline_svg

    first = plot_design(result)[0] if drawn is None else drawn.axes[0]
    drawing = inline_svg(first, "design", "grasp, costs of the designs tried, sensitivities")
    caption = (
        "The grasp that decides, with the finger at the start as a dashed line; the cost of every design tried, open "
        "where a limit does not hold; and how the cost changes with each variable."
    )
    return figure("drawing", drawing, caption)


def _key_numbers(result: DesignResult) -> list[tuple[str, str]]:
    if result.best is None or result.first is None:
        return []
    return [
        ("cost", f"{result.best.cost:.6g}"),
        ("cost at the start", f"{result.first.cost:.6g}"),
        ("full searches for grasps", str(result.statistics["full_searches"])),
        ("runs from nearby grasps", str(result.statistics["solver_runs"])),
    ]


def _variables(result: DesignResult) -> str:
    start = dict(zip(result.keys, result.start.tolist(), strict=True))
    rows = []
    for one, place in zip(result.influences, result.space.coordinates, strict=False):
        rows.append(
            (one.key, one.unit, f"{start[one.key]:.6g}", f"{one.value:.6g}", f"{place.low:g}", f"{place.high:g}")
        )
    return table(("Key", "Unit", "Start", "Best", "Least", "Greatest"), rows, (2, 3, 4, 5))


def _cases(result: DesignResult) -> str:
    cases = result.cases
    names = list(next(iter(cases.values()), {}))
    head = ["Case", *(f"{QUANTITIES[key][1]} [{QUANTITIES[key][0] or '1'}]" for key in names)]
    rows = [(case, *(f"{values[key]:.5g}" for key in names)) for case, values in cases.items()]
    return table(head, rows, range(1, len(head)))


def _sensitivities(result: DesignResult) -> tuple[str, str]:
    if result.best is None:
        return "", ""
    rows = [
        (one.key, f"{one.slope:.5g}", f"1/({one.unit})" if one.unit else "", f"{one.per_percent:.4g}", one.at)
        for one in result.influences
    ]
    note = (
        "<p>Of the least cost, through the best grasps; within its bounds a variable has none but what the search has "
        f"left. The differences of the scene's numbers on which they rest are good to {result.best.error:.0e}.</p>"
    )
    return note, table(("Key", "Change of the cost", "per", "for +1 % of its range", "At its bound"), rows, (1, 3))


def _errors(result: DesignResult) -> tuple[str, ...]:
    if not result.worst_cases:
        return ()
    keys = [one.key for one in result.space.tolerated]
    rows = [
        (
            *("+" if sign > 0 else "-" for sign in one.signs),
            f"{one.cost:.6g}",
            f"{max(one.violation, 0.0):.2g}",
            one.message,
        )
        for one in result.worst_cases
    ]
    note = (
        f"<p>Greatest errors in all combinations, grasps solved anew; to first order the worst cost is "
        f"{result.worst_cases[0].bound:.6g}.</p>"
    )
    return note, table((*keys, "Cost", "Violation", ""), rows, (len(keys), len(keys) + 1))
