"""Grasps of hands in another program's plant: chains of hinges around a free object, in MuJoCo.

Run ``python -m benchmarks.hand_mujoco`` (3 min). Each finger is a chain of links with three hinges each (bending, to
the side, twist) under constant couples of its tendons, and starts as it was certified; the object is free. Hinges to
the side and of twist start where they balance the planned forces, found on the chain alone. Fingers are capsules with
the mass of the rod. Spheres and ellipsoids are those of MuJoCo; boxes and cylinders lack the radius of their edges,
which is added to the distance at which capsules, thinner by as much, touch: surface, normal and point of contact are
those of rounded edges. Where edges are as round as the finger is thick, contacts lie 0.05 mm off the surface.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import begun
from continuum_grasp.base import Array
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene import HandScene, load

LINKS = 24
STEP = 2e-4
"""Of MuJoCo [s]: a third of a radian of the fastest hinge."""
EVERY = 10
"""Steps after which the object is looked at."""
SECONDS = 2.0
LAST = 0.5
"""Seconds at the end, of which normal forces are the mean."""
ARMATURE = 1e-5
"""Of each hinge [kg m2], without which those of links of 0.1 g ring faster than a step; together they add 0.1 g to the
tip of 120 mm."""
LIGHT = 1e-9
"""Least mass of a link [kg], which MuJoCo wants."""
SETTLE = 0.01
"""Damping of the rod per its stiffness [s]: under the critical one of a finger, and no force at rest."""
THIN = 1e-4
"""Least radius of a capsule [m]."""
SHIPPED = ("ball", "box", "can", "egg", "lying_can")
SEARCH = {"effort": "quick", "max_total_iterations": 3000}
"""For random scenes, of which those that are not solved soon are passed over."""
CONFIGS = Path(__file__).parents[1] / "configs/hand"


def text(values: Any) -> str:
    """Numbers as MuJoCo reads them."""
    return " ".join(repr(float(value)) for value in np.ravel(values))


@dataclass(frozen=True)
class Held:
    """What became of a grasp.

    Attributes
    ----------
    moved, turned : float
        Greatest displacement of the object's center of mass [m] and turn [rad] since the start.
    planned, found : ndarray
        Normal force of each contact [N]: of the plan, and the mean at the end.
    aside : float
        Greatest difference of contacts' shifts to the side at the start between chain and plan [m].
    """

    moved: float
    turned: float
    planned: Array
    found: Array
    aside: float

    @property
    def off(self) -> float:
        """Greatest difference of a normal force, per the greatest planned one [1]."""
        return float(np.abs(self.found - self.planned).max() / self.planned.max())


class HandPlant:
    """A grasp in MuJoCo."""

    def __init__(self, grasp: Any) -> None:
        import mujoco

        self.mujoco, self.grasp, scene = mujoco, grasp, grasp.scene
        self.names = [setup.name for setup in scene.setups]
        self.model = mujoco.MjModel.from_xml_string(self._model_text(scene))
        self.data = mujoco.MjData(self.model)
        self.joints = {name: self._hinges(name) for name in self.names}
        self.owner = {self.model.geom(f"{name}_{k}").id: (name, k) for name in self.names for k in range(LINKS + 1)}
        self._start()

    def _model_text(self, scene: HandScene) -> str:
        solid: Any = scene.object
        radius = getattr(solid, "edge_radius", 0.0)
        friction = {setup.friction for setup in scene.setups}
        if len(friction) > 1:
            raise ValueError("fingers of one friction are known here")
        half = _half(solid)
        inertia = _inertia(solid)
        size = {
            "sphere": half[:1],
            "ellipsoid": half,
            "box": half - radius,
            "cylinder": half[[0, 2]] - radius,
        }[solid.shape]
        fingers = "".join(self._finger_text(scene, k, radius) for k in range(len(self.names)))
        return f"""
<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{STEP}" gravity="{text(scene.gravity)}" cone="elliptic" impratio="100" noslip_iterations="5"
    integrator="implicitfast" iterations="50" tolerance="1e-12"/>
  <size memory="20M"/>
  <default><geom condim="3" friction="{friction.pop()} 0 0" solref="{2 * STEP} 1" solimp="0.95 0.99 0.0001"/></default>
  <worldbody>
    <body name="object" pos="{text(solid.position)}" quat="{text(_quaternion(solid.axes))}">
      <freejoint name="object"/>
      <inertial pos="{text(solid.center_of_mass)}" mass="{solid.weighed}" diaginertia="{text(inertia)}"/>
      <geom name="object" type="{solid.shape}" size="{text(size)}" contype="1" conaffinity="0"/>
    </body>{fingers}
  </worldbody>
