"""Setpoints of missions, and fingers by hand that carry them out; from inside: phases go step by step, without a plant.

Setpoints of missions, what their phases change of a controller, and fingers by hand that carry them out.
"""

from __future__ import annotations

import math
from functools import lru_cache
from types import SimpleNamespace

import numpy as np

from continuum_grasp.addons.mission import Phases, PlantVariation
from continuum_grasp.addons.mission.from_grasp import assign
from continuum_grasp.addons.mission.lift import LiftCheck
from continuum_grasp.addons.mission.plan import PhasePlan
from continuum_grasp.addons.mission.plant import MissionPlant, Timetable
from continuum_grasp.addons.mission.run import MissionRunner
from continuum_grasp.addons.mission.scene import Slip
from continuum_grasp.control import Anomaly, Command, CommandStatus, Health, Sight, Trip
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene import load
from continuum_grasp.simulation import ContactHistory
from tests.rods import ROOT

MUG, PINCH, CUP, BLOCK = (ROOT / f"configs/mission/{name}.yaml" for name in ("mug", "pinch", "cup_lying", "turn_block"))
SHORT = "{approach: 0.4, squeeze: 0.6, lift: 0.2, hold: 0.3, pull: 0.16, rest: 0.06, lower: 0.2, release: 0.5}"
COARSE = "plant.fidelity={family: clothoid, elements: 3}"
QUICK = (COARSE, f"phases={SHORT}", "grasp.solver.effort=quick")
"""A short mission of coarse models."""


@lru_cache
def runner(name, *changes):
    """The short mission of a configuration."""
    # A chain of guides, which is the plant of mug_servo, has no elements.
    quick = QUICK[1:] if name == "mug_servo" else QUICK
    mission = load(ROOT / f"configs/mission/{name}.yaml", [*quick, *changes])
    return MissionRunner(assign(mission, optimize_grasp(mission.grasp)))


@lru_cache
def carried(name, *changes, shift=(0.0, 0.0)):
    """Its run in Python, on an object that stands elsewhere by ``shift`` [m]."""
    return runner(name, *changes).run(PlantVariation(shift=shift))


def straight_grasp(mission, *stations):
    """A grasp in name: its first finger straight, with contacts of 1 N at its tip and at ``stations`` [m]."""
    setup = mission.grasp.setups[0]
    finger = setup.finger
    line = np.linspace([0.0, 0.0, 0.0, 0.0], [finger.rod.length, finger.rod.length, 0.0, 0.0], 3)
    tensions = [tendon.max_tension for tendon in finger.tendon_list]
    posture = SimpleNamespace(base=np.array(finger.base.pose), tensions=tensions, backbone=line)
    contacts = [SimpleNamespace(name=f"{setup.name}.{k}", station=s, normal_force=1.0) for k, s in enumerate(stations)]
    contacts.append(SimpleNamespace(name=setup.tip_name, station=finger.rod.length, normal_force=1.0))
    pose = np.array(mission.grasp.object.pose)
    return SimpleNamespace(fingers={setup.name: posture}, contacts=contacts, object_pose=pose)


CERTIFIED, STEP = 4.0, 0.01  # N at each tip, s
STAGES = SimpleNamespace(
    r_names=("contact_force_finger.tip [N]",), weights=np.zeros(1), u_min=np.zeros(2), u_max=np.full(2, 75.0)
)
"""Of a controller of one of these tips."""


def planned(table, names, t):
    """Setpoints by names at instants of the plan."""
    count, limits = len(names), np.ones(len(table.of.held))
    stages = SimpleNamespace(r_names=tuple(names), weights=np.ones(count), u_min=-limits, u_max=limits)
    return PhasePlan(table, stages, np.zeros(0)).rows(np.asarray(t), of_plan=True)


def begun(table, stages, plant):
    """Weights and limits, by the phases that set them."""
    found, plan = {}, PhasePlan(table, stages, np.zeros(0))
    for k, phase in enumerate(plan.names):
        said = SimpleNamespace(change=lambda name=phase, **new: found.update({name: new}))
        plan.enter(0.0, said, plant, k)
    return found


def runner_of(file, changes, grasp):
    """A mission with a grasp that was found before."""
    return MissionRunner(assign(load(file, changes), grasp))


def plan_by_hand(*names):
    """The timetable of fingers by hand, before anything happens."""
    return Timetable(fingers(*names)[0])


