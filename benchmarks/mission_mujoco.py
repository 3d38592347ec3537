"""A mission's controller on another program's plant: a chain of hinges with the object, in MuJoCo.

Run ``python -m benchmarks.mission_mujoco configs/mission/mug.yaml --plants 20`` with the interpreter that has MuJoCo
named in ``CONTINUUM_GRASP_PEERS_PYTHON``. The chain is what ``export_mjcf`` writes of the mission's plant; the plants
are those of its ``trials``. Added to it: the object slides out of the plane under its weight, on a table that sinks;
pads on springs as stiff as ``contact_law`` says, at the middle contact if there is one, the tip and under walls, where
contacts of MuJoCo are rigid. Contact, friction, integration, tendons and drives (of first order) are MuJoCo's own.
Friction of the plant's tendons is left out, which MuJoCo does not have; that of the table has a limit for each
coordinate, and is no ellipsoid. Readings are late and noisy as the mission says.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from benchmarks.baselines import Peer
from benchmarks.report import Table as ReportTable
from benchmarks.report import arguments
from continuum_grasp.addons.chains.text import numbers
from continuum_grasp.addons.chains.write import export_mjcf
from continuum_grasp.addons.mission import MissionScene, PlantVariation
from continuum_grasp.addons.mission.assignment import Assignment
from continuum_grasp.addons.mission.budget import plant_mass
from continuum_grasp.addons.mission.causes import FALLEN
from continuum_grasp.addons.mission.from_grasp import assign
from continuum_grasp.addons.mission.lift import LiftCheck
from continuum_grasp.addons.mission.plant import Timetable
from continuum_grasp.addons.mission.run import variations
from continuum_grasp.base import Array, InputError
from continuum_grasp.closed_loop import PlantModel
from continuum_grasp.control import Controller
from continuum_grasp.control.quantities import OBJECT_POSE
from continuum_grasp.scene import Box, Scene, Table, load

HINGES = 24
STEP = 5e-5
"""Of MuJoCo [s]: a pad of half a gram on its spring turns by 0.1 rad in it."""
PAD_MASS = 5e-4
"""Of the face of a pad [kg]."""


def scene_of_plant(of: Assignment, variation: PlantVariation) -> Scene:
    """The plant's finger and surroundings, as a mission has them, without friction in the tendons."""
    mission, control = of.mission, of.control
    own = mission.plant.replaced(
        stiffness=mission.plant.stiffness if variation.stiffness is None else variation.stiffness,
        damping=mission.plant.damping if variation.damping is None else variation.damping,
        tendon_friction=None,
    )
    body = control.object
    x, y = np.array(body.position) + np.array(variation.shift)
    law = mission.contact_law.replaced(friction=mission.contact_law.friction * variation.friction)
    return PlantModel.plant_scene(control.replaced(plant=own)).replaced(
        contacts=control.contacts,
        object=body.replaced(mass=plant_mass(of.mission, variation), position=(float(x), float(y))),
        object_moves=True,
        supports=mission.grasp.supports,
        contact_law=law,
        out_of_plane_gravity=mission.gravity,
        table=Table(
            friction=mission.table_friction * variation.friction, friction_radius=mission.table_friction_radius
        ),
    )