</mujoco>"""

    def _finger_text(self, scene: HandScene, index: int, edge: float) -> str:
        """A chain: hinges in the middle of pieces of the rod, of which each has the stiffness of a piece."""
        setup, frame = scene.setups[index], self.grasp.frames[index]
        base = scene.hand.named_bases[setup.name]
        section = (base.finger or scene.hand.finger).cross_section
        thick, length = setup.finger.thickness_radius, setup.finger.rod.length
        piece = length / LINKS
        stiffness = setup.stiffness / piece * np.array([1.0, section.lateral, section.torsion])
        capsule = max(thick - edge, THIN)
        density = float(setup.finger.profile.linear_density(np.array([0.0]))[0])
        axes = ("0 0 1", "1 0 0", "0 1 0")
        parts, closing = [], ""
        for k in range(LINKS + 1):
            begin = 0.0 if k == 0 else (k - 0.5) * piece
            end = min((k + 0.5) * piece, length)
            long = end - begin
            at = f'pos="{text(frame.base)}" quat="{text(_quaternion(frame.axes))}"'
            if k:
                before = 0.5 * piece if k == 1 else piece
                at = f'pos="0 {before} 0"'
            joints = "".join(
                f'<joint name="{setup.name}_{kind}_{k}" type="hinge" axis="{axis}" stiffness="{value}" '
                f'damping="{SETTLE * value}" armature="{ARMATURE}"/>'
                for kind, axis, value in zip(("bend", "side", "twist"), axes, stiffness, strict=True)
                if k
            )
            mass = max(density * long, LIGHT)
            across = mass * (long**2 / 12.0 + thick**2 / 4.0)
            parts.append(
                f'<body name="{setup.name}_{k}" {at}>{joints}<inertial pos="0 {0.5 * long} 0" mass="{mass}" '
                f'diaginertia="{across} {0.5 * mass * thick**2} {across}"/>'
                f'<geom name="{setup.name}_{k}" type="capsule" size="{capsule}" fromto="0 0 0 0 {long} 0" '
                f'margin="{thick - capsule + edge}" contype="0" conaffinity="1"/>'
            )
            closing += "</body>"
        return "".join(parts) + closing

    def _hinges(self, name: str) -> Array:
        """Addresses of a finger's hinges (LINKS, 3)."""
        kinds = ("bend", "side", "twist")
        rows = [[self.model.joint(f"{name}_{kind}_{k + 1}").qposadr[0] for kind in kinds] for k in range(LINKS)]
        return np.array(rows)

    def _start(self) -> None:
        """Fingers in their planes, then to the side as they balance the planned forces."""
        model, data, mj = self.model, self.data, self.mujoco
        self.couples = np.zeros(model.nv)
        shift = model.nv - model.nq  # of velocities to positions: the object comes first
        self.dofs = {name: at + shift for name, at in self.joints.items()}
        for setup in self.grasp.scene.setups:
            s, _, _, angle = self.grasp.arrays[f"{setup.name}.backbone"].T
            ends = np.interp(np.linspace(0.0, s[-1], LINKS + 1), s, angle)
            data.qpos[self.joints[setup.name][:, 0]] = np.diff(ends)
            (channel,) = setup.finger.channels
            pull = float(np.dot(channel.arms, self.grasp.arrays[f"{setup.name}.tensions"]))
            self.couples[self.dofs[setup.name][:, 0]] = pull
        contacts = self.grasp.contacts
        for _ in range(8):
            mj.mj_forward(model, data)
            torque = -data.qfrc_bias.copy()
            for contact in contacts:
                name, link = self._link(contact.name, contact.station)
                body = model.body(f"{name}_{link}").id
                mj.mj_applyFT(model, data, contact.force, np.zeros(3), contact.position, body, torque)
            for name in self.names:
                for kind in (1, 2):
                    at, dof = self.joints[name][:, kind], self.dofs[name][:, kind]
                    data.qpos[at] = torque[dof] / model.jnt_stiffness[model.dof_jntid[dof]]
        mj.mj_forward(model, data)
        self.aside = 0.0
        for contact in contacts:
            name, link = self._link(contact.name, contact.station)
            setup = self.grasp.scene.setups[self.names.index(name)]
            frame = self.grasp.frames[self.names.index(name)]
            body = data.body(f"{name}_{link}")
            begin = 0.0 if link == 0 else (link - 0.5) * setup.finger.rod.length / LINKS
            place = body.xpos + (contact.station - begin) * body.xmat.reshape(3, 3)[:, 1]
            off = float(frame.axes[:, 2] @ (place - frame.base)) - contact.deflection
            self.aside = max(self.aside, abs(off))

    def _link(self, name: str, station: float) -> tuple[str, int]:
        """Finger of a contact, and the link on which it is."""
        owner = name.rpartition(".")[0]
        setup = self.grasp.scene.setups[self.names.index(owner)]
        piece = setup.finger.rod.length / LINKS
        return owner, min(int(station / piece + 0.5), LINKS)

    def run(self, seconds: float = SECONDS) -> Held:
        """Let it go, at constant tensions."""
        model, data, mj = self.model, self.data, self.mujoco
        start, turn = data.body("object").xipos.copy(), data.body("object").xmat.reshape(3, 3).copy()
        steps, moved, turned = round(seconds / STEP), 0.0, 0.0
        sums, count = np.zeros(len(self.grasp.contacts)), 0
        data.qfrc_applied[:] = self.couples
        for k in range(0, steps, EVERY):
            mj.mj_step(model, data, nstep=EVERY)
            if not np.isfinite(data.qpos).all() or data.warning[mj.mjtWarning.mjWARN_BADQACC].number:
                raise FloatingPointError("the plant ran away")
            body = data.body("object")
            moved = max(moved, float(np.linalg.norm(body.xipos - start)))
            cosine = 0.5 * (float(np.sum(body.xmat.reshape(3, 3) * turn)) - 1.0)
            turned = max(turned, math.acos(min(max(cosine, -1.0), 1.0)))
            if k >= steps - round(LAST / STEP):
                sums, count = sums + self._forces(), count + 1
        planned = np.array([contact.normal_force for contact in self.grasp.contacts])
        return Held(moved, turned, planned, sums / max(count, 1), self.aside)

    def _forces(self) -> Array:
        """Normal force near each planned station [N]."""
        found, force = np.zeros(len(self.grasp.contacts)), np.zeros(6)
        for k, contact in enumerate(self.data.contact):
            self.mujoco.mj_contactForce(self.model, self.data, k, force)
            name, link = next(self.owner[g] for g in contact.geom if g in self.owner)
            setup = self.grasp.scene.setups[self.names.index(name)]
            at = link * setup.finger.rod.length / LINKS
            near = [
                (abs(c.station - at), i) for i, c in enumerate(self.grasp.contacts) if c.name.rpartition(".")[0] == name
            ]
            if near:
                found[min(near)[1]] += force[0]
        return found


