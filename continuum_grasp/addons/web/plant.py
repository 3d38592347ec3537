"""Moving part of a page: the finger in its surroundings as strict C, which steps, draws itself and is measured.

A page steps by ``implicit_step``'s method, L-stable, so that contacts and stiff cables need no shorter steps than the
motion. Hands push the finger at ``PUSHED`` of its length, and an object that moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from continuum_grasp.base import Array, InputError
from continuum_grasp.closed_loop import PlantModel, Sensors
from continuum_grasp.control import Prediction, Stages
from continuum_grasp.core import CReal, Sdirk2Stages
from continuum_grasp.export import SETTLED, Field, Kernel, SeenKernels, fill
from continuum_grasp.model import FingerModel, System
from continuum_grasp.scene import (
    FAMILIES,
    Consumer,
    ControlScene,
    ForceLoad,
    Scene,
)
from continuum_grasp.simulation import Signals, bends_of, initial_state, resolve_fidelity

PUSHED = (0.25, 0.5, 0.75, 1.0)
"""Places where a finger can be pushed, as parts of its length."""
PLANNED = 13
"""Sections of a plan's nodes that are drawn."""
FRICTION = "friction_factor"
"""Parameter of contacts: multiple of all their friction coefficients."""
SECTIONS = 25
"""Sections that are drawn, evenly spaced from base to tip; those where a finger can be pushed are among them."""
STEP, CONTACT_STEP = 1e-3, 2.5e-4
"""Steps in time without an object and with one [s]."""


_FEW = 3
"""With more of them the next step takes the slope anew."""
_USUAL = {"1": 1.0, "N": 1.0, "N/s": 10.0, "N m": 0.01, "N m/s": 0.1, "m": 1e-3, "rad": 0.01, "rad/s": 0.1}
"""Usual sizes of other states by their unit."""