def with_pads(text: str, scene: Scene) -> str:
    """The exported chain with weight out of the plane, and with compliant pads where the mission has contacts."""
    root = ET.fromstring(text)
    law, profile, world = scene.contact_law, scene.finger.profile, root.find("worldbody")
    option, body = root.find("option"), root.find(".//body[@name='object']")
    option.attrib |= {"timestep": numbers(STEP), "gravity": numbers(0.0, 0.0, -scene.out_of_plane_gravity)}
    option.attrib |= {"impratio": "100", "noslip_iterations": "5"}
    root.find("default/geom").set("solref", f"{numbers(4.0 * STEP)} 1")
    ET.SubElement(body, "joint", name="object_z", type="slide", axis="0 0 1")
    if isinstance(scene.object, Box):
        _as_box(root, body, scene.object)
    for geom in body.findall("geom"):
        if geom.get("type") not in ("sphere", "box", "cylinder"):
            raise InputError("only boxes and round objects are known here", key="grasp.object")
        if geom.get("type") == "sphere":
            geom.attrib |= {"type": "cylinder", "size": f"{geom.get('size')} {numbers(0.2)}"}
    slippery = {"contype": "0", "conaffinity": "0"}
    for link in world.iter("body"):
        for geom in link.findall("geom") if link.get("name") != "object" else []:
            geom.attrib |= slippery
    spring = {"stiffness": numbers(law.stiffness), "damping": numbers(2.0 * math.sqrt(law.stiffness * PAD_MASS))}
    touch = {"contype": "1", "conaffinity": "0", "friction": numbers(law.friction, 0.0, 0.0)}
    for name, at in (*[("middle", at) for at in scene.contacts], ("tip", profile.length)):
        link, begin = _link_at(world, at)
        pad = ET.SubElement(link, "body", name=f"pad_{name}", pos=numbers(0.0, at - begin, 0.0))
        ET.SubElement(pad, "joint", name=f"pad_{name}", type="slide", axis="1 0 0", **spring)
        ET.SubElement(pad, "inertial", pos="0 0 0", mass=numbers(PAD_MASS), diaginertia="1e-8 1e-8 1e-8")
        ET.SubElement(pad, "geom", type="sphere", size=numbers(float(profile.half_thickness(at))), **touch)
    for wall in scene.walls:
        world.remove(world.find(f"geom[@name='support_{wall.name}']"))
        (x, y), (nx, ny) = wall.point, wall.normal
        own = law.friction if wall.friction is None else wall.friction
        pad = ET.SubElement(world, "body", name=f"pad_{wall.name}", pos=numbers(x, y, 0.0))
        ET.SubElement(pad, "joint", name=f"pad_{wall.name}", type="slide", axis=numbers(-nx, -ny, 0.0), **spring)
        ET.SubElement(pad, "inertial", pos="0 0 0", mass=numbers(PAD_MASS), diaginertia="1e-6 1e-6 1e-6")
        face = {"pos": numbers(-0.1 * nx, -0.1 * ny, 0.0), "euler": numbers(0.0, 0.0, wall.normal_angle)}
        grip = {"contype": "0", "conaffinity": "2", "friction": numbers(own, 0.0, 0.0)}
        ET.SubElement(pad, "geom", type="box", size=numbers(0.1, 0.1, 0.2), **face, **grip)
    zeros = numbers(*[0.0] * sum(1 for _ in world.iter("joint")))  # the keyframe's are those before
    root.find("keyframe/key").attrib |= {"qpos": zeros, "qvel": zeros}
    return ET.tostring(root, encoding="unicode")


def _as_box(root: ET.Element, body: ET.Element, box: Box) -> None:
    """Two boxes and four rounds in place of the prism over a box's outline, which would touch a face at one point."""
    (old,) = body.findall("geom")
    root.remove(root.find("asset"))
    body.remove(old)
    given = {name: str(old.get(name)) for name in ("contype", "conaffinity", "friction")}
    w, h, r = 0.5 * box.width, 0.5 * box.height, box.corner_radius
    turn = np.array([[math.cos(box.angle), -math.sin(box.angle)], [math.sin(box.angle), math.cos(box.angle)]])
    # The body's origin is its center of mass.
    center, euler = turn @ -np.array(box.com), numbers(0.0, 0.0, box.angle)
    for half in ((w, h - r), (w - r, h)):
        at = {"pos": numbers(*center, 0.0), "euler": euler}
        ET.SubElement(body, "geom", type="box", size=numbers(*half, 0.2), **at, **given)
    for x, y in ((i * (w - r), j * (h - r)) for i in (-1, 1) for j in (-1, 1)):
        at = {"pos": numbers(*(center + turn @ np.array([x, y])), 0.0)}
        ET.SubElement(body, "geom", type="cylinder", size=numbers(r, 0.2), **at, **given)


