"""The figures of real_robots.md: python docs/real_robots.py [wrist|joints|probe|trunk|tentacle|pulls|pictures]."""

from __future__ import annotations

import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

import continuum_grasp as cg
from continuum_grasp.addons.identification import Fit, Poses, Reading, data_folder
from continuum_grasp.scene import DataTable

CONFIGS = Path(__file__).parents[1] / "configs" / "identify"


def folder() -> Path:
    found = data_folder()
    if found is None:
        sys.exit("no measured data: set CONTINUUM_GRASP_DATA to their folder")
    return found


def show(title: str, fit: Fit) -> None:
    rows = [*zip(fit.names, fit.values, fit.deviations, strict=True)]
    rows += [*zip(fit.set_names, fit.set_values, fit.set_deviations, strict=True)]
    print(title, *(f"{name} {value:.4g} +- {deviation:.2g}" for name, value, deviation in rows[:8]), sep="\n  ")
    for kind, errors in (("fitted", fit.errors), ("hold-out", fit.holdout_errors)):
        for one in errors:
            factor, unit = (180.0 / np.pi, "deg") if one.unit == "rad" else (1e3, "mm")
            print(f"  {kind}: {factor * one.rms:.2f} {unit} r.m.s., {factor * one.largest:.1f} at most, {one.count}")
    for law in fit.laws:
        verdict = law.verdict.partition("\n")[0]
        print(f"  law {law.name}: {law.fitted:.2f} deviations fitted, {law.held_out:.2f} held out, {verdict}")
    print(*fit.warnings, sep="\n  ! ")


def sections(widths: list[float], gap: float, moments: list[float]) -> list[dict[str, float]]:
    """Notches of these second moments [m4] at 10 GPa, each followed by a ring that hardly bends."""
    at, found = 0.0, []
    for width, moment in zip(widths, moments, strict=True):
        for length, stiffness in ((width, 1e10 * moment), (gap, 1e-3)):
            at += length
            found.append({"to": round(at, 7), "bending_stiffness": stiffness, "linear_density": 0.005})
    return found


def scene_c(scene: cg.Scene) -> cg.Scene:
    """Wrist C: its geometry and its bends at rest, with the material of the scene of wrist A."""
    plain = cg.Scene(**{name: getattr(scene, name) for name in cg.Scene.model_fields})
    rest = [2.450, 2.858, 3.035, 3.830]  # deg, means of what was photographed below 0.03 N
    strain = 0.022  # where nitinol softens; 0.138 and 0.105 mm from the neutral axis at base and tip
    widths = [1e-3] * 8
    changes = {
        "finger.rod": {
            "length": 0.008,
            "sections": sections([1e-3] * 4, 1e-3, [8.40e-16, 6.40e-16, 4.76e-16, 3.44e-16]),
        },
        "finger.rest_curvature": {
            "breaks": [1e-3 * k for k in range(1, 8)],
            "values": [v for angle in rest for v in (np.radians(angle) / 1e-3, 0.0)],
        },
        "finger.softening.curvature": [strain / 0.138e-3, strain / 0.105e-3],
        "finger.stops.curvature": np.radians(37.9) / 1e-3,
        "finger.tendons.offset": 1.388e-3,
        "fidelity.elements": widths,
    }
    return plain.changed(changes)


def bends(name: str, scene: cg.Scene, most: float = 9.0, trial: str | None = None, **keys) -> Poses:
    """Bends of the notches of a wrist up to a tension [N], of one trial or all."""
    table = DataTable.read(folder() / "niti_notched_wrist" / f"{name}.csv")
    if trial is not None:
        table = table.chosen("trial", (trial,))
    pull = table.in_si("tension_N", "N")
    there = (pull >= 0.0) & (pull <= most)
    notches = 5 if name == "wrist_A" else 4
    readings = [
        Reading("bend", table.in_si(f"notch{k + 1}_deg", "rad", "deg")[there], (k + 1) * 0.002, None, k * 0.002)
        for k in range(notches)
    ]
    own = Poses(readings, {"tension_1": pull[there]}, name=f"{name} {trial or ''}".strip(), scene=scene)
    return replace(own, fitted=np.zeros(own.rows, bool)) if keys.get("held") else own


