"""Speed against error: the one-second release of the 0.6 m rod by this package and by other libraries, in one run.

Run ``python -m benchmarks.bench_peers`` in the root of the repository, with the interpreter that has the other
libraries named in ``CONTINUUM_GRASP_PEERS_PYTHON``; see ``baselines/release_peers.py``. Errors are r.m.s. distances of
the tip over the second from the motion of 12 free clothoids. Times are of stepping alone, warm, on one core, in turns.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from benchmarks.baselines import PeerError, release_peers
from benchmarks.baselines.release_ours import OwnRun, front, own_runs
from benchmarks.baselines.release_peers import HINGES, LABELS, ChainRun, ReleasePeers, describe_rod
from benchmarks.harness import CONFIGS, Timing, one_core, quartiles, race
from benchmarks.report import Report, begun
from continuum_grasp.scene import Actuation, Initial, Rod, Scene, Tendon, load
from continuum_grasp.simulation.accuracy.motion import TipMotion, reference_motion
from continuum_grasp.simulation.accuracy.truth import Truth, find_truth

FRAME = 0.2
"""Span that counts as one evaluation [s]; whole numbers of all steps."""
LARGEST = 0.03
"""Largest error of ours that is shown [m]."""
CLAIMED = 10
"""Hinges of the chain that the limit is about."""
GRADED = ("tapered", "stepped", "tendon", "tapered_undamped", "stepped_undamped", "tendon_undamped")
"""Scenes of ``--graded``."""
SEGMENTS: dict[str, tuple[dict[str, int], ...]] = {
    "soromox": (
        {"segments": 2},
        {"segments": 4},
        {"segments": 1, "order": 1},
        {"segments": 2, "order": 1},
        {"segments": 1, "order": 3},
    ),
    "jsrm": ({"segments": 2},),
}
"""Segments of these libraries: of constant curvature, or with the order of its polynomial (SoRoMoX's GVS)."""
NOT_TRIED = "JSRM, 3 and more segments: its expressions do not compile within five minutes; 2 segments only"


@dataclass
class Entry:
    """One contestant."""

    name: str
    library: str
    error: float
    steps: int
    cold: float
    run: Callable[[int], None]


@dataclass
class Release:
    """A scene, its truth, and what is measured in it."""

    title: str
    scene: Scene
    libraries: tuple[str, ...]
    graded: bool = False
    """Whether fewer time steps and rounds do: six scenes in one run."""
    thin: bool = False
    """Whether every other time step of MuJoCo's does."""
    hinges: tuple[int, ...] = HINGES
    """Of MuJoCo's chains."""
    truth: Truth = field(init=False)
    reference: TipMotion = field(init=False)
    rod: dict[str, Any] = field(init=False)

    def prepare(self) -> None:
        """Find the exact rod and the reference motion."""
        self.truth = find_truth(self.scene)
        self.reference = reference_motion(self.scene, self.truth)
        self.rod = describe_rod(self.scene, self.truth)


def releases() -> dict[str, Release]:
    """What can be measured, by short names."""
    held, heavy = (load(CONFIGS / f"simulate/nitinol_release_{mass}g.yaml") for mass in ("000", "020"))
    straight = held.model_copy(update={"initial": Initial(pose="straight")})
    segments = ("mujoco", "soromox", "jsrm")
    taper = _graded(straight, {"to": 0.6, "diameter": (0.003, 0.00075)})
    stepped = _graded(straight, {"to": 0.24, "diameter": 0.002}, {"to": 0.6, "diameter": 0.00112})
    tendon = Tendon(offset=0.005, to=0.36, max_tension=20.0)
    pulled = held.replaced(
        finger=held.finger.replaced(tendons=(tendon,), half_thickness=0.006), actuation=Actuation(tensions=(15.0,))
    )
    return {
        "straight": Release("released straight", straight, segments),
        "held": Release("released from the held pose", held, segments),
        "undamped": Release("released straight, no damping", _undamped(straight), ("mujoco", "pyelastica")),
        "tapered": Release("tapered 4:1, released straight", taper, ("mujoco", "soromox"), True),
        "stepped": Release("stepped, released straight", stepped, ("mujoco", "soromox"), True),
        "tendon": Release(
            "pulled by a tendon that ends at 0.6 L, pushed and released", pulled, ("mujoco", "soromox"), True
        ),
        "tapered_undamped": Release("tapered 4:1, no damping", _undamped(taper), ("mujoco", "pyelastica"), True),
        "stepped_undamped": Release("stepped, no damping", _undamped(stepped), ("mujoco", "pyelastica"), True),
        "tendon_undamped": Release("tendon to 0.6 L, no damping", _undamped(pulled), ("mujoco", "pyelastica"), True),
        "heavy": Release("released from the held pose, 20 g at the tip", heavy, ("mujoco",)),
    }


def _undamped(scene: Scene) -> Scene:
    return scene.replaced(finger=scene.finger.replaced(damping=scene.finger.damping.replaced(material=0.0)))


def _graded(scene: Scene, *sections: dict[str, Any]) -> Scene:
    """The scene with a rod of these sections, and damping in proportion to its stiffness."""
    finger = scene.finger
    uniform = finger.rod
    given = {key: getattr(uniform, key) for key in ("length", "youngs_modulus", "density")}
    rod = Rod.model_validate({**given, "sections": sections})
    damping = finger.damping.replaced(material=finger.damping.material * rod.stiffness / uniform.stiffness)
    return scene.replaced(finger=finger.replaced(rod=rod, damping=damping))


def own_entries(release: Release) -> list[Entry]:
    """Ours: the front, and the front of two arcs, the model of the constant-curvature libraries."""
    runs = list(own_runs(release.scene, release.truth, release.reference))
    arcs = [run for run in runs if run.choice.family == "arc" and run.choice.elements == 2]
    chosen = [run for run in front(runs) if run.error <= LARGEST]
    chosen += [run for run in front(arcs) if all(run is not other for other in chosen)]
    return [_own_entry(run) for run in chosen]


def _own_entry(run: OwnRun) -> Entry:
    name = f"{run.name}, {run.choice.accuracy:g}, {run.steps}/s"
    return Entry(name, "ours", run.error, run.steps, run.cold, lambda count: run.run(FRAME * count))


def mujoco_entries(release: Release, peers: ReleasePeers) -> tuple[list[Entry], dict[int, ChainRun]]:
    """MuJoCo's chains: of each number of hinges the best settings of a sweep, and the fastest of these."""
    entries, fastest = [], {}
    for hinges in release.hinges:
        runs = release_peers.sweep(peers, release.rod, hinges, release.reference, thin=release.graded or release.thin)
        found = release_peers.best(runs)
        if "fastest" in found:
            fastest[hinges] = found["fastest"]
        for run in found.values():
            if all(run.name != entry.name for entry in entries):
                peers.make(run.name, "mujoco", release.rod, run.settings, frames=0)
                step = partial(_step, peers, run.name)
                entries.append(Entry(run.name, "mujoco", run.error, run.settings["steps"], run.cold, step))
    return entries, fastest


def other_entries(release: Release, peers: ReleasePeers, library: str, report: Report) -> list[Entry]:
    """Rods of segments, or PyElastica's with its cross-check."""
    if library == "pyelastica":
        table, found = release_peers.check(peers, release.rod, release.reference)
        report.tables.append(replace(table, title=f"{table.title}: {release.title}"))
    else:
        marks = len(release.rod["marks"])  # each part of a rod that is not uniform needs a segment of its own
        fitting = [one for one in SEGMENTS[library] if one["segments"] > marks]
        found = [release_peers.segments(peers, release.rod, library, one, release.reference) for one in fitting]
    return [Entry(name, library, error, run.steps, run.cold, partial(_step, peers, name)) for name, error, run in found]


def _step(peers: ReleasePeers, name: str, count: int) -> None:
    peers.run(name, FRAME * count)


def measure(release: Release, peers: ReleasePeers | None, report: Report, rounds: int) -> None:
    """One scene: all errors, then all times in one race."""
    release.prepare()
    entries = own_entries(release)
    chains: dict[int, ChainRun] = {}
    for library in release.libraries if peers is not None else ():
        try:
            if library == "mujoco":
                more, chains = mujoco_entries(release, peers)
            else:
                more = other_entries(release, peers, library, report)
            entries += more
        except PeerError as error:
            report.missing.append(f"{LABELS[library]}, {release.title}: {error}")
    first = entries[0].name
    timings = race({e.name: e.run for e in entries}, repeats=rounds, sample_seconds=0.05, seed=report.seed)
    columns = ["", "median [ns]", "quartile 1 [ns]", "quartile 3 [ns]", f"times {first}", "cold [us]"]
    columns += ["r.m.s. error [mm]", "steps per s", "real-time factor", "to build [ms]"]
    off, title = 1e3 * release.reference.error * release.scene.finger.rod.length, f"Rod {release.title}"
    note = f"Reference good to {off:.1g} mm (estimated)."
    table = report.table(f"{title}: time of {1e3 * FRAME:g} ms of motion", columns, note=note)
    for e in entries:
        timing = timings[e.name]
        low, middle, high = (1e9 * value for value in quartiles(timing.samples))
        table.add(
            *(e.name, middle, low, high, timing.per(timings[first]), 1e6 * timing.cold),
            *(1e3 * e.error, e.steps, FRAME / timing.median, 1e3 * e.cold),
        )
    add_equal_error(report, entries, timings, title)
    if release.rod["uniform"] and CLAIMED in chains:
        fastest = chains[CLAIMED]
        ours = cheapest(entries, timings, fastest.error)
        factor = math.nan if ours is None else timings[fastest.name].per(timings[ours.name])
        text = f"{release.title}: {CLAIMED} hinges in MuJoCo / ours, time"
        report.claim(f"{text}, its fastest setting, ours with no more error", factor, ">=", 50)


def cheapest(entries: list[Entry], timings: dict[str, Timing], error: float) -> Entry | None:
    """Our fastest with at most an error."""
    good = [e for e in entries if e.library == "ours" and e.error <= error]
    return min(good, key=lambda e: timings[e.name].median, default=None)


def add_equal_error(report: Report, entries: list[Entry], timings: dict[str, Timing], title: str) -> None:
    """For each peer our fastest choice with at most its error, and how many times faster."""
    columns = ["peer", "its error [mm]", "our fastest with at most that", "our error [mm]", "times as fast"]
    table = report.table(f"{title}: at equal error", columns)
    for peer in [entry for entry in entries if entry.library != "ours"]:
        best = cheapest(entries, timings, peer.error)
        found = ["none", None, None]
        if best is not None:
            found = [best.name, 1e3 * best.error, timings[peer.name].per(timings[best.name])]
        table.add(peer.name, 1e3 * peer.error, *found)


def main() -> None:
    """Measure the scenes that are asked for; write the report."""
    known = releases()
    asked, report = begun(
        __doc__,
        lambda asked: "peers_graded" if asked.graded else "peers",
        seed=0,
        scenes=(["straight", "held", "undamped"], "", known),
        graded=(False, "the rods that are not uniform, and a tendon's end inside"),
        hinges=(list(HINGES), "of MuJoCo's chains", HINGES),
        thin=(False, "every other time step of MuJoCo's alone"),
        rounds=(15, "in which all take turns; half as many with --graded"),
    )
    peers, installed = None, list[str]()
    with one_core():
        try:
            peers = ReleasePeers()
        except PeerError as error:
            report.missing.append(f"all other libraries: {error}")
        for name in LABELS if peers else ():
            try:
                report.machine[name] = peers.version(name)
                installed.append(name)
            except PeerError as error:
                report.missing.append(f"{LABELS[name]}: {error}")
        if "jsrm" in installed and not asked.graded:
            report.missing.append(NOT_TRIED)
        for name in GRADED if asked.graded else asked.scenes:
            release = known[name]
            libraries = tuple(k for k in release.libraries if k in installed)
            release = replace(release, libraries=libraries, thin=asked.thin, hinges=tuple(asked.hinges))
            measure(release, peers, report, asked.rounds // (2 if asked.graded else 1))
        if peers is not None:
            peers.close()
    report.finish()


if __name__ == "__main__":
    main()
