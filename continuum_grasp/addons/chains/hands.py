"""A hand and its object as a model of MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp import __version__
from continuum_grasp.addons.chains.controls import Control
from continuum_grasp.addons.chains.links import rounded_step
from continuum_grasp.addons.chains.posture import HandFingerChain, quaternion
from continuum_grasp.addons.chains.solid_geometry import SolidGeometry, solid_inertia
from continuum_grasp.addons.chains.text import FINGER, OBJECT, SUPPORT, document, link_inertial, numbers
from continuum_grasp.base import Array, InputError
from continuum_grasp.export import fill, title_of

LINKS = 24
"""Default links per finger: forces are then within 1 % of the rod's forces."""
CLOSES = 1.0
"""Time in which tensions rise of a hand that closes [s]: slow beside its fingers, which need a tenth of that."""
_OBJECT_SHARE = 0.03
"""Mass that sets the pace of a finger, of the object's, where the finger itself is lighter."""
_ADDED = 0.036
"""Mass that inertia of the hinges themselves adds at the tip of a finger, per mass that sets its pace. Without it links
of a tenth of a gram ring faster than any useful step."""
_PHASE = 0.3
"""Angle by which the fastest hinge swings in a step [rad]."""
_DAMPED = 0.67
"""Least damping ratio of a finger's first mode: no force at rest, and a hand that is let go settles in a tenth of a
second."""
_FIRST_MODE = 3.516
"""Square of the first root of cos(z) cosh(z) = -1: of the pulsation of a cantilever, per sqrt(E I / (m L^3))."""
_THIN = 1e-4
"""Least radius of a capsule [m]."""
_LIGHT = 1e-9
"""Least mass of a link [kg]: the integration of lighter links is lost in rounding."""
_AXES = ("bend", "0 0 1"), ("side", "1 0 0"), ("twist", "0 1 0")


@dataclass(frozen=True)
class HandChain:
    """A hand and the object that it holds as a model of MuJoCo.

    Attributes
    ----------
    text : str
        The model as MJCF; ``mujoco.MjModel.from_xml_string`` takes it.
    hinges : int
        Links of each finger, with three hinges each.
    first_frequency : float
        Lowest natural frequency of the straight, unloaded fingers [Hz].
    timestep : float
        Time step of the model [s].
    differences : tuple of str
        Differences between the model and the scene, in words.
    object_difference : str
        Deviation of MuJoCo's convex pieces from the object, in words; empty if they are exact.
    commands : dict of str to float
        Commands of the grasp by actuator: tensions [N], or wound-up cable of locked drives [m].
    files : tuple of pathlib.Path
        Written files: the model, and the table of commands that closes the hand.
    """

    text: str
    hinges: int
    first_frequency: float
    timestep: float
    differences: tuple[str, ...]
    object_difference: str
    commands: dict[str, float]
    files: tuple[Path, ...] = field(default=())

    @property
    def control_names(self) -> list[str]:
        """Names of the actuators, in their order."""
        return list(self.commands)

    def controls(self, t: ArrayLike) -> Array:
        """Commands (T, nu) of a hand that closes, at instants (T,) [s]: the grasp's commands from one second on."""
        instants = np.atleast_1d(np.asarray(t, dtype=float))
        return np.asarray(np.outer(np.clip(instants / CLOSES, 0.0, 1.0), list(self.commands.values())))