def _half(solid: Any) -> Array:
    if solid.shape == "cylinder":
        return 0.5 * np.array([solid.diameter, solid.diameter, solid.height])
    return 0.5 * np.array([solid.diameter] * 3 if solid.shape == "sphere" else solid.extents)


def _inertia(solid: Any) -> Array:
    """Of the shape with sharp edges, homogeneous [kg m2]: at rest it does not matter."""
    squares = _half(solid) ** 2
    across = squares.sum() - squares
    if solid.shape == "cylinder":
        r, h = squares[0], squares[2]
        return np.asarray(solid.weighed * np.array([r / 4 + h / 3, r / 4 + h / 3, r / 2]))
    return np.asarray(solid.weighed * across / (3.0 if solid.shape == "box" else 5.0))


def _quaternion(axes: Array) -> Array:
    import mujoco

    found = np.zeros(4)
    mujoco.mju_mat2Quat(found, np.ascontiguousarray(axes).ravel())
    return found


def drawn(seed: int) -> Iterator[tuple[str, HandScene]]:
    """Random scenes without end: shapes in turn, three and four fingers in turn, off the axis, turned, 50 to 150 g."""
    rng = np.random.default_rng(seed)
    base = load(CONFIGS / "ball.yaml")
    kinds = ("sphere", "ellipsoid", "standing", "box", "lying")
    for number in itertools.count(1):
        kind = kinds[(number - 1) % len(kinds)]
        count = 4 if kind == "lying" else 3 + number % 2
        x, y = rng.uniform(-4e-3, 4e-3, 2)
        size, turn = rng.uniform(0.05, 0.065, 3), rng.uniform(-0.2, 0.2, 3)
        body: dict[str, Any] = {"mass": float(rng.uniform(0.05, 0.15))}
        body |= {"position": [float(x), float(y), float(-rng.uniform(0.085, 0.1))]}
        if kind == "sphere":
            body |= {"shape": "sphere", "diameter": float(size[0])}
        elif kind == "ellipsoid":
            body |= {"shape": "ellipsoid", "extents": size.tolist(), "rotation": turn.tolist()}
        elif kind == "box":
            extents = [float(size[0]), float(size[0]), 0.08]
            body |= {"shape": "box", "extents": extents, "edge_radius": 5e-3, "rotation": [0.0, 0.0, float(turn[0])]}
        else:
            body |= {"shape": "cylinder", "diameter": float(size[0]), "height": 0.1, "edge_radius": 4e-3}
            body |= {"rotation": [0.5 * math.pi, 0.0, 0.0] if kind == "lying" else [0.0, 0.0, 0.0]}
        ring = {"count": count, "radius": float(rng.uniform(0.042, 0.055))}
        changes = {"object": body, "hand.ring": ring, "name": f"{kind}, {count} fingers", "solver": SEARCH}
        scene = base.changed(changes)
        yield f"{number}: {kind}, {count} fingers", scene


