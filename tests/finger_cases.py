"""Fingers for the tests of model and core: each as a model of the package and as its high-precision reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise

import casadi as ca
import numpy as np

from continuum_grasp.model import FingerModel
from continuum_grasp.scene import BasePose, Damping, Finger, ForceLoad, MomentLoad, PiecewiseCurvature, PointMass
from continuum_grasp.scene import Rod as RodValue
from tests.truth import Rod, TruthFinger, ctx, matched_tip, to_numpy

FAMILIES = ("arc", "clothoid", "matched_clothoid")
LENGTHS = {1: (0.6,), 2: (0.25, 0.35), 3: (0.1, 0.2, 0.3), 5: (0.05, 0.2, 0.1, 0.15, 0.1)}
EXACT = {"arc": None, "clothoid": 1e-13, "matched_clothoid": 1e-13}
"""Accuracy to ask for where rounding is all that may be left."""
NODES = 24
"""Of the reference per element: 30 digits at bends of 2 pi."""
PATTERNS = ((1.0, -0.7, 0.4, -1.0, 0.8, 0.6), (1.0, 1.0, 1.0, 1.0, 1.0, 1.0))

ROD = RodValue(length=0.6, linear_density=0.8, bending_stiffness=0.5, rotary_inertia=3e-4)
FULL = Finger(
    rod=ROD,
    damping=Damping(material=0.01, per_arc=0.02),
    rest_curvature=PiecewiseCurvature(breaks=(0.17, 0.42), values=(0.9, -1.4, 0.5)),
    masses=(PointMass(at=0.6, mass=0.2), PointMass(at=0.21, mass=0.3), PointMass(at=0.5, mass=0.1)),
    base=BasePose(position=(0.3, -0.2), angle=-0.7),
)
LOADS = (
    ForceLoad(at=0.13, force=(0.0, 0.0)),
    ForceLoad(at=0.33, force=(0.0, 0.0), follows=True),
    ForceLoad(at=0.6, force=(0.0, 0.0), follows=True),
    MomentLoad(at=0.22, moment=0.0),
    MomentLoad(at=0.6, moment=0.0),
)


@dataclass(frozen=True)
class Case:
    """A finger with its surroundings."""

    finger: Finger = FULL
    gravity: tuple[float, float] = (1.2, -9.7)
    loads: tuple = ()
    contacts: tuple[float, ...] = ()
    options: dict = field(default_factory=dict)
    """Further keywords of the model."""

    def with_finger(self, **changes) -> Case:
        """The same with another finger."""
        return replace(self, finger=self.finger.model_copy(update=changes))

    def model(self, family: str, elements: int | tuple = 2, **options) -> FingerModel:
        """The package's model on unequal elements."""
        lengths = LENGTHS[elements] if isinstance(elements, int) else elements
        keywords = {"gravity": self.gravity, "loads": self.loads, "contacts": self.contacts}
        return FingerModel(self.finger, family=family, elements=lengths, **keywords, **{**self.options, **options})

    def reference(self, model: FingerModel) -> TruthFinger:
        """The same for the reference implementation."""
        finger, rod, rest = self.finger, self.finger.rod, self.finger.profile.rest_curvature
        return TruthFinger(
            lengths=model.lengths,
            family=model.family,
            mass_per_length=rod.mass_per_length,
            rotary_inertia=rod.inertia_per_length,
            bending_stiffness=rod.stiffness,
            rest_curvature=[(a, b, c[0]) for (a, b), c in zip(pairwise(rest.edges), rest.coefficients, strict=True)],
            masses=[(m.at, m.mass) for m in finger.masses],
            gravity=self.gravity,
            base_position=finger.base.position,
            base_angle=finger.base.angle,
            material_damping=finger.damping.material,
            element_damping=finger.damping.per_arc,
        )

    def drive(self, model: FingerModel, u: np.ndarray) -> list:
        """The tip moment that u stands for, couples included, its rate and its acceleration, to 50 digits."""
        couples = sum(isinstance(k, MomentLoad) and k.at == self.finger.rod.length for k in self.loads)
        weights = [ctx.mpf(1)] * (1 + couples)
        if self.finger.tendons is not None:
            offset = ctx.mpf(self.finger.tendons.offset)
            weights = [offset, -offset, *weights[1:]]
        blocks = [u[k : k + len(weights)] for k in range(0, len(u), len(weights))]
        values = [ctx.fdot(weights, [ctx.mpf(v) for v in block]) for block in blocks]
        return values + [ctx.mpf(0)] * (3 - len(values))

    def forces(self, model: FingerModel, rod: Rod, w: np.ndarray) -> tuple[list, list]:
        """World forces (s, x, y) and moments (s, value) that w stands for."""
        places = [*self.contacts, *([self.finger.rod.length] if model.structure.tip_force else [])]
        forces = [(s, w[2 * k], w[2 * k + 1]) for k, s in enumerate(places)]
        moments, next_entry = [], 2 * len(places)
        for load in self.loads:
            if isinstance(load, MomentLoad):
                if load.at != self.finger.rod.length:
                    moments.append((load.at, w[next_entry]))
                    next_entry += 1
                continue
            x, y = ctx.mpf(w[next_entry]), ctx.mpf(w[next_entry + 1])
            if load.follows:
                cosine, sine = ctx.cos_sin(rod.orientation(load.at))
                x, y = cosine * x - sine * y, sine * x + cosine * y
            forces.append((load.at, x, y))
            next_entry += 2
        return forces, moments