@dataclass(frozen=True)
class WebPlant:
    """Symbols of a plant, expressions of them, and where it starts."""

    system: System
    """Finger and object; the state of the plant has drives behind the system's state."""
    symbols: tuple[ca.SX, ca.SX, ca.SX, ca.SX]
    """State, input, forces and parameters."""
    rate: ca.SX
    """Rates of the state."""
    acting: ca.SX
    """Input of the system."""
    sensed: ca.SX
    """Measured readings; empty without a controller."""
    start: Array
    rest: Array
    """Input at time zero."""
    signals: Signals
    """Inputs and forces over time, as the scene has them."""
    p: Array
    x_names: tuple[str, ...]
    tensions: ca.SX
    """Tension of each tendon at its drive [N]."""
    planned: ca.Function | None = None
    """Position of each of ``planned_sections`` at a node of the controller's plan."""

    def __post_init__(self) -> None:
        if self.system.sweeps:
            message = f"a page has no sweeps along the chain: expected fewer than {self.system.fewest_swept} elements"
            raise InputError(message, key="fidelity.elements")

    @property
    def pushes(self) -> int:
        """Index in ``w`` of the first component of the first push; the others follow."""
        return int(self.system.finger_model.nw) - 2 * len(PUSHED)

    @property
    def hands(self) -> range:
        """Indices in ``w`` of what hands push with."""
        return range(self.pushes, self.pushes + 2 * len(PUSHED))

    @property
    def pushed(self) -> list[int]:
        """Sections where it can be pushed."""
        return [round(share * (SECTIONS - 1)) for share in PUSHED]

    @property
    def at(self) -> Array:
        """Positions of the sections that are drawn [m]."""
        return np.linspace(0.0, self.system.finger_model.finger.rod.length, SECTIONS)

    @cached_property
    def _rates(self) -> Kernel:
        """Rate of change of the state."""
        return Kernel.of("rate", self.given, {"rate": ca.densify(self.rate)}, "Rate of change of the state.")

    @property
    def scales(self) -> list[float]:
        """Usual sizes of the states, by which differences are taken."""
        finger = self.system.finger_model
        limits = finger.structure.coordinate_limits()
        # 10.0: usual rate of a coordinate, in its ranges per second
        scales = [*limits, *(10.0 * limit for limit in limits)]
        return scales + [_USUAL.get(field.unit, 0.01) for field in Field.named(self.x_names[len(scales) :])]

    @cached_property
    def seen(self) -> dict[str, list[Kernel]]:
        """Kernels of what a page is shown, by the function of its C.

        Sections, contacts and tensions that are drawn, the former by the kernels of ``export_c``; measurements; a node
        of the plan.
        """
        x, _, w, p = self.symbols
        given = self.given
        seen = SeenKernels(self.system, given, x[: self.system.nx], self.acting, w, p)
        look = [seen.sections("shape", self.at.tolist())]
        if self.system.touch_names:
            look.append(seen.contacts(slip=True))
        if self.tensions.numel():
            look.append(Kernel.of("pull", given, {"tension": self.tensions}, "Tension of each tendon at its drive."))
        sense, foresee = list[Kernel](), list[Kernel]()
        if self.sensed.numel():
            sense.append(Kernel.of("sense", given, {"sensed": ca.vec(ca.SX(self.sensed))}, "What is measured."))
        if self.planned is not None:
            node = ca.SX.sym("node", self.planned.size1_in(0))
            r = self.planned(node)
            points = {"ahead_x": r[0, :].T, "ahead_y": r[1, :].T}
            foresee.append(Kernel.of("ahead", {"node": node}, points, "Sections of a node of the plan."))
        return {"look": look, "sense": sense, "foresee": foresee}

    @property
    def _kernels(self) -> list[Kernel]:
        """Kernels that the plant of a page calls."""
        return [self._rates, *(kernel for kernels in self.seen.values() for kernel in kernels)]

    @property
    def step(self) -> float:
        """Step in time [s]."""
        return STEP if self.system.surroundings is None else CONTACT_STEP

    @cached_property
    def source(self) -> str:
        """All of its C: one file without a library."""
        real = CReal.KINDS["double"]
        words = {
            "kernels": Kernel.all_c_source(self._kernels, "plant", real),
            "exponent": real.bit_pattern(real.exponent_mask),
            "nx": len(self.scales),
            "n": self.system.n,
            "scales": ", ".join(map(real.literal, self.scales)),
            # 1e-7: step of difference quotients, per usual size: their slopes are for Newton's method alone
            "difference": real.literal(1e-7),
            # 1e-9: last correction of Newton's method, per usual size, with which a stage is solved
            "exact": real.literal(1e-9),
            # 8: most Newton corrections with one slope
            "corrections": 8,
            "few": _FEW,
            "gamma": real.literal(Sdirk2Stages.gamma),
            "settled": real.literal(SETTLED),
            "arrays": [(name, max(size, 1)) for name, size in self.arrays.items()],
            "rate": self._rates.call("plant", x="at"),
            **{name: "\n  ".join(kernel.call("plant") for kernel in kernels) for name, kernels in self.seen.items()},
        }
        return fill("web/plant.c", words)

    @property
    def u_names(self) -> list[str]:
        """Name and unit of each input."""
        return list(self.system.u_names[: len(self.rest)])

    @property
    def given(self) -> dict[str, ca.SX]:
        """Symbols by their letters."""
        return dict(zip("xuwp", self.symbols, strict=True))

    @property
    def arrays(self) -> dict[str, int]:
        """Sizes of the arrays in its memory."""
        seen = [kernel.outputs for kernel in self._kernels[1:]]
        sizes = {name: value.numel() for name, value in self.given.items()}
        node = {} if self.planned is None else {"node": self.planned.size1_in(0)}
        return sizes | node | {k: v for of in seen for k, v in of.items()}


def _pushed(scene: Scene, lengths: Sequence[float]) -> Scene:
    """The scene with forces of size zero where a hand may push, and its own elements [m], which these do not split."""
    length = scene.finger.rod.length
    more = tuple(ForceLoad(at=share * length, force=(0.0, 0.0)) for share in PUSHED)
    return scene.replaced(loads=(*scene.loads, *more), fidelity=scene.fidelity.replaced(elements=tuple(lengths)))