def hand_chain(result: Any, hinges: int = LINKS) -> HandChain:
    """The model of a grasp that was found."""
    if not result.balanced:
        raise InputError(f"there is no grasp to export: {result.message}")
    scene = result.scene
    solid = result.scene.object
    chains = [HandFingerChain(result, k, hinges) for k in range(len(scene.setups))]
    paces = [_pace(chain, solid.weighed) for chain in chains]
    swings = zip(chains, paces, strict=True)
    step = rounded_step(min(_PHASE * np.sqrt(inertia / chain.stiffness.max()) for chain, (inertia, _) in swings), None)
    geometry = SolidGeometry.of(result)
    controls = {chain.name: _controls(chain) for chain in chains}
    commands = {control.name: float(control.value) for of in controls.values() for control in of}
    length = max(chain.finger.rod.length for chain in chains)
    center = 0.5 * np.mean([chain.frame.base for chain in chains], axis=0) + 0.5 * np.array(solid.position)
    words: dict[str, object] = {
        "option": {
            "timestep": numbers(step),
            "integrator": "implicitfast",
            "gravity": numbers(*scene.acceleration),
            "cone": "elliptic",
            # Friction as hard as MuJoCo makes it: with less, objects creep.
            "impratio": "100",
            "noslip_iterations": "5",
            "iterations": "50",
            "tolerance": "1e-12",
        }.items(),
        "contact": {"solref": f"{numbers(2.0 * step)} 1", "solimp": "0.95 0.99 0.0001"}.items(),
        "center": numbers(*center),
        "extent": 2.0 * length,
        "light": {"pos": numbers(*(center + np.array([0.0, -2.0, 4.0]) * length)), "dir": "0 0.4 -1"}.items(),
        "cameras": [_camera(center, length).items()],
        "fingers": [_finger(chain, *pace, geometry.edge) for chain, pace in zip(chains, paces, strict=True)],
        "body": {
            "place": {
                "name": "object",
                "pos": numbers(*solid.position),
                "quat": numbers(*quaternion(solid.axes)),
            }.items(),
            "joints": [{"name": "object", "type": "free"}.items()],
            "inertial": _inertial(result).items(),
            "parts": [
                {**part, **OBJECT, "friction": "0 0 0", "rgba": "0.8 0.6 0.3 1"}.items() for part in geometry.parts
            ],
        },
        "meshes": geometry.meshes,
        "supports": [_support(support, length, geometry.edge).items() for support in scene.supports],
        "tendons": [(control, chain.bent_by(control)) for chain in chains for control in controls[chain.name]],
        "stops": (),
        "controls": [control for of in controls.values() for control in of],
        "holder": True,
        "sensed": [f"tip_{chain.name}" for chain in chains],
        "keyframes": _keyframes(result, chains, list(commands.values())),
    }
    damped = [chain.finger.damping.material / chain.finger.profile.own_stiffness for chain in chains]
    has_tendon_friction = any(chain.friction is not None for chain in chains)
    slow = any(damping > own for own, (_, damping) in zip(damped, paces, strict=True))
    differences = (
        f"contacts are MuJoCo's own, as stiff as the step of {step:g} s allows; fingers do not touch each other",
        f"hinges have inertia: {_ADDED:.1%} of a finger, or of {_OBJECT_SHARE:.0%} of the object, at its tip",
        *(
            ["tendon friction: each hinge gets the share of the tension that it has in the grasp"]
            if has_tendon_friction
            else ()
        ),
        *(["finger.damping.material: raised, so that a finger settles"] if slow else ()),
        *([geometry.difference] if geometry.difference else ()),
    )
    about = {"version": __version__, "hinges": hinges}
    explanation = fill("mjcf/hand.txt", {**about, "differences": "".join(f"Differs: {d}.\n" for d in differences)})
    frequency = min(float(chain.links.pulsations()[0][0]) for chain in chains) / (2.0 * np.pi)
    text = document(words, title_of(scene), explanation)
    return HandChain(text, hinges, frequency, step, differences, geometry.difference, commands)


def _support(support: Any, length: float, edge: float) -> dict[str, str]:
    """A plane, or a disc with a depth, that the object touches where it is nearer than the radius of its edges."""
    geom = {"name": f"support_{support.name}", **SUPPORT, "friction": numbers(support.friction, 0.0, 0.0)}
    geom |= {"zaxis": numbers(*support.normal), "rgba": "0.6 0.6 0.6 0.5"}
    geom |= {"margin": numbers(edge)} if edge > 0.0 else {}
    if not np.isfinite(support.radius):
        return {**geom, "type": "plane", "pos": numbers(*support.point), "size": f"{numbers(length, length)} 1"}
    deep = 0.05 * length
    place = np.array(support.point) - deep * np.array(support.normal)
    return {**geom, "type": "cylinder", "pos": numbers(*place), "size": numbers(support.radius, deep)}


def _inertial(result: Any) -> dict[str, str]:
    """Mass of the object, and its inertia about the center of mass."""
    solid = result.scene.object
    inertia = solid_inertia(result)
    order = (0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)
    return {
        "pos": numbers(*solid.local_com),
        "mass": numbers(solid.weighed),
        "fullinertia": numbers(*(inertia[pair] for pair in order)),
    }


def _keyframes(result: Any, chains: Sequence[HandFingerChain], commands: Sequence[float]) -> list[Any]:
    """The posture of the grasp with its commands, and straight fingers without."""
    solid = result.scene.object
    place = [float(v) for v in (*solid.position, *quaternion(solid.axes))]
    keys = []
    for name, share in (("grasp", 1.0), ("open", 0.0)):
        angles = np.concatenate([share * chain.in_order(chain.angles()) for chain in chains])
        control = [share * command for command in commands]
        keys.append({"name": name, "qpos": numbers(*angles, *place), "ctrl": numbers(*control)}.items())
    return keys