@dataclass(frozen=True)
class State:
    """Numbers to evaluate a model at."""

    q: np.ndarray
    qd: np.ndarray
    u: np.ndarray
    w: np.ndarray

    @property
    def x(self) -> np.ndarray:
        return np.concatenate([self.q, self.qd])


def state(model: FingerModel, bend: float, pattern: int = 0, seed: int = 0) -> State:
    """A moving finger whose elements use the bend [rad] at most (clothoids: in length times nodal curvature)."""
    rng = np.random.default_rng(seed)
    shares = bend * np.array(PATTERNS[pattern])[: model.n]
    if model.family != "arc":
        h = np.array([*model.lengths, model.lengths[-1]])
        longest = np.maximum(h, np.concatenate([[0.0], h[:-1]]))
        shares = shares / longest[: model.n]
    rates = rng.uniform(2.0, 4.0, model.n) * np.array(PATTERNS[pattern])[: model.n]
    rates = rates if model.family == "arc" else 5.0 * rates
    return State(shares, rates, rng.uniform(-0.2, 0.2, model.nu), rng.uniform(-1.0, 1.0, model.nw))


def evaluate(function: ca.Function, *arguments) -> np.ndarray:
    """The first output as an array, columns as vectors."""
    out = function(*arguments)
    value = np.array(out[0] if isinstance(out, (tuple, list)) else out)
    return value[:, 0] if value.shape[1] == 1 else value


SECTIONS = (0.07, 0.25, 0.47)


def model_values(model: FingerModel, at: State) -> dict[str, np.ndarray]:
    """What the model says; the Jacobian's rate is left to ``jacobian_rate_error``."""
    p = model.p_nominal
    rest, moving = (at.q, at.u, p), (at.q, at.qd, at.u, p)
    values = {name: evaluate(getattr(model, name), *rest) for name in ("mass_matrix", "gravity", "elastic", "bending")}
    values |= {name: evaluate(getattr(model, name), *moving) for name in ("bias", "damping")}
    values["actuation"] = evaluate(model.actuation, *rest)
    values["external_force"] = evaluate(model.external_force, at.q, at.u, at.w, p)
    for name in ("position", "orientation", "jacobian"):
        function = getattr(model, name)
        values[name] = np.array([evaluate(function, at.q, at.u, s, p) for s in SECTIONS])
    values["tip"] = evaluate(model.tip, *rest)
    values["energy"] = np.array([float(v) for v in model.energy(at.x, at.u, p)])
    values["acceleration"] = evaluate(model.forward_dynamics, at.x, at.u, at.w, p)[model.n :]
    return values


