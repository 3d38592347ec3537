"""How a mission went."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.mpc.loop.result import ControlRun
from continuum_grasp.mpc.mission.assignment import Assignment
from continuum_grasp.mpc.mission.plant import Variation
from continuum_grasp.mpc.mission.timetable import Timetable

__all__ = ["MissionRun", "Verdict"]

Array = NDArray[np.float64]

_FALLEN = 0.005
"""Height that an object loses before it counts as dropped [m]."""
_SETTLED = 0.5
"""Last share of the hold over which forces are judged."""


@dataclass(frozen=True)
class Verdict:
    """A mission in numbers.

    Attributes
    ----------
    held : bool
        Whether the object was never dropped.
    sunk : float
        Greatest height that it lost between lift and lowering [m].
    moved : float
        Greatest distance that it moved in the plane while it was held, pulls included [m].
    force_error : float
        Greatest error of the held contact force, smoothed over 0.1 s, in the second half of the hold, per set-point.
    force_mean_error : float
        Error of its mean there, per set-point.
    force_estimate_error : float
        Error of the mean of its estimate there, per set-point.
    slip_margin : float
        Least share of the friction cone that was left at any contact while nothing pulled.
    released : bool
        Whether nothing of the finger touched the object in the end.
    fallbacks : int
        Commands that were not of a new plan.
    """

    held: bool
    sunk: float
    moved: float
    force_error: float
    force_mean_error: float
    force_estimate_error: float
    slip_margin: float
    released: bool
    fallbacks: int

    @property
    def succeeded(self) -> bool:
        """Held from lift to lowering, and let go."""
        return self.held and self.released


@dataclass(frozen=True)
class MissionRun:
    """A mission that was carried out.

    Attributes
    ----------
    assignment : Assignment
    timetable : Timetable
    variation : Variation
    run : ControlRun
        The closed loop.
    verdict : Verdict
    """

    assignment: Assignment
    timetable: Timetable
    variation: Variation
    run: ControlRun
    verdict: Verdict

    def save(self, folder: str | Path) -> Path:
        """Write the closed loop and ``mission.json`` into a folder."""
        from continuum_grasp.results import replacing
        from continuum_grasp.results.plain import plain

        target = self.run.save(folder)
        told = {
            "verdict": asdict(self.verdict),
            "variation": asdict(self.variation),
            "pulls": self.assignment.pulls.tolist(),
            "phases": [asdict(span) for span in self.timetable.spans],
        }
        with replacing(target / "mission.json") as temporary:
            temporary.write_text(json.dumps(plain(told), indent=1) + "\n", encoding="utf-8")
        return target


def judge(assignment: Assignment, timetable: Timetable, run: ControlRun) -> Verdict:
    """The verdict on a closed loop."""
    contacts, pose, t = run.contacts, run.object_pose, run.t
    if contacts is None or pose is None:
        raise ValueError("a mission has an object that moves")
    lift, hold, lower = (timetable.span(name) for name in ("lift", "hold", "lower"))
    carried = (t >= lift.start) & (t <= lower.start)
    still = (t >= hold.end - _SETTLED * (hold.end - hold.start)) & (t <= hold.end)
    calm = (t >= hold.start) & (t <= hold.end)
    fingers = [k for k, name in enumerate(contacts.names) if name.startswith("finger.")]
    bearing = [k for k, name in enumerate(contacts.names) if name != "table"]
    whole = bool(t[-1] >= lower.start)
    sunk = float(np.max(pose[carried][:1, 3] - pose[carried][:, 3], initial=0.0)) if carried.any() else 0.0
    moved = float(np.linalg.norm(pose[carried, :2] - pose[carried][:1, :2], axis=1).max(initial=0.0))
    k = run.r_names.index(f"contact_force_{assignment.mission.controller.contact} [N]")
    force = run.tracked[:, k]
    smooth = np.convolve(force, np.full(_window(run), 1.0 / _window(run)), mode="same")
    wanted, estimated = assignment.force, estimated_force(assignment, run)
    shear = contacts.shear[calm][:, bearing]
    limits = _friction(assignment, contacts.names)[bearing] * contacts.normal_force[calm][:, bearing]
    margins = 1.0 - shear / np.maximum(limits, 1e-9)
    loaded = contacts.normal_force[calm][:, bearing] > 0.05 * wanted
    return Verdict(
        held=whole and sunk < _FALLEN,
        sunk=sunk,
        moved=moved,
        force_error=float(np.max(np.abs(smooth[still] - wanted), initial=0.0)) / wanted,
        force_mean_error=float(np.mean(force[still]) - wanted) / wanted if still.any() else np.inf,
        force_estimate_error=float(np.mean((estimated - force[:-1])[still[:-1]])) / wanted if still.any() else np.inf,
        slip_margin=float(np.min(margins[loaded], initial=1.0)),
        released=whole and bool(np.all(contacts.normal_force[-1, fingers] == 0.0)),
        fallbacks=sum(word in ("previous_plan", "safe_ramp") for word in run.status),
    )


def estimated_force(assignment: Assignment, run: ControlRun) -> Array:
    """Estimated normal force of the held contact (K) [N]."""
    from continuum_grasp.mpc.prediction import Prediction

    model = Prediction(assignment.control)
    k = model.contact_names.index(assignment.mission.controller.contact)
    mapped = model.contact_force.map(len(run.u))(run.estimate[:, : model.nx].T, run.u.T, run.parameters.T)
    found: Array = np.array(mapped)[k]
    return found


def _window(run: ControlRun) -> int:
    return max(1, round(0.1 / run.period))


def _friction(assignment: Assignment, names: tuple[str, ...]) -> Array:
    """Friction coefficient of each contact."""
    mission = assignment.mission
    own = {wall.name: wall.friction for wall in mission.grasp.walls}
    found = [own.get(name.partition(".")[0] if name not in own else name) for name in names]
    return np.array([mission.contact_law.friction if f is None else f for f in found])