def _pace(chain: HandFingerChain, load: float) -> tuple[float, float]:
    """Inertia of each hinge [kg m2], and damping of the rod per its stiffness [s]."""
    profile = chain.finger.profile
    length = chain.finger.rod.length
    mass = max(float(chain.links.mass.sum()), _OBJECT_SHARE * load)
    stiffness = float(profile.bending_stiffness(0.0))
    own = chain.finger.damping.material / profile.own_stiffness
    pulsation = _FIRST_MODE * np.sqrt(stiffness / (mass * length**3))
    armature = _ADDED * mass * len(chain.bends) * length**2 / 3.0
    return armature, max(own, 2.0 * _DAMPED / pulsation)


def _controls(chain: HandFingerChain) -> list[Control]:
    """Actuators of a finger's tendons: tensions, or cable that locked drives have wound up."""
    controls = []
    wound = chain.wound
    for k, (side, tension, pull) in enumerate(
        zip(("left", "right"), chain.tensions.tolist(), chain.finger.pulls, strict=True)
    ):
        name = f"{chain.name}_{side}"
        if wound is None or not wound.law.locks:
            limits = (0.0, float(chain.setup.max_tension))
            controls.append(Control.of(name, tension, pull, lag=None, limits=limits))
            continue
        # A slack tendon is on the edge of being in tension.
        spring = wound.springs[k] or 1.0 / float(wound.compliances[k] + wound.law.servo)
        control = Control.of(name, tension / spring, pull, lag=None, cable=spring)
        controls.append(replace(control, value=control.value + float(chain.levers(control) @ chain.bends)))
    return controls


def _camera(center: Array, length: float) -> dict[str, str]:
    """A camera that looks at the hand from the side, and a little from above."""
    back = np.array([0.45, -0.85, 0.3])
    back = back / np.linalg.norm(back)
    right = np.cross([0.0, 0.0, 1.0], back)
    right = right / np.linalg.norm(right)
    axes = numbers(*right, *np.cross(back, right))
    return {"name": "hand", "pos": numbers(*(center + 3.0 * length * back)), "xyaxes": axes}


def _finger(chain: HandFingerChain, armature: float, damping: float, edge: float) -> list[dict[str, object]]:
    """Bodies of a finger: the clamped part, and the links, each inside the one before."""
    name, links, torsional = chain.name, chain.links, chain.torsional_friction
    found: list[dict[str, object]] = []
    for k in range(-1, len(links.at)):
        begin, end = links.span(k)
        long = end - begin
        radius = chain.radius(k)
        capsule = max(radius - edge, _THIN)
        touch = {"margin": numbers(radius - capsule + edge)} if edge > 0.0 else {}
        touch |= {"condim": "4"} if torsional > 0.0 else {}
        along = begin - links.span(k - 1)[0] if k > -1 else 0.0
        place = {"name": f"{name}_{k + 1}", "pos": numbers(0.0, along, 0.0)}
        if k < 0:
            place |= {"pos": numbers(*chain.frame.base), "quat": numbers(*quaternion(chain.frame.axes))}
        geom = {
            "name": f"{name}_{k + 1}",
            "type": "capsule",
            "size": numbers(capsule),
            "fromto": numbers(0.0, 0.0, 0.0, 0.0, long, 0.0),
            "friction": numbers(chain.setup.friction, torsional, 0.0),
            **touch,
            **FINGER,
        }
        joints = []
        if k >= 0:
            for kind, axis, stiffness in ((*_AXES[j], chain.stiffness[k, j]) for j in chain.order(k)):
                joint = {"name": f"{name}_{kind}_{k + 1}", "type": "hinge", "axis": axis}
                joint |= {"stiffness": numbers(stiffness), "damping": numbers(damping * stiffness)}
                joint |= {"armature": numbers(armature)}
                rest = {"springref": numbers(links.rest[k])} if kind == "bend" and links.rest[k] else {}
                joints.append({**joint, **rest}.items())
        found.append({
            "body": place.items(),
            "joints": joints,
            "inertial": link_inertial(links, k, radius, _LIGHT).items(),
            "geom": geom.items(),
            "sites": [("tip_" + name, long)] if k == len(links.at) - 1 else (),
        })  # fmt: skip
    return found