def true_values(case: Case, model: FingerModel, at: State) -> dict[str, np.ndarray]:
    """What the reference says, rounded from 50 digits; and the condition number of the mass matrix."""
    moment, *rates = case.drive(model, at.u)
    finger = case.reference(model)
    tip = matched_tip(finger, moment, *rates)
    rod = Rod(finger, at.q, at.qd, tip, NODES)
    forces, moments = case.forces(model, rod, at.w)
    none = rod.applied()
    values = {name: getattr(rod, name) for name in ("gravity", "elastic", "bias", "damping")}
    values |= {"mass_matrix": rod.mass, "bending": rod.bends(), "energy": [rod.kinetic, rod.potential]}
    values["actuation"] = rod.applied(tip_moment=moment) - none
    values["external_force"] = rod.applied(forces, moments=moments)
    values["tip"] = rod.position(case.finger.rod.length)
    values["acceleration"] = rod.acceleration(forces, moment, moments)
    values = {name: to_numpy(value) for name, value in values.items()}
    # A 1 x 1 matrix comes as a vector.
    values["mass_matrix"] = values["mass_matrix"].reshape(model.n, model.n)
    for name in ("position", "orientation", "jacobian"):
        values[name] = np.array([to_numpy(getattr(rod, name)(s)) for s in SECTIONS])
    values["condition"] = np.linalg.cond(values["mass_matrix"])
    return values


def errors(case: Case, model: FingerModel, at: State) -> dict[str, float]:
    """Relative error of everything, scaled by the largest entry; accelerations per condition number of M."""
    values, truth = model_values(model, at), true_values(case, model, at)
    found = {name: relative_error(value, truth[name]) for name, value in values.items()}
    found["acceleration"] /= truth["condition"]
    return found


def jacobian_rate_error(case: Case, model: FingerModel, at: State) -> float:
    """Relative error of the Jacobian's rate at constant input."""
    finger = case.reference(model)
    rod = Rod(finger, at.q, at.qd, (matched_tip(finger, case.drive(model, at.u)[0])[0], 0, 0), NODES)
    values = [evaluate(model.jacobian_rate, at.q, at.qd, at.u, s, model.p_nominal) for s in SECTIONS]
    return relative_error(values, np.array([to_numpy(rod.jacobian_rate(s)) for s in SECTIONS]))


def energy_rate(model: FingerModel, u: np.ndarray) -> Callable[[np.ndarray, np.ndarray], float]:
    """Power [W] that a state's rates put into kinetic and potential energy, by the energy's exact derivative."""
    x = ca.MX.sym("x", model.nx)
    slope = ca.Function("slope", [x], [ca.jacobian(sum(model.energy(x, u, [])), x)])
    return lambda state, rates: float(slope(state).full().ravel() @ rates)


def relative_error(value, truth) -> float:
    """Largest difference by the largest entry; where the truth is zero, zero is expected."""
    value, truth = np.asarray(value, dtype=float), np.asarray(truth, dtype=float)
    difference, scale = float(np.abs(value.reshape(truth.shape) - truth).max()), float(np.abs(truth).max())
    if not np.isfinite(difference):
        return np.inf
    return difference / scale if scale > 0.0 else (0.0 if difference == 0.0 else np.inf)


def worst(found: dict[str, float]) -> tuple[str, float]:
    """The name and size of the largest error."""
    name = max(found, key=lambda key: found[key])
    return name, found[name]


@lru_cache
def shared_model(family: str, elements: int, reach: float, upright: bool = False) -> tuple[Case, FingerModel]:
    """The full finger with every kind of load, as accurate as can be asked for; built once."""
    case = Case(loads=LOADS, contacts=LENGTHS[elements][:1] if elements > 1 else ())
    if upright:
        case = case.with_finger(base=BasePose())
    return case, case.model(family, elements, bending_range=reach, accuracy=EXACT[family])
