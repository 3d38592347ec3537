"""A mission that was carried out: numbers, files, pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from types import SimpleNamespace
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from continuum_grasp.addons.mission.lift import Doubted, NotLifted, Slipped
from continuum_grasp.addons.mission.on_pads import reserved
from continuum_grasp.addons.mission.plan import PhasePlan
from continuum_grasp.addons.mission.plant import Span
from continuum_grasp.addons.mission.precheck import Exceeded, exceeded
from continuum_grasp.addons.mission.record import MissionRecord
from continuum_grasp.addons.mission.verdict import MissionVerdict, force_estimate, judge
from continuum_grasp.base import Array, InputError, amount_text
from continuum_grasp.closed_loop import ControlRun, PlantModel, SharedModel
from continuum_grasp.control import Stages
from continuum_grasp.results import (
    Dimension,
    File,
    MotionResult,
    Picture,
    Result,
    Stored,
)
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import ContactHistory

_LONGEST = 24
"""Letters of a finger's name in the names of supports that stand for it, which have 31 at most [1]."""
_HEAD = """\
# How a mission went: the verdict, why the object was dropped if it was, what was asked beyond the certificate.
# SI units; result.npz holds all arrays, meta.json the configuration too.
"""


@dataclass(frozen=True)
class MissionRun(MissionRecord, MotionResult):
    """A finished mission; the closed loop of each finger is stored in a folder of its name."""

    kind: ClassVar[str] = "mpc"
    stored: ClassVar[tuple[Stored, ...]] = (
        Stored("t", "(time,)", "s", "instants at which commands were given, and the end"),
        Stored("object_pose", "(time, pose)", "", "pose of the object: x, y [m], angle [rad], height [m]"),
        *ContactHistory.stored,
        Stored(
            "force_estimate", "(period, held)", "N", "normal force of each held contact as its controller estimated it"
        ),
        Stored("force_std", "(period, held)", "N", "standard deviation of that estimate"),
        Stored("friction_use", "(time, contact)", "1", "share of the friction cone that each contact uses"),
        Stored("pulls", "(pull, wrench)", "", "wrench of each pull: x, y [N], moment [N m]", "wrenches"),
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Dimension.TIME,
        Dimension("period", "instants at which commands were given", "command_times", "s"),
        Dimension.POSE,
        Dimension.XY,
        ContactHistory.dimension,
        Dimension("held", "of each finger, the held contact that presses hardest", "held_forces"),
        Dimension("pull", "pulls, in order", "pulls"),
        Dimension("wrench", "of a pull, about the center of mass", ("x [N]", "y [N]", "moment [N m]")),
    )
    texts: ClassVar[tuple[File, ...]] = (
        File("report.txt", "continuum_grasp.addons.mission.result:MissionRun.report"),
        File("result.yaml", "continuum_grasp.addons.mission.result:MissionRun.yaml"),
    )
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("snapshots", "continuum_grasp.addons.mission.pictures:plot_mission_snapshots", panels=True),
        Picture("timeline", "continuum_grasp.addons.mission.pictures:plot_mission_timeline", panels=True),
    )
    frames: ClassVar[str] = "continuum_grasp.addons.mission.pictures:mission_frames"
    page: ClassVar[str] = "loop"
    fps: ClassVar[float] = 25.0

    scenes: tuple[Scene, ...] = field(repr=False)
    """Each finger of the plant, with object and supports."""
    refused: NotLifted | None
    slipped: Slipped | None
    doubted: Doubted | None

    @cached_property
    def verdict(self) -> MissionVerdict:
        """Verdict on the mission."""
        return judge(self, self.refused, self.slipped, self.doubted)

    @cached_property
    def exceeded(self) -> tuple[Exceeded, ...]:
        """Numbers that the mission asked beyond its certificate, as said before the run."""
        return exceeded(self.assignments, self.variation)

    @property
    def name(self) -> str | None:
        """Name of the mission."""
        return self.mission.name

    @property
    def outcome(self) -> str:
        """Outcome for the object."""
        return self.verdict.word

    @property
    def scene(self) -> Scene:
        """The first finger of the plant, with object and supports."""
        return self.scenes[0]

    @property
    def simulated(self) -> Scene:
        """Scene of a simulation of the recorded commands on the plant of the mission, without its ``variation``.

        The table sinks and rises, and what pulls does, as in the mission. Of several fingers the first one is
        simulated; the others are supports, a disc at each of their contacts, that move as recorded.
        """
        plant = self.runs[0].simulated_on(self.scene)
        outside = self.timetable.outside()
        pulls = np.transpose([outside[name](self.t) for name in PlantModel.WRENCH])
        height = outside["table_height [m]"](self.t)
        times = tuple(self.t.tolist())
        force = {"times": times, "values": tuple(map(tuple, pulls[:, :2].tolist()))}
        moment = {"times": times, "values": tuple(pulls[:, 2].tolist())}
        supports, motion = self._others()
        return plant.replaced(
            object_load={"force": force, "moment": moment} if pulls.any() else None,
            table_height={"times": times, "values": tuple(height.tolist())},
            supports={**plant.supports, **supports},
            support_motion=motion,
        )

    def _others(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Contacts of all fingers but the first as supports, and their motion, by ``FINGER_1``, ``FINGER_tip``."""
        supports = dict[str, Any]()
        motion = dict[str, Any]()
        if self.run is not None:
            return supports, motion
        # The plants are moved again from each recorded state: between the instants of a record, pressed contacts move
        # by more than smooth curves through these are near.
        plants = [run.readings.plant for run in self.runs]
        joint = SharedModel(plants)
        lead = self.runs[0]
        substeps = int(lead.statistics["plant_substeps"])
        moved = joint.integration(str(lead.statistics["plant_method"])).advance
        begins = joint.joined([run.x for run in self.runs])
        inputs = np.hstack([run.u for run in self.runs])
        # 10: instants per period at which motions are sampled
        chosen = np.unique(np.linspace(0, substeps, 10 + 1).astype(int))[1:]
        states = [moved(x, u, t, lead.period, substeps) for x, u, t in zip(begins, inputs, self.t, strict=False)]
        rows = np.vstack([begins[:1], *(each[chosen] for each in states)])
        times = np.append(self.t[:1], (self.t[:-1, None] + lead.period / substeps * chosen).ravel())
        parts = joint.parts(rows)
        for assignment, run, x in [*zip(self.assignments, self.runs, parts, strict=True)][1:]:
            u = np.vstack([run.u[:1], np.repeat(run.u, len(chosen), axis=0)])
            plant = run.readings.plant
            scene = plant.scene
            places = (*scene.contacts, scene.finger.rod.length)
            where, angle = plant.sections(places)
            at = plant.function("contacts", rows=ca.vertcat(ca.vec(where), angle))
            found = np.array(at.map(len(x))(x.T, u.T, plant.forces(times).T)).T
            for k, place in enumerate(places):
                name = f"{assignment.name[:_LONGEST]}_{k + 1 if k < len(scene.contacts) else 'tip'}"
                # Supports of the plant may have such names.
                while name in self.scene.supports or name in supports:
                    name += "_"
                points = found[:, 2 * k : 2 * k + 2]
                turn = found[:, 2 * len(places) + k]
                radius = float(scene.finger.profile.half_thickness(place))
                supports[name] = {"type": "point", "position": points[0].tolist(), "radius": radius}
                shift = {"times": times.tolist(), "values": (points - points[0]).tolist()}
                motion[name] = {"shift": shift, "turn": {"times": times.tolist(), "values": (turn - turn[0]).tolist()}}
        return supports, motion

    @property
    def run(self) -> ControlRun | None:
        """The closed loop of the only finger; None where there are several."""
        return self.runs[0] if len(self.runs) == 1 else None

    @property
    def fingers(self) -> dict[str, ControlRun]:
        """The closed loops by the fingers' names."""
        return {assignment.name: run for assignment, run in zip(self.assignments, self.runs, strict=True)}

    @property
    def status(self) -> str:
        """``stopped`` before its end, or the status of the verdict."""
        return "stopped" if self.runs[0].ended == "stopped" else self.verdict.status

    @property
    def statistics(self) -> Mapping[str, Any]:
        """Statistics of the closed loops by the fingers' names."""
        return {name: run.statistics for name, run in self.fingers.items()}

    def pairs(self) -> dict[str, str]:
        """Time, and the verdict in numbers."""
        return {"time": f"{self.t[-1]:g} s", **self.verdict.pairs()}

    @property
    def command_times(self) -> Array:
        """Instants (K,) at which commands were given [s]."""
        return self.runs[0].command_times

    @property
    def held_forces(self) -> dict[str, tuple[Array, Array, Array]]:
        """Normal force of each finger's held contact that presses hardest, by name: setpoint (K + 1,), estimate (K,)
        and the estimate's standard deviation (K,) [N].
        """
        forces = {}
        for assignment, run in zip(self.assignments, self.runs, strict=True):
            wanted = run.r[:, run.r_names.index(f"contact_force_{assignment.contact} [N]")]
            forces[assignment.own_name(assignment.contact)] = (wanted, *force_estimate(assignment, run))
        return forces

    @property
    def force_estimate(self) -> Array:
        """Estimates of these forces (K, fingers) [N]."""
        return np.stack([estimate for _, estimate, _ in self.held_forces.values()], axis=1)

    @property
    def force_std(self) -> Array:
        """Standard deviations of these estimates (K, fingers) [N]."""
        return np.stack([std for *_, std in self.held_forces.values()], axis=1)

    @property
    def spans(self) -> tuple[Span, ...]:
        """The phases with their times."""
        return self.timetable.spans

    @property
    def pulls(self) -> dict[str, Array]:
        """Wrench (3) of each phase that pulls: world force x, y [N] and moment about the center of mass [N m]."""
        return {f"pull {k + 1}": wrench for k, wrench in enumerate(self.wrenches)}

    @property
    def wrenches(self) -> Array:
        """Wrenches as rows (K, 3)."""
        return self.assignments[0].pulls

    @cached_property
    def _page(self) -> Any:
        if self.run is None:
            raise InputError(f"a page shows one finger, not {len(self.runs)}: use animate")
        if self.variation.friction_fall:
            raise InputError("a page has constant friction, and this mission's friction drops in the hold: use animate")
        return self._page_maker()(self.run, self.controller_changes)

    def controller_changes(self, stages: Stages) -> list[dict[str, Any]]:
        """Changes by phases to the controller of the only finger, whose problem is given: from instants ``t`` [s] on
        ``weights`` of setpoints and limits ``low`` and ``high`` of the input.
        """
        run = self.runs[0]
        changes = list[dict[str, Any]]()
        plan = PhasePlan(self.timetable, stages, np.zeros(0))
        for span in self.spans:

            def note(*, weights: Array, u_min: Array, u_max: Array, start: float = span.start) -> None:
                changes.append({"t": start, "weights": weights, "low": u_min, "high": u_max})

            # The command before the phase, by which limits are moved.
            before = run.u[min(max(int(np.searchsorted(run.t, span.start)) - 1, 0), len(run.u) - 1)]
            number = plan.names.index(span.name)
            plan.enter(span.start, SimpleNamespace(change=note), SimpleNamespace(command=before), number)
        return changes

    @cached_property
    def friction_use(self) -> Array:
        """Share of the friction cone (K + 1, contacts) that each contact uses [1]; NaN for the table and in the air."""
        limits = self.friction * self.contacts.normal_force
        # Contacts without a limit bear nothing, or are the table, whose friction is of another kind.
        use: Array = np.divide(self.contacts.shear, limits, out=np.full_like(limits, np.nan), where=limits > 0.0)
        return use

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Warnings: of numbers beyond the certificate, of slip that can not be answered, of the closed loop, and of a
        finger in the object between its contacts.
        """
        known = [*(number.text for number in self.exceeded), *reserved(self.assignments[0])]
        for (name, run), scene in zip(self.fingers.items(), self.scenes, strict=True):
            whose = "" if self.run is not None else f"{name}: "
            known += [f"{whose}{text}" for text in run.warnings]
            half = scene.finger.profile.half_thickness
            contacts = run.contacts
            if contacts and (overlap := contacts.overlap_text(run, self.scene.body, self.object_pose, half, 50)):
                known.append(
                    f"{whose}between its contacts the finger overlaps the object by {overlap}: add more_contacts"
                )
        return tuple(known)

    def rows(self) -> list[tuple[str, str, str, str, str]]:
        """Table of the phases: name, begin, end, pull, furthest displacement since the lift."""
        t = self.t
        pose = self.object_pose
        lift = self.timetable.span("lift")
        rows = [("phase", "from", "to", "pulled with", "moved")]
        for span in self.spans:
            if span.start > t[-1]:
                break
            during = (t >= span.start) & (t <= span.end)
            moved = ""
            if lift.end <= span.start < self.timetable.span("lower").end:
                begin = pose[np.searchsorted(t, lift.start), :2]
                moved = f"{1e3 * np.linalg.norm(pose[during, :2] - begin, axis=1).max(initial=0.0):.2f} mm"
            wrench = self.pulls.get(span.name)
            pulled = "" if wrench is None else wrench_text(wrench)
            rows.append((span.name, f"{span.start:.2f} s", f"{min(span.end, t[-1]):.2f} s", pulled, moved))
        return rows

    def report(self) -> str:
        """Verdict, phases and the closed loop's table as text."""
        lines = [self.name or "mission", "", *self.aligned(list(self.verdict.pairs().items()), (0, 1)), ""]
        if self.exceeded:
            lines += ["beyond the certificate:", *(f"  {number.text}" for number in self.exceeded), ""]
        lines += self.aligned(self.rows(), range(5))
        for name, run in self.fingers.items():
            lines += ["", *([] if self.run is not None else [f"finger {name}"]), run.report()]
        return "\n".join(lines)

    def yaml(self) -> str:
        """Summary of a mission as YAML, in SI units."""
        head = {"name": self.name, "status": self.status, "outcome": self.outcome, "warnings": list(self.warnings)}
        return self.as_yaml({**head, **self.findings()}, _HEAD)

    def meta(self, **options: Any) -> dict[str, Any]:
        """Meta data, whose configuration is the mission; the closed loops have theirs in the fingers' folders."""
        return {**super().meta(**options), "config": self.mission.model_dump(mode="json")}

    def details(self) -> dict[str, Any]:
        """Verdict, phases, and how the plant differs."""
        return {**self.findings(), "variation": asdict(self.variation)}

    def findings(self) -> dict[str, Any]:
        """Verdict with the reason of a drop, demands beyond the certificate, and the phases, as plain data."""
        return {
            "verdict": verdict_data(self.verdict),
            "exceeded": [asdict(number) for number in self.exceeded],
            "phases": [asdict(span) for span in self.spans],
        }

    def parts(self) -> dict[str, Result]:
        """The grasp, and the closed loop of each finger."""
        return {"grasp": self.assignments[0].grasp, **self.fingers}


def verdict_data(verdict: MissionVerdict) -> dict[str, Any]:
    """A verdict as plain data, with the sentence on a drop."""
    entries = {**asdict(verdict), "succeeded": verdict.succeeded}
    for name, text in verdict.explained.items():
        entries[name] |= {"text": text}
    if verdict.turned is not None:
        entries["turned"] |= {"achieved": verdict.turned.achieved}
    return entries


def wrench_text(wrench: Array) -> str:
    """A wrench in words, without components that are zero."""
    units = (("N", "in x"), ("N", "in y"), ("N m", "about z"))
    words = [
        f"{amount_text(value, unit, '+.3g')} {along}"
        for value, (unit, along) in zip(wrench.tolist(), units, strict=True)
        if value
    ]
    return ", ".join(words) or "nothing"
