"""Variables of a design, resolved: variables with their places, and the scene of every case and design."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from continuum_grasp.addons.design.scene import Design, DesignVariable, Tolerance
from continuum_grasp.addons.sweeps import SceneKeys, VariedKey
from continuum_grasp.base import InputError
from continuum_grasp.scene import ConfigurationData, Consumer, Document, GraspScene, KeyPath

_ONE_POSTURE = Consumer.refusals(
    """
    robust: a design follows one posture, not a grasp that must hold for many errors; expected a reserve
        (contacts.reserve) and tolerances of the design
    friction_states=any with state_columns: a design follows one posture, not a grasp that must hold for many; expected
        friction_states: pulled
    """
)
SINGLE = "scene"
"""Name of the case of a design that lists none."""


@dataclass(frozen=True)
class DesignSpace:
    """A design, resolved."""

    keys: SceneKeys[Design]
    """Keys of the scene that the design names."""
    coordinates: tuple[VariedKey[DesignVariable], ...]
    """The variables, as coordinates from 0 to 1 from the least value to the greatest."""
    tolerated: tuple[VariedKey[Tolerance], ...]
    cases: Mapping[str, ConfigurationData]

    def scene(self, case: str, values: Sequence[float], errors: Sequence[float] = ()) -> GraspScene:
        """The scene of a case for values of the variables, and errors of tolerated numbers; InputError if these do not
        make sense together.
        """
        chosen = dict(zip(self.design.variables, values, strict=True))
        puts: list[tuple[KeyPath, float]] = []
        for number, error in zip(self.tolerated, errors, strict=False):
            if number.key in chosen:
                chosen[number.key] += error
            else:
                puts.append((number.path, number.nominal + error))
        puts += [(coordinate.path, chosen[coordinate.key]) for coordinate in self.coordinates]
        puts += zip((tie.path for tie in self.keys.ties), self.keys.followed(chosen).values(), strict=True)
        document = self.cases[case]
        changes = [(path, Document.at(document.place(path), value)) for path, value in puts]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of the scene's file, which has been read
            scene = document.changed(changes).validated(GraspScene)
        _check_posture(scene)
        return scene

    @property
    def design(self) -> Design:
        """The design as it is written."""
        return self.keys.config

    @property
    def start(self) -> list[float]:
        """Values where the search starts."""
        return [coordinate.nominal for coordinate in self.coordinates]


def _check_posture(scene: GraspScene) -> None:
    """Refuse grasps that must hold for many errors or friction states."""
    for feature in _ONE_POSTURE:
        feature.check(scene)


def design_space_of(data: ConfigurationData) -> DesignSpace:
    """Resolve a design and check that its keys and values have their place in the scene."""
    keys = SceneKeys(Design, data)
    design = keys.config
    scene = keys.base.validated(GraspScene)
    _check_posture(scene)
    tolerated = []
    for key, tolerance in design.tolerances.items():
        path = keys.change(("tolerances", key), key, 0.0)[0]
        value = math.nan if key in design.variables else _number(keys, ("tolerances", key), scene, path)
        tolerated.append(VariedKey(key, path, keys.unit(path), tolerance, nominal=value))
    return DesignSpace(
        keys,
        tuple(_coordinate(keys, key, variable, scene) for key, variable in design.variables.items()),
        tuple(tolerated),
        {name: _case(keys, name, changes) for name, changes in design.cases.items()} or {SINGLE: keys.base},
    )


def _coordinate(
    keys: SceneKeys[Design], key: str, variable: DesignVariable, scene: GraspScene
) -> VariedKey[DesignVariable]:
    where = ("variables", key)
    start = variable.start
    varied = keys.varied(where, key, variable, [variable.min, variable.max], listed=False)
    if start is None:
        start = _number(keys, where, scene, varied.path)
        if not variable.min <= start <= variable.max:
            message = f"the scene has {start:g}, not within {variable.min:g} and {variable.max:g}: give start"
            raise keys.data.nearest(where).error(message, where)
    return replace(varied, nominal=start)


def _number(keys: SceneKeys[Design], where: KeyPath, scene: GraspScene, path: KeyPath) -> float:
    """The number of the scene at a path, also one that its file leaves to the default."""
    number: Any = scene.entry(path)
    if isinstance(number, bool) or not isinstance(number, int | float):
        message = "the scene has no number there" + ("" if number is None else f", but {number!r:.60}")
        raise keys.data.nearest(where).error(message, where)
    return float(number)


def _case(keys: SceneKeys[Design], name: str, changes: Mapping[str, Any]) -> ConfigurationData:
    edits = [keys.change(("cases", name, key), key, value) for key, value in changes.items()]
    document = keys.base.changed(edits)
    try:
        document.validated(GraspScene)
    except InputError as error:
        # Where every key is right on its own but the scene makes no sense, the variables may repair it.
        if keys.fault_kinds(error) != {"value_error"}:
            raise error from None
    document.value = keys.shape.in_si((), document.value, document.value)
    return document


def read_design(data: ConfigurationData) -> Design:
    """The design of a file, whose keys and values have their place in the scenes that it names."""
    return design_space_of(data).design
