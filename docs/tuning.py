"""Tables of control.md, penalties and drifts: ``python docs/tuning.py`` in the root of the repository, a minute."""

from __future__ import annotations

import numpy as np

import continuum_grasp as cg
from continuum_grasp.closed_loop.result import ControlRun

SEEDS = (0, 1)


def run(name: str, *changes: str) -> ControlRun:
    """The closed loop of a shipped scene with changes."""
    return cg.run_closed_loop(cg.load(f"configs/mpc/{name}.yaml", changes))


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
    penalties()
    drifts()