def wrist() -> None:
    """Wrist A by both materials; wrist C by itself, predicted from A, and with A; one trial of A from the other."""
    a = cg.load(CONFIGS / "notched_wrist.yaml")
    c = scene_c(a)
    linear = a.changed({"finger.softening": None, "estimate": [{"name": "bending_stiffness"}, a.estimate[1]]})
    show("wrist A, linear material", cg.identify(linear, bends("wrist_A", linear)))
    show("wrist A, that softens", cg.identify(a, bends("wrist_A", a)))
    show("wrist C, that softens", cg.identify(c, bends("wrist_C", c), parameters=a.estimate))
    for most in (0.9, 9.0):
        data = [bends("wrist_A", a), bends("wrist_C", c, most, held=True)]
        show(f"wrist C up to {most} N predicted from A", cg.identify(a, data))
        show(
            f"wrists A and C together up to {most} N",
            cg.identify(a, [bends("wrist_A", a, most), bends("wrist_C", c, most)]),
        )
    factor = [a.estimate[1], a.estimate[2]]
    known = a.changed({"finger.rod.factors.bending_stiffness": 1.2055})
    stiffer = c.changed({"finger.rod.factors.bending_stiffness": 1.2055 * 1.07})
    data = [bends("wrist_A", known), bends("wrist_C", stiffer, held=True)]
    show("wrist C, 7 % stiffer, predicted from A", cg.identify(known, data, parameters=factor))
    for one, other in (("1", "2"), ("2", "1")):
        data = [bends("wrist_A", a, trial=one), bends("wrist_A", a, trial=other, held=True)]
        show(f"wrist A, trial {other} predicted from trial {one}", cg.identify(a, data))
    for name, scene, count in (("wrist_A", a, 2), ("wrist_C", c, 3)):
        for most in (0.9, 9.0):
            each = [bends(name, scene, most, str(k + 1)) for k in range(count)]
            apart = [missed for one in each for other in each if other is not one for missed in between(one, other)]
            off = np.degrees(np.sqrt(np.mean(np.square(apart))))
            print(f"{name}: trials are {off:.2f} deg r.m.s. apart per notch up to {most} N")


def between(one: Poses, other: Poses) -> list[float]:
    """Differences of the bends of one trial from those of another at the same tensions, by straight lines."""
    pulls, known = (np.asarray(trial.conditions["tension_1"]) for trial in (one, other))
    there = (pulls >= known.min()) & (pulls <= known.max())
    pairs = zip(one.measured, other.measured, strict=True)
    return [v for a, b in pairs for v in (np.asarray(a.values) - np.interp(pulls, known, np.asarray(b.values)))[there]]


def joints() -> None:
    """The law of the joints, by their greatest loads; each from one load of its own; damping of their ring-downs."""
    show("joints, greatest loads predicted", cg.identify(CONFIGS / "spirob_joints.yaml"))
    for k, (joint, rows) in enumerate({"1": 6, "8": 7, "13": 8}.items()):
        held = [f"data[{other}].holdout_rows=[{'6' * (other == 0)}]" for other in range(3) if other != k]
        own = f"data[{k}].holdout_rows={list(range(3, rows + 1))}"
        fit = cg.identify(cg.load(CONFIGS / "spirob_joints.yaml", [*held, own]))
        show(f"joint {joint} from its first load and the other joints", fit)
    table = DataTable.read(folder() / "spirob_joint_static" / "ringdown_summary.csv")
    pulsation = 2.0 * np.pi * table.numbers("damped_frequency_mean_Hz")
    ratio = table.numbers("damping_ratio_mean")
    for k, joint in enumerate(table.numbers("joint")):
        others = np.arange(3) != k
        viscous = pulsation[k] * np.mean(ratio[others] / pulsation[others])
        same = np.mean(ratio[others])
        print(f"joint {joint:.0f}: damping ratio {ratio[k]:.3f}; from the others {same:.3f}, if viscous {viscous:.3f}")


def probe() -> None:
    """The loop of each motor: bends, and how far the way up and the way down are apart."""
    where = folder() / "tee_probe_hysteresis"
    fit = cg.identify(CONFIGS / "probe_loop.yaml", [where / f"motor1_loop{k}.csv" for k in (1, 2)])
    show("motor 1", fit)
    loops("motor 1", fit, where)
    changes = ["data[0].file=motor2_loop1.csv", "data[0].conditions[0].zero=1960", "finger.tendons.drive.slack=2 mm"]
    other = cg.load(CONFIGS / "probe_loop.yaml", changes)
    fit = cg.identify(other.model_copy(update={"data": other.data[:1]}), where / "motor2_loop1.csv")
    show("motor 2", fit)
    loops("motor 2", fit, where)


def tentacle() -> None:
    """The greatest loads predicted from the others, and all poses fitted; shortened by its tendon, and inextensible."""
    every = "data[0].holdout_rows=[]"
    first = [f"data[0].measured[{k}].at=0.1387" for k in (0, 1)]  # 9.6 mm farther, as the source's flaws have it
    inextensible = "finger.gyration_radius=null"
    for title, changes in {
        "shortened": [],
        "inextensible": [inextensible],
        "shortened, marker 1 elsewhere": first,
        "shortened, all poses": [every],
        "inextensible, all poses": [every, inextensible],
    }.items():
        fit = cg.identify(cg.load(CONFIGS / "silicone_tentacle.yaml", changes))
        show(f"tentacle, {title}", fit)
        distances(fit)