def _link_at(world: ET.Element, at: float) -> tuple[ET.Element, float]:
    """The link of a place along the chain, and where it begins [m]."""
    found, begin = world.find(".//body[@name='base']"), 0.0
    while links := [one for one in found.findall("body") if one.get("name").startswith("link_")]:
        end = begin + float(links[0].get("pos").split()[1])
        if end > at:
            break
        found, begin = links[0], end
    return found, begin


def carry_out(of: Assignment, control: Controller, peer: Peer, variation: PlantVariation) -> dict[str, Any]:
    """The mission on one plant: what became of the object, read off MuJoCo."""
    check, scene = LiftCheck([of]), scene_of_plant(of, variation)
    chain = export_mjcf(scene, hinges=HINGES)
    mission, period = of.mission, control.period
    weight = plant_mass(of.mission, variation) * mission.gravity
    of_table = scene.table or Table(friction=0.0)
    known = {"weight": weight, "friction": of_table.friction, "stiffness": mission.contact_law.stiffness}
    known |= {"friction_radius": of_table.friction_radius}
    reading = peer.ask(xml=with_pads(chain.text, scene), table=known)
    plan, outside = check.schedule(0, control.stages), check.timetable.outside()
    names = ("object_force_x [N]", "object_force_y [N]", "object_moment [N m]")
    rng = np.random.default_rng(variation.seed)
    sensors = _Sensors(of, chain.text, scene)
    control.reset(u=of.rest)
    plant = SimpleNamespace(command=of.rest, height=reading["pose"][3])
    t, ahead = 0.0, control.stages.stage * np.arange(control.stages.stages + 1)
    late = [sensors.read(reading)] * (1 + round(mission.estimator.delay / period))
    plan.enter(t, control, plant)
    rows = []
    while True:
        late = [*late[1:], sensors.read(reading)]
        command = control.step(late[0] + sensors.std * rng.standard_normal(sensors.std.size), plan.rows(t + ahead))
        plant.command = command.u
        ends = np.array([t, t + period])
        reading = peer.ask(
            u=np.asarray(command.u).tolist(),
            period=period,
            height=outside["table_height [m]"](ends).tolist(),
            wrench=np.stack([outside[name](ends) for name in names], axis=1).tolist(),
        )
        t, plant.height = t + period, reading["pose"][3]
        rows.append((t, *reading["pose"], *reading["pads"].values(), command.status.name.lower()))
        if not reading["finite"] or not plan.advance(t, control, plant, command):
            break
    found = _judged(of, check.timetable, rows, list(reading["pads"]))
    return found | {"held": found["held"] and check.refused is None}


class _Sensors:
    """What a mission measures, from what MuJoCo answers."""

    def __init__(self, of: Assignment, text: str, scene: Scene) -> None:
        measured, root = of.control.estimator.measured, ET.fromstring(text)
        if measured.tip is None or measured.tension is None or measured.bending is None:
            raise InputError("tip, tensions and bending are measured here", key="estimator.measured")
        self._base, self._at = scene.finger.base.angle, np.array(measured.bending.at)
        links = [one for one in root.iter("body") if str(one.get("name")).startswith("link_")]
        hinges = np.cumsum([float(str(one.get("pos")).split()[1]) for one in links])
        # A hinge stands for the rod from the middle between it and the one before to that of the next.
        self._edges = np.concatenate([[0.0], 0.5 * (hinges[1:] + hinges[:-1]), [scene.finger.rod.length]])
        ys = ["tip_x [m]", "tip_y [m]", *[f"tension_{k + 1} [N]" for k in range(len(of.rest))]]
        ys += [f"angle_{k + 1} [rad]" for k in range(len(self._at))]
        # Joints of the object count from where it stands first.
        self._start = None if measured.object is None or scene.object is None else np.array(scene.object.pose)
        ys += OBJECT_POSE if self._start is not None else ()
        self.std = of.mission.plant.noise * np.array([of.control.measurement_std(name) for name in ys])

    def read(self, answer: dict[str, Any]) -> Array:
        """Tip, tensions, angles, and what a camera sees of the object."""
        turned = np.interp(self._at, self._edges, np.concatenate([[0.0], np.cumsum(answer["angles"])]))
        pose = () if self._start is None else self._start + answer["pose"][:3]
        return np.array([*answer["tip"], *answer["pulls"], *(self._base + turned), *pose])


