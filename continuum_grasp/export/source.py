"""Source of an export: a model, a scene, or the path of its file."""

from __future__ import annotations

import keyword
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from numpy.typing import ArrayLike

from continuum_grasp.base import CheckedArgument, InputError, named_value
from continuum_grasp.control import Prediction, RtiSolver, Stages
from continuum_grasp.core import CReal
from continuum_grasp.export.control.loop import ExportedPhases
from continuum_grasp.export.parts import ASKED_FOR, OF_LOOPS, PARTS
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import (
    Consumer,
    ControlScene,
    Scene,
    Surroundings,
    doubt,
    kinds,
    load,
)
from continuum_grasp.simulation import bends_of, resolve_fidelity

_MEANT = re.compile(r"[^\w .,:;()+=%'/-]")
"""Characters that may mean something in a comment of C, in XML, CMake, pkg-config or Markdown."""

_CUT = 0.25
"""Share of the rounding below which the terms of an arc's series are left out in single precision."""

Given: TypeAlias = Any
"""A model, a scene of the core or of an add-on, a run of one, a controller, an estimator, a solver, or a path."""


@dataclass(frozen=True)
class ModelSource:
    """A model and its origin."""

    model: FingerModel | None
    """Model of the finger; None of a solver."""
    title: str
    name: str
    """Name of the source in the README."""
    step: float | None
    configuration: Mapping[str, Any] | None
    """The resolved scene as plain values."""
    loop: ControlScene | RtiSolver | None = None
    """The closed loop, where it is one, or a solver."""
    surroundings: Surroundings | None = None
    """Surroundings that the finger may touch."""
    phases: Callable[[Stages], ExportedPhases] | None = None
    """Phases of a mission, by the problem of its controller; None unless it is a mission."""

    @property
    def finger(self) -> FingerModel:
        """The model; InputError of a solver, which has none."""
        if self.model is None:
            raise InputError("this needs the model of a finger; a solver is exported by export_c", key="given")
        return self.model


@dataclass(frozen=True)
class ExportedLoop:
    """A scene of an add-on as exports take it: as a closed loop, with its configuration as plain values, and phases.

    Attributes
    ----------
    control : ControlScene
    configuration : mapping
    settings : callable, optional
        Dimensions and settings of ``control/c/mission.h``, by the problem of the controller; None without phases.
    names : tuple of str
        Names of the phases.
    ends : float
        Instant at which the last phase is planned to begin [s].
    reported : tuple
        Reports that a finger takes from others, by the names of functions, with their words; none where it is alone.
    """

    control: ControlScene
    configuration: Mapping[str, Any]
    settings: Callable[[Stages], tuple[dict[str, int], Mapping[str, ArrayLike]]] | None = None
    names: tuple[str, ...] = ()
    ends: float = 0.0
    reported: tuple[tuple[str, str], ...] = ()

    @property
    def phases(self) -> Callable[[Stages], ExportedPhases] | None:
        """Phases, by the problem of the controller; None of a controller alone."""
        settings = self.settings
        if settings is None:
            return None
        return lambda stages: ExportedPhases(*settings(stages), self.names, self.ends, self.reported)


def source_of(given: Given, real: CReal, finger: str | None = None) -> ModelSource:
    """The model to export; ``finger`` names one of a mission of several.

    In single precision the series of arcs are cut where rounding would hide the rest, unless the scene says
    otherwise. SolverError if no model keeps the scene's tolerance.
    """
    if isinstance(given, (str, os.PathLike)):
        given = load(os.fspath(given))
    announced = (kind.loop for kind in kinds().values() if type(given).__name__ in (kind.class_name, *kind.results))
    if loop := next(announced, ""):
        exported: ExportedLoop = named_value(loop)(given, finger)
        of_loop = _of_loop(exported.control, real)
        return replace(of_loop, configuration=exported.configuration, phases=exported.phases)
    _ONE_FINGER.check(None, of={"finger": finger is not None})
    if isinstance(given, FingerModel):
        return ModelSource(_of_precision(given, real), "a continuum finger", "a FingerModel", None, None)
    if isinstance(given, RtiSolver):
        title = _plain(given.problem.name)
        of = f"the problem '{title}'" if title else "a problem without a name"
        return ModelSource(None, title or "a predictive controller", of, None, None, given)
    # Controllers, estimators and runs have that of their loop or motion.
    described = getattr(given, "scene", given)
    if isinstance(described, ControlScene):
        return _of_loop(described, real)
    if not isinstance(described, Scene):
        raise InputError(
            "expected a FingerModel, a Scene, a closed loop, a mission, a solver or the path of its file, got "
            f"{given!r:.80}",
            key="given",
        )
    scene, _ = resolve_fidelity(described)
    model = FingerModel(scene)
    model = _of_precision(model.reaching(bends_of(scene, model)), real)
    step = scene.time.step if scene.time is not None else None
    return ModelSource(
        model, title_of(scene), _origin_of(scene), step, scene.model_dump(mode="json"), surroundings=scene
    )