def fingers(*names, slip=None, most=20.0, standing=0.0, gives=0.0):
    """Fingers by hand that touch with their tips, certified for 4 N each, of which half is needed.

    Their drives have a fifth more than the grasp takes; contacts may be pressed with ``most`` [N], and are by a share
    ``standing`` more from the lift on; the object sinks by ``gives`` [m] though nothing slips.
    """
    contacts = [
        SimpleNamespace(name=f"{n}.tip", normal_force=CERTIFIED, friction_force=0.0, lift=0.0, part=0) for n in names
    ]
    grasp = SimpleNamespace(contacts=contacts, scene=SimpleNamespace(friction=lambda name: 0.5))
    tendons = [SimpleNamespace(max_tension=75.0)] * 2
    finger = SimpleNamespace(
        input_keys=["tensions"], tendon_list=tendons, winches=(), inputs=[SimpleNamespace(label="")] * 2
    )
    control = SimpleNamespace(
        contact_names=("finger.tip",), contacts=(), finger=finger, controller=SimpleNamespace(step=STEP)
    )
    asked = SimpleNamespace(normal_force_max=lambda name: most)
    slips = None if slip is None else Slip.model_validate(slip)
    mission = SimpleNamespace(phases=Phases(lift_share=0.5), turn=None, more_contacts=(), slip=slips, grasp=asked)
    return [
        SimpleNamespace(
            name=name,
            grasp=grasp,
            control=control,
            mission=mission,
            middles=(),
            pulls=np.ones((2, 3)),
            **dict.fromkeys(("rest", "before"), np.zeros(2)),
            **dict.fromkeys(("bends", "posture"), np.zeros(0)),
            held=np.array([60.0, 1.5]),
            tight=np.array([72.0, 1.8]),
            reserve=0.2,
            holding=(np.array([51.0, -math.inf]), np.array([math.inf, 4.0])),
            contact="finger.tip",
            force=CERTIFIED,
            forces={"finger.tip": CERTIFIED},
            standing=standing,
            gives=gives,
            own_name=lambda own, name=name: own.replace("finger", name),
        )
        for name in names
    ]


def commanded(force, *, std=0.1, u=None, **seen):
    """What a controller commands that feels a force at its fingertip."""
    felt = SimpleNamespace(force=np.array([force]), std=np.array([std]))
    usual = {
        "trip": Trip.NONE,
        "anomaly": Anomaly(0),
        "health": Health.OK,
        "status": CommandStatus.SOLVED,
        "sight": Sight.SEES,
        "suspect": None,
        "mismatch": 1.0,
    }
    command = SimpleNamespace(contact_forces=felt, u=u, **usual | seen)
    command.doubt = Command.doubt.fget(command)  # in words as those of a real one
    return command


def carried_out(of, forces, *, height=lambda t: 0.0, seen=lambda t: {}, **commands):
    """Fingers by hand through all phases, with forces of their tips, the object's height, and what commands say,
    by instant.

    The check of the lift, the timetable, limits by phase of the first finger, and by instant the phase and the setpoint
    of each finger; all fingers are in one phase and end together.
    """
    check, limits, passed, wanted = LiftCheck(of), {}, [], {}
    plans = [check.schedule(k, STAGES) for k in range(len(of))]
    controller = SimpleNamespace(change=lambda u_min, u_max, **_: limits.update({plans[0].phase: (*u_min, *u_max)}))
    plant = SimpleNamespace(t=0.0, command=np.zeros(2), height=height(0.0))
    for plan in plans:
        plan.enter(0.0, controller, plant)
    for k in range(1, 1000):
        plant.t = t = k * STEP
        plant.height = height(t)
        felt = [commanded(force, **commands, **seen(t)) for force in forces(t)]
        going = [plan.advance(t, controller, plant, command) for plan, command in zip(plans, felt, strict=True)]
        assert len(set(going)) == 1
        if not going[0]:
            break
        assert len({plan.phase for plan in plans}) == 1
        passed.append((t, plans[0].phase))
        wanted[t] = [float(plan.rows(np.array([t]))[0, 0]) for plan in plans]
    return SimpleNamespace(
        check=check, table=check.timetable, limits=limits, passed=passed, wanted=wanted, events=list(plans[0].events)
    )


def pressed(names, normal, friction):
    """Forces of contacts (T, C), of which nothing else is asked."""
    zero, force = np.zeros_like(normal), np.stack([normal, friction], axis=1)  # normals along x
    return ContactHistory(names, zero, normal, friction, zero, force, np.zeros_like(force))


def fails(monkeypatch, since, until=np.inf, *, finger=None, spoilt=lambda y, last: np.full_like(y, np.nan)):
    """Sensors of a finger by name, or of all, fail from an instant on [s], as ``spoilt`` shows them."""
    begin, measure, last = MissionPlant.__init__, MissionPlant.measure, {}

    def named(plant, assignment, *rest):
        begin(plant, assignment, *rest)
        plant.finger_name = assignment.name

    def measured(plant):
        y = measure(plant)
        if not since <= plant.t + 1e-9 < until or finger not in (None, plant.finger_name):
            last[plant.finger_name] = y
            return y
        return spoilt(y, last[plant.finger_name])

    monkeypatch.setattr(MissionPlant, "__init__", named)
    monkeypatch.setattr(MissionPlant, "measure", measured)