def _judged(of: Assignment, table: Timetable, rows: list[tuple[Any, ...]], pads: list[str]) -> dict[str, Any]:
    """Verdict by the same limits as a mission's own."""
    words = [row[-1] for row in rows]
    values = np.array([row[:-1] for row in rows], dtype=float)
    t, pose, forces = values[:, 0], values[:, 1:5], np.abs(values[:, 5:])
    lift, hold, lower = (table.span(name) for name in ("lift", "hold", "lower"))
    carried = (t >= lift.start) & (t <= lower.start)
    still = (t >= 0.5 * (hold.start + hold.end)) & (t <= hold.end)
    sunk = float(np.max(pose[carried][:1, 3] - pose[carried][:, 3], initial=0.0))
    held = forces[:, pads.index("tip" if of.contact == "finger.tip" else "middle")]
    turn, found = of.mission.turn, {}
    if turn is not None:
        left = table.span(f"leave {table.strokes[-1]}").end
        errors = [float(pose[min(int(np.searchsorted(t, at)), len(t) - 1), 2]) - turn.angle for at in (left, t[-1])]
        found = {"turn_error": errors[0], "turned": max(map(abs, errors)) <= turn.tolerance}
    return {
        **found,
        "held": bool(t[-1] >= lower.start and sunk < FALLEN),
        "released": bool(forces[-1, [k for k, name in enumerate(pads) if name in ("middle", "tip")]].max() < 0.05),
        "sunk": sunk,
        "moved": float(np.linalg.norm(pose[carried, :2] - pose[carried][:1, :2], axis=1).max(initial=0.0)),
        "force": float(held[still].mean() / of.force - 1.0) if still.any() else math.nan,
        "fallbacks": sum(word in ("previous_plan", "safe_ramp") for word in words),
    }


def main() -> None:
    """Run the plants of a mission's trials."""
    asked = arguments(__doc__, mission=(..., "file"), plants=20, set=([str], "changes, as of --set"))
    mission = load(asked.mission, asked.set)
    if not isinstance(mission, MissionScene) or mission.gravity == 0.0:
        raise InputError("expected a mission with its weight out of the plane", file=asked.mission)
    of, *others = assign(mission)
    if others or len(of.middles) > 1:
        raise InputError(
            "one finger with one middle contact at most is known here", file=asked.mission, key="grasp.contacts"
        )
    control, peer = Controller(of.control, deadline=math.inf), Peer("mujoco_mission.py")
    drawn = variations(mission.trials.replaced(count=asked.plants))
    columns = ["plant", "", "", "turned off [deg]", "sunk [mm]", "moved [mm]", "force off [%]", "fallbacks"]
    table, good = ReportTable(asked.mission, columns), 0
    print(*columns, sep=" | ")
    for k, variation in enumerate(drawn):
        found = carry_out(of, control, peer, variation)
        good += found["held"] and found["released"] and found.get("turned", True)
        words = "held" if found["held"] else "dropped", "released" if found["released"] else "not released"
        turned = math.degrees(found["turn_error"]) if "turn_error" in found else ""
        moved = 1e3 * found["sunk"], 1e3 * found["moved"]
        table.add(k + 1, *words, turned, *moved, 100.0 * found["force"], found["fallbacks"])
    done = "held and released" if mission.turn is None else "turned, held and released"
    print(f"{good} of {len(drawn)} plants {done} the object")
    peer.close()


if __name__ == "__main__":
    main()
