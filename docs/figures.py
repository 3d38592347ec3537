"""Figures of accuracy.md, contact.md and control.md that no benchmark prints: ``python docs/figures.py``, a minute."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import continuum_grasp as cg
from continuum_grasp.closed_loop import ControlRun

SEEDS = (0, 1)
MOMENT, RISE = 0.05, 0.2
"""Tip moment [N m] of accuracy.md, "Inputs that vary", and how long it takes to rise [s]."""


def rising(family: str, elements: int) -> cg.Scene:
    """The paper's rod with 10 g, straight and at rest, while its tip moment rises."""
    changes = {
        "initial": {"pose": "straight"},
        "actuation": {"tip_moment": {"times": [0.0, RISE], "values": [0.0, MOMENT]}},
        "fidelity": {"family": family, "elements": elements, "bending_range": 4.0},
    }
    return cg.load("configs/simulate/nitinol_release_010g.yaml", changes)


def rows_at(t: NDArray[np.float64], rates: bool) -> NDArray[np.float64]:
    """The moment at instants (T, 1), or with its first and second derivative (T, 3)."""
    z = np.clip(t / RISE, 0.0, 1.0)
    value = z**3 * (10.0 - 15.0 * z + 6.0 * z**2)
    rate, acceleration = 30.0 * (z * (1.0 - z)) ** 2 / RISE, 60.0 * z * (1.0 - z) * (1.0 - 2.0 * z) / RISE**2
    return MOMENT * np.stack([value, rate, acceleration] if rates else [value], axis=1)


def moving_moments() -> None:
    """What the rates of a moment that moves are worth, held for steps of 1 ms at its value in their middle."""
    fine = cg.simulate(rising("clothoid", 8)).tip
    print("model, u: r.m.s. of the tip over a second, against eight clothoids")
    t = 1e-3 * np.arange(len(fine))
    for family, rates in (("matched_clothoid", False), ("matched_clothoid", True), ("clothoid", False)):
        core = cg.compile(cg.FingerModel(rising(family, 2), input_rates=rates))
        x = [np.zeros(core.model.nx)]
        for u in rows_at(t[:-1] + 5e-4, rates):
            x.append(core.rollout(x[-1], 1, 1e-3, u=u)[-1])
        tip = core.batch("tip", np.array(x)[:, : core.model.n], rows_at(t, rates), None)
        error = 1e3 * np.sqrt(np.mean(np.sum((tip - fine) ** 2, axis=1)))
        print(f"2 {family}, {'with' if rates else 'without'} rates: {error:.2f} mm", flush=True)


def run(name: str, *changes: str) -> ControlRun:
    """The closed loop of a shipped scene with changes."""
    return cg.run_closed_loop(cg.load(f"configs/mpc/{name}.yaml", changes))


def contacts() -> None:
    """Instructions of the forward dynamics of two clothoids with two contacts, by law and shape of the object."""
    law = {"stiffness": 5e3, "friction": 0.5, "dissipation": 1.0}
    shapes = {
        "disc": {"shape": "circle", "diameter": 0.08},
        "box": {"shape": "box", "width": 0.08, "height": 0.06, "corner_radius": 0.01},
        "ellipse": {"shape": "ellipse", "width": 0.08, "height": 0.06},
    }
    for name, law_of, shape in (
        ("disc, slip_speed", {**law, "slip_speed": 0.01}, shapes["disc"]),
        *((f"{name}, presliding", {**law, "presliding": 1e-4}, shape) for name, shape in shapes.items()),
    ):
        body = {**shape, "mass": 0.3, "position": [0.15, 0.095]}
        changes = {"fidelity": {"family": "clothoid", "elements": 2}, "contact_law": law_of, "object": body}
        scene = cg.load("configs/simulate/swing_against_disc.yaml", changes)
        free, touching = (model(scene).forward_dynamics.n_instructions() for model in (cg.FingerModel, cg.System))
        print(f"{name}: {touching} instructions, without contact {free}", flush=True)


def penalties() -> None:
    """How much the tensions of ``keep_out`` change beside the wall, and how near to it the tip comes."""
    wall = "controller.bounds.keep_out.wall.penalty"
    print("penalty, input_rate: change of the tensions per period beside the wall, and away from it; nearest")
    for linear, rate in ((100, 2e-4), (100, 2e-3), (10, 2e-3), (4, 2e-3)):
        beside, away, nearest = [], [], []
        for seed in SEEDS:
            found = run(
                "keep_out",
                f"{wall}={{linear: {linear}, quadratic: {10 * linear}}}",
                f"controller.cost.input_rate={rate}",
                "plant.fidelity.elements=4",
                f"plant.seed={seed}",
            )
            change, t = np.diff(found.u, axis=0), found.t[1 : len(found.u)]
            beside.append(change[(t > 0.7) & (t < 1.2)])
            away.append(change[t > 2.7])
            nearest += [-1e3 * bound.excess.max() for bound in found.bounds if "wall" in bound.name]
        r_m_s = [np.sqrt(np.mean(np.concatenate(part) ** 2)) for part in (beside, away)]
        print(f"{linear:4d}, {rate:.0e}: {r_m_s[0]:.2f} N, {r_m_s[1]:.2f} N; {min(nearest):.1f} mm", flush=True)


def drifts() -> None:
    """How soon ``steady_tip`` learns an unknown moment, and how much noise it follows, by the drift that is allowed."""
    print("drift: within 2 mm after, without noise; wander of the tip with noise, r.m.s. of the last second")
    for drift in (0.01, 0.003, 0.001):
        asked = f"estimator.disturbances={{tip_moment: {drift}}}"
        quiet = run("steady_tip", asked, "plant.noise=0")
        far = np.linalg.norm(quiet.tip - quiet.tip_reference, axis=1) > 2e-3
        wander = []
        for seed in SEEDS:
            noisy = run("steady_tip", asked, f"plant.seed={seed}")
            off = (noisy.tip - noisy.tip_reference)[noisy.t > noisy.t[-1] - 1.0]
            wander.append(np.mean(np.sum((off - off.mean(axis=0)) ** 2, axis=1)))
        learnt = quiet.t[np.flatnonzero(far)[-1] + 1]
        print(f"{drift:6g}: {learnt:.2f} s; {1e3 * np.sqrt(np.mean(wander)):.1f} mm", flush=True)


if __name__ == "__main__":
    moving_moments()
    contacts()
    penalties()
    drifts()