def pulls() -> None:
    """Sequences to three sides predicted from the others; all of a segment from those of the two others; and what three
    tendons of a segment do from what single ones do.
    """
    fit = cg.identify(CONFIGS / "tendon_pulls.yaml")
    show("rod on nine winches", fit)
    distances(fit)
    names = [one.name or "" for one in cg.load(CONFIGS / "tendon_pulls.yaml").data]
    single = [name.startswith("tendon") for name in names]
    # tendons 0 and 1 end at the first segment, 3 and 4 at the second, 6 and 7 at the third
    segments = [int(name[6]) // 3 + 1 if one else int(name[3]) for name, one in zip(names, single, strict=True)]
    held = {f"segment {k}": [one == k for one in segments] for k in (1, 2, 3)}
    for title, out in {**held, "three tendons at once": [not one for one in single]}.items():
        changes = [f"data[{k}].use={'holdout' if one else 'fit'}" for k, one in enumerate(out)]
        print(f"{title} from the others")
        distances(cg.identify(cg.load(CONFIGS / "tendon_pulls.yaml", changes)))


def distances(fit: Fit) -> None:
    """Mean distances of all markers, and of the tip."""
    tip = max(place for _, _, place, _ in fit.points)
    for word, fitted in (("fitted", True), ("hold-out", False)):
        own = {key: (x, y) for key, (x, y) in fit.points.items() if fit.fitted[x] == fitted}
        if own:
            missed = [1e3 * np.hypot(fit.residuals[x], fit.residuals[y]) for x, y in own.values()]
            ends = [one for one, (_, _, place, _) in zip(missed, own, strict=True) if place == tip]
            print(f"  {word}: markers {np.mean(missed):.1f} mm, tip {np.mean(ends):.1f} mm on average")


def loops(title: str, fit: Fit, where: Path) -> None:
    """Mean width of each loop, and the misfit per width."""
    start = 0
    for name, count in fit.blocks:
        steps = DataTable.read(where / f"{name}.csv").numbers("motor_steps")
        own = slice(start, start + count)
        start += count
        seen, modeled = np.degrees(fit.measured[own]), np.degrees(fit.predictions[own])
        wide, model = (width(steps, one) for one in (seen, modeled))
        left = np.sqrt(np.mean((seen - modeled) ** 2)) / wide
        print(f"{title}, {name}: {wide:.2f} deg wide, predicted {model:.2f}; misfit {100 * left:.0f} % of the width")


def width(steps: np.ndarray, bend: np.ndarray) -> float:
    """Mean difference between the way down and the way up at equal steps, 120 steps from the ends."""
    top, low = int(np.argmax(steps)), int(np.argmin(steps))
    grid = np.linspace(steps[low] + 120, steps[top] - 120, 60)

    def along(part: slice) -> np.ndarray:
        order = np.argsort(steps[part])
        return np.interp(grid, steps[part][order], bend[part][order])

    down, first, last = (along(part) for part in (slice(top, low + 1), slice(0, top + 1), slice(low, None)))
    return float(np.mean(down - np.where(grid >= steps[-1], first, last)))


def trunk() -> None:
    """Releases fitted, and others predicted, with a lean and without; how well releases repeat."""
    release("trunk", cg.load(CONFIGS / "trunk_releases.yaml"))
    dry = cg.load(CONFIGS / "trunk_dry_friction.yaml")
    others = [
        dry.data[number].model_copy(update={"use": "holdout", "file": f"release_{run}.csv", "plane": np.radians(plane)})
        for number, run, plane in (
            (0, "200g_a05", 129.0),
            (0, "200g_a08", -151.0),
            (2, "400g_a04", 125.0),
            (2, "400g_a08", 27.0),
        )
    ]
    every = dry.replaced(data=(*dry.data, *others))
    release("six others from two of each payload", every)
    release("the same without a lean", every.replaced(estimate=every.estimate[:-1]))
    for payload in (200, 400):
        repeats(payload, folder() / "hose_trunk_release")


def release(title: str, scene: cg.Scene) -> None:
    """A fit of releases, and how far their tips are off."""
    fit = cg.identify(scene, folder() / "hose_trunk_release")
    show(title, fit)
    start, found = 0, {"fitted": [], "predicted": []}
    for block, count in fit.blocks:
        own = slice(start, start + count)
        start += count
        # x and y of the last of three disks
        squares = float(np.mean(np.sum(fit.residuals[own].reshape(-1, 6)[:, 4:] ** 2, axis=1)))
        found["fitted" if fit.fitted[own][0] else "predicted"].append(squares)
        print(f"  {block}: tip {1e3 * np.sqrt(squares):.1f} mm r.m.s.")
    for use, of_tips in found.items():
        if of_tips:
            print(f"  {use}: tip {1e3 * np.sqrt(np.mean(of_tips)):.1f} mm r.m.s.")


def repeats(payload: int, where: Path) -> None:
    """How well the path of the tip repeats, without a model: from its start by regression, and between neighbors."""
    runs = DataTable.read(where / "runs.csv").chosen("payload_g", (str(payload),)).chosen("check", ("ok",))
    starts, paths, rests = [], [], []
    for row in runs.rows:
        table = DataTable.read(where / row[runs.index("file")])
        columns = [table.numbers(f"{axis}{k}_m") for k in (1, 2, 3) for axis in "xy"]
        disks, first = np.stack(columns, axis=1), int(np.argmin(np.abs(table.numbers("t_s") - 0.15)))
        # rates over 0.06 s count by 0.05 s, which makes them as large as the positions
        rates = (disks[first + 3] - disks[first - 3]) / 0.06
        starts.append(np.concatenate([disks[first], 0.05 * rates]))
        paths.append(disks[first : first + 150, 4:])
        rests.append(disks[-20:, 4].mean())
    x, y = np.array(starts), np.array(paths).reshape(len(paths), -1)
    for components in (0, 2):
        left = []
        for k in range(len(x)):
            others = np.arange(len(x)) != k
            about, mean = x[others].mean(axis=0), y[others].mean(axis=0)
            axes = np.linalg.svd(x[others] - about, full_matrices=False)[2][:components]
            slopes = np.linalg.lstsq((x[others] - about) @ axes.T, y[others] - mean, rcond=None)[0]
            missed = mean + (x[k] - about) @ axes.T @ slopes - y[k]
            left.append(2.0 * np.mean(missed**2))
        what = f"{components} numbers of the start" if components else "the mean of the others"
        print(f"{payload} g, each of {len(x)} from {what}: tip {1e3 * np.sqrt(np.mean(left)):.1f} mm r.m.s.")
    # a trunk that leans rests beside its axis in every plane by the cosine of what this is turned from the lean's
    plane, rest = np.radians(runs.numbers("plane_deg")), 1e3 * np.array(rests)
    toward = np.stack([np.cos(plane), np.sin(plane)], axis=1)
    lean = np.linalg.lstsq(toward, rest, rcond=None)[0]
    left = rest - toward @ lean
    print(
        f"{payload} g, disk 3 at rest: {np.sqrt(np.mean(rest**2)):.1f} mm r.m.s. beside the axis; a lean of "
        f"{np.hypot(*lean):.1f} mm leaves {np.sqrt(np.mean(left**2)):.1f} mm"
    )
    apart = [
        (float(np.linalg.norm((x[j] - x[k])[:6])), float(np.sqrt(2.0 * np.mean((y[j] - y[k]) ** 2))))
        for k in range(len(x))
        for j in range(k)
    ]
    for start, path in sorted(apart)[:3]:
        print(f"{payload} g, disks {1e3 * start:.0f} mm apart at the start: tips {1e3 * path:.1f} mm r.m.s. apart")


def pictures() -> None:
    """The loops of the probe."""
    from matplotlib.figure import Figure

    from continuum_grasp.results import save_picture

    target = Path(__file__).parent / "pictures"
    where = folder() / "tee_probe_hysteresis"
    fit = cg.identify(CONFIGS / "probe_loop.yaml", [where / f"motor1_loop{k}.csv" for k in (1, 2)])
    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    axes, start = figure.subplots(1, 2, sharey=True), 0
    for ax, (name, count), title in zip(axes, fit.blocks, ("fitted", "predicted"), strict=True):
        steps, own = DataTable.read(where / f"{name}.csv").numbers("motor_steps"), slice(start, start + count)
        start += count
        ax.plot(steps, np.degrees(fit.measured[own]), color="0.6", linewidth=3.0, label="measured")
        ax.plot(steps, np.degrees(fit.predictions[own]), color="C0", linewidth=1.2, label=title)
        ax.set(xlabel="motor steps", title=f"{name}, {title}")
        ax.legend(frameon=False)
    axes[0].set_ylabel("bend of the tip [deg]")
    save_picture(figure, target / "real_robots_loops.png")


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    for section in sys.argv[1:2] or ["wrist", "joints", "probe", "trunk", "tentacle", "pulls"]:
        globals()[section]()