def plant_of_scene(given: Scene) -> WebPlant:
    """The plant of a scene whose inputs a hand gives."""
    _PAGE.check(given)
    given, _ = resolve_fidelity(given)
    scene = _pushed(given, FingerModel(given).lengths)
    finger = scene.finger
    family = scene.fidelity.family
    lagged = any(channel.time_constant is not None for channel in finger.channels)
    # A hand changes inputs at once, with which a matched tip would jump.
    if not lagged and (family is None or FAMILIES[family].matches_tip):
        family = FAMILIES.default(free_tip=True)
    place = () if scene.object_moves else ("object_x", "object_y")
    varied = () if scene.object is None else (FRICTION, *place)
    system = System(scene, family=family, object_parameters=varied)
    system = system.reaching(bends_of(scene, system.finger_model))
    x, u, w, p = (
        ca.SX.sym(*symbol) for symbol in (("x", system.nx), ("u", system.nu), ("w", system.nw), ("p", system.np))
    )
    symbols = x, u, w, p
    signals = Signals(scene, system.finger_model, nw=system.nw)
    rest = signals.u(0.0)[0]
    start = initial_state(scene, system)
    rate = system.forward_dynamics(*symbols)
    names = tuple(system.x_names)
    finger_model = system.finger_model
    tensions = u[: len(finger.tendon_list)]
    if finger_model.structure.own_tendons:
        tensions = finger_model.tensions()(x[: finger_model.nx], u[: finger_model.nu], p[: finger_model.np])[0]
    nominal = np.array(system.p_nominal)
    return WebPlant(system, symbols, rate, u, ca.SX(0, 1), start, rest, signals, nominal, names, tensions)


_PAGE = Consumer(
    "export to web",
    refused={
        "plant.guides": "a page has no code that integrates a chain of guides: leave it out",
        "support_motion": "supports of a page stay: leave it out",
        "plant.mounting": "a page counts as the model does: leave it out",
    },
    unneeded={
        **Consumer.LIMITS_OF_BENDING,
        "name": "the title of the page alone",
        "log": "of logs of a bench",
        "time.duration": "the page goes on until it is closed; a table of inputs ends with it",
        **{f"time.{key}": "a page has its own steps" for key in ("step", "method", "tolerance", "space_error")},
        **Consumer.LEAST_COMMANDS,
        "controller.deadline": "the page waits for each command, so that none is late",
        "plant.seed": "the browser draws the noise, anew each time",
    },
)


def plant_of_loop(scene: ControlScene, stages: Stages, of: PlantModel | None = None) -> tuple[WebPlant, Sensors]:
    """The plant of a closed loop and its sensors, by the ``stages`` of its controller; ``of`` where it is not the
    scene's.
    """
    _PAGE.check(scene)
    plant_model = of or PlantModel(scene)
    of_object = plant_model.elements.object_parameters
    if scene.object is not None and FRICTION not in of_object:
        of_object = (FRICTION, *of_object)
    model = PlantModel(
        scene, _pushed(plant_model.scene, plant_model.elements.finger_model.lengths), plant_model.parameters, of_object
    )
    prediction = Prediction(scene)
    sensors = Sensors(scene, model, prediction, None)
    system = model.elements
    sensed = sensors.value(*model.symbols[:3])
    signals = Signals(model.scene, system.finger_model, nw=system.nw)
    rate = model.forward_dynamics(*model.symbols)
    plant = WebPlant(
        system,
        model.symbols,
        rate,
        model.acting,
        sensed,
        model.start,
        model.rest_input,
        signals,
        plant_model.p
        if of_object == plant_model.elements.object_parameters
        else np.insert(plant_model.p, plant_model.finger_parameters, 1.0),
        model.x_names,
        model.tensions if scene.finger.tendon_list else ca.SX(0, 1),
        planned_sections(prediction, stages),
    )
    return plant, sensors


def planned_sections(prediction: Prediction, stages: Stages) -> ca.Function:
    """Positions (2, K) of sections at a node of a plan: its states, then the inputs before it where it has these."""
    node = ca.SX.sym("node", stages.nx)
    known = stages.nx >= stages.nd + stages.nu
    u = node[stages.nd : stages.nd + stages.nu] if known else ca.SX(ca.DM(prediction.scene.rest_input))
    places = tuple(np.linspace(0.0, prediction.scene.finger.rod.length, PLANNED).tolist())
    r, _ = prediction.sections(places)(node[: stages.nd], u, stages.p_nominal)
    return ca.Function("planned", [node], [r])