def _of_precision(model: FingerModel, real: CReal) -> FingerModel:
    """A model of the asked precision; one that is evaluated to rounding, in single precision with series that are cut
    at its own.
    """
    if not _is_cut(model, real):
        return model
    return model.with_accuracy(_CUT * real.epsilon)


def _is_cut(model: FingerModel, real: CReal) -> bool:
    return real.name == "float" and model.structure.is_evaluated_to_rounding


def _of_loop(scene: ControlScene, real: CReal) -> ModelSource:
    """The closed loop, and the model that its controller predicts with."""
    if scene.estimator is not None and scene.estimator.frozen and scene.controller.supervisor and not scene.plant.noise:
        doubt(
            "plant.noise",
            "is 0, so that no reading that stays the same counts as frozen, in the package neither: set "
            "plant.noise for sensors that have some, or estimator.frozen: false to test none",
        )
    model = Prediction(scene).system.finger_model
    if _is_cut(model, real):
        fidelity = scene.fidelity.model_copy(update={"accuracy": _CUT * real.epsilon})
        scene = scene.model_copy(update={"fidelity": fidelity})
        model = Prediction(scene).system.finger_model
    title, origin = title_of(scene), _origin_of(scene)
    return ModelSource(model, title, origin, None, scene.model_dump(mode="json"), scene, scene)


_ONE_FINGER = Consumer("export to c of one finger", {"finger": "is for a mission of several fingers"})


def title_of(scene: Any) -> str:
    """Title of a scene, without characters that may mean something in the languages of an export."""
    return _plain(scene.name) or "a continuum finger"


def _origin_of(scene: Any) -> str:
    """Origin of a package in the words of its README."""
    return f"the scene '{title_of(scene)}'" if _plain(scene.name) else "a scene without a name"


def _plain(name: str | None) -> str:
    return " ".join(_MEANT.sub(" ", name or "").split())


# Words of C; headers of its library and of the system, in whose place one of that name would be found; libraries that
# are linked by such names; targets of CMake; the further headers of a package.
_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int long main register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
assert complex ctype errno fenv float inttypes iso646 limits locale math pthread setjmp signal stdarg stdbool stddef
stdint stdio stdlib string tgmath time wchar wctype
c gcc m rt dl
all clean help install package test
board check vectors
"""
_TAKEN = {*keyword.kwlist, *_WORDS.split()}
"""Words that cannot be the prefix."""


def prefix_of(given: Any) -> str:
    """A prefix that C takes."""
    if not isinstance(given, str) or not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", given) or given in _TAKEN:
        raise InputError(
            "expected a C identifier of lowercase letters, digits and single underscores between them, and not a "
            f"word, header, library or target of C, Python or CMake, got {given!r:.60}",
            key="prefix",
        )
    return given


_UNSEEN = "this scene has no estimator: leave the part out"
_ALONE = "contact needs an object and its contact_law in the scene: leave the part out"
_PARTS = (
    Consumer.beside("what=mission", lambda s: s.phases is None, "needs a mission (grasp, contact_law, phases, ...)"),
    Consumer.beside(
        "what=estimator what=mpc", lambda s: s.loop is None, "needs a closed loop (finger, controller, ...)"
    ),
    Consumer.beside("what=estimator", lambda s: not getattr(s.loop, "estimator", None), _UNSEEN),
    Consumer.beside("what=contact", lambda s: not (s.surroundings and s.surroundings.object), _ALONE),
)


def parts_of(what: Sequence[str] | None, source: ModelSource) -> list[str]:
    """Names of the parts of a package, in their order; by default the parts that suit the exported object."""
    if what is None:
        # The controller of a mission has its estimator within.
        estimates = getattr(source.loop, "estimator", None) and source.phases is None
        without = (*ASKED_FOR, *(() if estimates else ("estimator",)), *(("mission",) if source.phases is None else ()))
        what = [name for name in PARTS if (name in OF_LOOPS) == (source.loop is not None) and name not in without]
    names = known_parts(what)
    for part in _PARTS:
        part.check(source, of={f"what={name}": "what" for name in names})
    return [name for name in PARTS if name in names or (name == "mpc" and "mission" in names)]


def known_parts(what: Sequence[str]) -> list[str]:
    """Names of parts, each known; InputError for a name of none."""
    what = [what] if isinstance(what, str) else what
    if "metadata" in what:
        raise InputError("names, units and ranges of all fields are in MANIFEST.json: leave metadata out", key="what")
    return CheckedArgument("what", what).some_of(PARTS, "part")