def main() -> None:
    """Run the shipped hands, random ones, and a can between round fingers."""
    asked, report = begun(__doc__, "hand_mujoco", seeds=(11, "random grasps"), seed=0)
    columns = ["grasp", "contacts", "least eigenvalue [E I / L]", "moved [mm]", "turned [deg]"]
    columns += ["normal forces planned [N]", "found [N]", "off [% of the greatest]", "shift to the side off [mm]"]
    stable = report.table(
        "Certified as stable", columns, note=f"Of {SECONDS:g} s; forces: mean of the last {LAST:g} s."
    )
    print(*columns, sep=" | ")

    def add(table: Any, name: str, grasp: Any) -> Held:
        held = HandPlant(grasp).run()
        kinds = " ".join(contact.name.rpartition(".")[2] for contact in grasp.contacts)
        forces = [" ".join(f"{force:.3f}" for force in forces) for forces in (held.planned, held.found)]
        moved = 1e3 * held.moved, math.degrees(held.turned)
        eigenvalue = float(grasp.certificate.stability.eigenvalue)
        table.add(name, kinds, eigenvalue, *moved, *forces, 100.0 * held.off, 1e3 * held.aside)
        return held

    runs = [add(stable, name, optimize_grasp(CONFIGS / f"{name}.yaml")) for name in SHIPPED]
    passed: list[str] = []
    for name, scene in drawn(asked.seed):
        if len(runs) >= len(SHIPPED) + asked.seeds:
            break
        grasp = optimize_grasp(scene, raise_on_failure=False)
        if not grasp.solved:
            passed.append(f"{name} ({grasp.status.value})")
            print(passed[-1], flush=True)
            continue
        runs.append(add(stable, name, grasp))
    report.claim("stable grasps: greatest displacement [mm]", 1e3 * max(one.moved for one in runs), "<=", 1.0)
    report.claim("stable grasps: greatest turn [deg]", math.degrees(max(one.turned for one in runs)), "<=", 1.0)
    report.claim("stable grasps: greatest error of a normal force [1]", max(one.off for one in runs), "<=", 0.05)
    if passed:
        stable.note += f" Drawn, and no stable grasp found: {', '.join(passed)}."
    loose = report.table("Round fingers, stability: ignore", columns)
    for name in ("can", "egg", "ball"):
        changes = {"hand.finger.section": {"shape": "round"}, "stability": "ignore"}
        grasp = optimize_grasp(load(CONFIGS / f"{name}.yaml").changed(changes), raise_on_failure=False)
        if not grasp.solved:
            report.missing.append(f"{name} with round fingers: {grasp.message}")
            continue
        held = add(loose, f"{name}: {grasp.certificate.stability.word}, {grasp.certificate.stability.motion}", grasp)
        if not grasp.certificate.stability.eigenvalue > 0.0:
            report.claim(f"{name} with round fingers, unstable: turn [deg]", math.degrees(held.turned), ">=", 5.0)
    report.finish()


if __name__ == "__main__":
    main()
