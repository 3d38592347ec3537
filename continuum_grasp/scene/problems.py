"""Faults found by validation, in the user's words and at the user's line."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from continuum_grasp.base import InputError, nearest
from continuum_grasp.scene.document import Document, KeyPath, dotted, undotted
from continuum_grasp.scene.doubts import CollectedDoubt, children, collected_doubts
from continuum_grasp.scene.shape import Shape
from continuum_grasp.scene.units import QUANTITIES, advice_on, expected

Model = TypeVar("Model", bound=BaseModel)

_MOST = 20
"""Problems that are listed: what a terminal shows at once."""
_KINDS = {
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "text",
    "tuple_type": "a list",
    "list_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "none_required": "nothing",
}
_STRANGE = {"extra_forbidden", "missing"}
_RENAMED = {
    "from": "min",
    "to": "max",
    "q_above_rest": "q",
    "second_moment": "thickness and width of finger.rod",
    "residual": "finger.tendons.friction, finger.damping.dry_friction or finger.softening",
    "loss": "holdout_rows or window, by which outliers, that fits name, are left out",
    **dict.fromkeys(
        ("data.x", "data.y", "data.at", "data.sigma"), "measured: [{quantity: x, column: x}, {quantity: y, column: y}]"
    ),
    "kind: frequencies": "kind: static, measured: [{quantity: frequency, of: MODE, column: ...}]",
    "torque_constant": "torques, which are currents times it",
    "currents": "torques: [current * torque constant]",
    "current": "torque, the current times the torque constant",
    "closing": "a scene of simulate with the object, or a mission",
}
"""Keys that are said by another one, or by another scene."""
_LIMITS = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}


class KeyedError(ValueError):
    """An error in a file, whose text begins with the key."""


@dataclass(frozen=True)
class Fault:
    """A fault: its place in the data, and its text; ``at_key`` points at the key rather than at its value."""

    path: KeyPath
    message: str
    at_key: bool = False


@dataclass(frozen=True)
class _Located:
    """An error of pydantic with its location taken apart into data path and union branches."""

    path: KeyPath
    branches: tuple[tuple[KeyPath, str], ...]
    error: Mapping[str, Any]


def validated(document: Document, model: type[Model]) -> Model:
    """The contents of a document, checked: `InputError` has file, line, column and key of everything that is wrong."""
    with collected_doubts() as doubts:
        try:
            checked = model.model_validate(document.value)
        except ValidationError as error:
            raise input_error(error, model, document) from error
    _warn_of(doubts, checked, document)
    return checked


def _warn_of(doubts: Sequence[CollectedDoubt], checked: BaseModel, document: Document) -> None:
    """Warn of doubts, with their places in a document."""
    found = dict[tuple[str, str], None]()
    derived = dict[tuple[str, str], None]()
    for key, text, owner in doubts:
        # A value replaced in validation, such as an object laid against a wall, is found by its class.
        known = (
            []
            if owner is None
            else [path for path, value in children(checked) if value is owner]
            or [path for path, value in children(checked) if type(value) is type(owner)]
        )
        place = dotted((*(known[0] if known else ()), *undotted(key)))
        (found if known or owner is None else derived)[place, text] = None
    # Values that follow from others, such as the tendons of a pair, repeat the doubts of these.
    known_texts = {text for _, text in found}
    found |= {doubt: None for doubt in derived if doubt[1] not in known_texts}
    for key, text in found:
        document.doubt(key, text)


def input_error(error: ValidationError, model: type[BaseModel], document: Document) -> InputError:
    """Every problem of a document on a line of its own, in the order of the file; the first one gives the position.

    Problems are at the user's own keys: branch names that pydantic puts into locations inside unions are taken out, and
    only the branches that the value could have been meant for are reported.
    """
    shape, data = Shape(model), document.value
    located = [_locate(e, data, shape) for e in error.errors(include_url=False) if not _is_echo(e)]
    problems = _choose_branches(located, shape, data)
    placed = list(
        dict.fromkeys((document.nearest(problem.path, at_key=problem.at_key), problem) for problem in problems)
    )
    main_file = document.places[()].file
    placed.sort(key=lambda item: (item[0].file != main_file, item[0].file, item[0].line or 0, item[0].column or 0))
    lines = [str(place.error(problem.message, problem.path)) for place, problem in placed[1:_MOST]]
    if len(placed) > _MOST:
        lines.append(f"and {len(placed) - _MOST} more")
    place, first = placed[0]
    return place.error("\n".join([first.message, *lines]), first.path)


def _is_echo(error: Any) -> bool:
    """Whether pydantic calls a list too short only since it does not count the entries that are wrong."""
    entries = error["input"]
    return (
        error["type"] == "too_short"
        and isinstance(entries, list | tuple)
        and len(entries) >= error["ctx"]["min_length"]
    )


def _locate(error: Any, data: Any, shape: Shape) -> _Located:
    path: list[str | int] = []
    branches: list[tuple[KeyPath, str]] = []
    value, tagged = data, False
    loc = error["loc"]
    for k, part in enumerate(loc):
        last = k == len(loc) - 1
        if isinstance(value, dict) and isinstance(part, str):
            if not tagged and any(value.get(tag) == part for tag in shape.discriminators):
                tagged = True
                continue
            if part in value or (last and error["type"] == "missing"):
                path.append(part)
                value, tagged = value.get(part), False
                continue
        elif isinstance(value, list) and isinstance(part, int):
            path.append(part)
            value, tagged = (value[part] if part < len(value) else None), False
            continue
        # Neither a key nor an index of the data: the name that pydantic gives a branch of a union.
        branches.append((tuple(path), str(part)))
    return _Located(tuple(path), tuple(branches), error)


def _choose_branches(located: list[_Located], shape: Shape, data: Any) -> list[Fault]:
    """Retain the branches of each union whose kind of value fits; if none fits, list all expected kinds."""
    unions = sorted(dict.fromkeys(path for item in located for path, _ in item.branches), key=len)
    problems: list[Fault] = []
    for union in unions:
        here = [item for item in located if any(path == union for path, _ in item.branches)]
        labels = {dict(item.branches)[union] for item in here}
        # Wrong in kind at the union itself, as text where a branch is a mapping: that branch was not meant.
        unfit = {dict(item.branches)[union] for item in here if item.path == union and item.error["type"] in _KINDS}
        located = [item for item in located if item not in here]
        if labels == unfit:
            wanted = " or ".join(dict.fromkeys(_kind(item, shape, data) for item in here if item.path == union))
            problems.append(_wrong_type(union, wanted, here[0].error["input"], shape.unit(union, data)))
        else:
            # If several mappings fit, the user meant the one with the most similar keys.
            strange = Counter(dict(item.branches)[union] for item in here if item.error["type"] in _STRANGE)
            fewest = min(strange[label] for label in labels - unfit)
            meant = {label for label in labels - unfit if strange[label] == fewest}
            located += [item for item in here if dict(item.branches)[union] in meant]
    return problems + [_problem(item, shape, data) for item in located]


def _problem(item: _Located, shape: Shape, data: Any) -> Fault:
    error, path = item.error, item.path
    kind, got, context = error["type"], error["input"], error.get("ctx") or {}
    if kind in _KINDS:
        return _wrong_type(path, _kind(item, shape, data), got, shape.unit(path, data))
    if kind in _LIMITS:
        name, words = _LIMITS[kind]
        limit = context[name]
        # Lower limits such as 1e-12 only exclude absurd magnitudes; of a negative number they would mislead.
        if name == "ge" and 0.0 < limit < 1.0 and isinstance(got, int | float) and got <= 0.0:
            words, limit = "greater than", 0
        about = shape.description(path, data).partition(";")[0] if limit else ""
        what = f"a number {words} {limit:g}" + (f" ({about})" if about else "")
        written = Document(data).get(path)
        also = f" ({written[:60]})" if isinstance(written, str) else ""
        return Fault(path, f"out of range: expected {what}, got {_show(got)}{also}")
    match kind:
        case "missing" if isinstance(path[-1], int):
            size = shape.size(path[:-1], data)
            return Fault(path[:-1], f"the list is too short: expected {size or 'more'} entries, got {path[-1]}")
        case "missing":
            about = shape.description(path, data)
            return Fault(path, "missing" + (f"; expected {about}" if about else ""))
        case "extra_forbidden":
            word, section = str(path[-1]), f"{path[0]}.{path[-1]}" if len(path) == 3 else ""
            instead = _RENAMED.get(word, _RENAMED.get(section))
            hint = f"; write {instead!r}" if instead else nearest(word, shape.keys(path[:-1], data))
            return Fault(path, f"unknown key{hint}", at_key=True)
        case "finite_number":
            return Fault(path, f"not finite: expected a finite number, got {_show(got)}")
        case "literal_error":
            allowed = shape.choices(path, data)
            hint = nearest(got, allowed, say_all=False) if isinstance(got, str) else ""
            return Fault(path, f"not one of the choices: expected {context['expected']}, got {_show(got)}{hint}")
        case "union_tag_not_found":
            tag = str(context["discriminator"]).strip("'")
            words = " or ".join(map(repr, shape.tags(path, data)))
            return Fault((*path, tag), "missing" + (f"; expected {words}" if words else ""))
        case "union_tag_invalid":
            tag = str(context["discriminator"]).strip("'")
            instead = _RENAMED.get(f"kind: {context['tag']}")
            hint = f"; write {instead}" if instead else nearest(context["tag"], shape.tags(path, data), say_all=False)
            what = f"not one of the choices: expected {context['expected_tags']}, got {context['tag']!r}{hint}"
            return Fault((*path, tag), what)
        case "too_short":
            return Fault(path, f"too short: expected at least {context['min_length']} entries, got {_show(got)}")
        case "too_long":
            hint = " (write decimal points, not commas)" if shape.size(path, data) else ""
            return Fault(path, f"too long: expected at most {context['max_length']} entries, got {_show(got)}{hint}")
        case "value_error":
            message = str(context.get("error", error["msg"]))
            mentioned = _mentioned(message, path, data)
            return Fault(mentioned, message.removeprefix(f"{dotted(mentioned[len(path) :])}: "))
    return Fault(path, f"{error['msg']}; got {_show(got)}")


def _wrong_type(path: KeyPath, wanted: str, got: Any, unit: str | None) -> Fault:
    hint = ""
    if isinstance(got, str) and "true" in wanted and got.lower() in {"yes", "no", "on", "off", "y", "n"}:
        hint = f" (write {'true' if got.lower() in {'yes', 'on', 'y'} else 'false'})"
    elif isinstance(got, str) and (unit is not None or "number" in wanted):
        if re.fullmatch(r"\s*[-+]?\d+,\d+\s*", got):
            hint = " (write a decimal point, not a comma)"
        elif re.fullmatch(r"\s*[-+]?[\d.]+(e[-+]?\d+)?\s*", got, re.IGNORECASE):
            hint = " (write it without quotes)"
        elif unit in QUANTITIES:
            hint = f" ({advice})" if (advice := advice_on(got, unit)) else ""
        elif re.match(r"\s*[-+]?[\d.]+(e[-+]?\d+)?\s*[a-zA-Z%°]", got):
            hint = " (write the bare number, in SI units)"
    return Fault(path, f"wrong type: expected {wanted}, got {_show(got)}{hint}")


def _kind(item: _Located, shape: Shape, data: Any) -> str:
    kind = item.error["type"]
    if kind == "float_type" and (unit := shape.unit(item.path, data)):
        return expected(unit)
    if kind in {"tuple_type", "list_type"}:
        count = shape.size(item.path, data)
        return f"a list of {count}" if count else "a list"
    if kind == "model_type":
        keys = shape.model_keys(str((item.error.get("ctx") or {}).get("class_name")))
        return f"a mapping with keys like {', '.join(keys[:3])}" if keys else "a mapping"
    return _KINDS[kind]


def _mentioned(message: str, path: KeyPath, data: Any) -> KeyPath:
    """The key that a message begins with, where the data has it; otherwise the path itself."""
    value = Document(data).get(path)
    keys: list[str | int] = []
    start = re.match(r"[a-z_]\w*(?:\.[a-z_]\w*|\[\d+\])*", message)
    for name, index in re.findall(r"([a-z_]\w*)|\[(\d+)\]", start.group()) if start else ():
        if name and isinstance(value, dict) and name in value:
            keys.append(name)
        elif index and isinstance(value, list) and int(index) < len(value):
            keys.append(int(index))
        else:
            break
        value = value[keys[-1]]
    return (*path, *keys)


def _show(value: Any) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else f"{'-' if value < 0 else ''}.inf"
    if isinstance(value, dict):
        return "a mapping" + (f" with keys {', '.join(map(str, list(value)[:5]))}" if value else " without keys")
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    if isinstance(value, str):
        return f"text {value if len(value) <= 60 else value[:57] + '...'!r}"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
