"""Whether ``space_error`` covers the true error of random scenes: motions, equilibria and modes."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.report import begun
from continuum_grasp import equilibrium, modes
from continuum_grasp.base import ContinuumGraspError
from continuum_grasp.rod import natural_frequencies, solve_elastica
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import integrate
from continuum_grasp.simulation.accuracy.space import apart, motion_within

_FINE = 8
"""Free clothoids of the motions that are taken as true: their error is that of two over 4^4 where the order holds."""
_PLACES = 21
_KINDS = {
    "drop": "free",
    "release": "free",
    "tendon": "tendons",
    "friction": "tendons with friction",
    "length": "winches and motors",
    "motor": "winches and motors",
    "object": "objects",
}
"""Groups in which motions are counted, by what moves the finger."""


def scene(random: np.random.Generator) -> tuple[str, Scene]:
    """One finger of random size, softness, taper, tendons, mass and damping: let go, pushed at its tip, pulled by
    tendons, wound up by winches or motors, or falling onto a disc; and which of these.
    """
    length = float(random.uniform(0.05, 0.6))
    density, weight = float(random.uniform(0.01, 0.1)), float(10 ** random.uniform(-0.5, 1.5))
    stiffness = density * 9.81 * length**3 / weight
    taper = float(random.choice([1.0, 1.0, 0.5, 0.1]))
    rod: dict = {"length": length, "linear_density": density, "bending_stiffness": stiffness}
    if taper < 1.0:
        young = stiffness / (math.pi / 64 * 0.01**4)
        cone = {"to": length, "diameter": [0.01, 0.01 * taper], "youngs_modulus": young}
        cone["density"] = density / (math.pi / 4 * 0.01**2)
        rod = {"length": length, "sections": [cone]}
    period = 2 * math.pi * length**2 / 3.52 * math.sqrt(density / stiffness)
    family = str(random.choice(["arc", "clothoid", "matched_clothoid"]))
    finger = {"rod": rod, "base": {"angle": float(random.uniform(-math.pi, math.pi))}}
    finger["damping"] = {"material": float(random.choice([0.0, 0.02])) * stiffness * period}
    kind = str(random.choice(list(_KINDS)))
    keys: dict = {"initial": {"pose": "straight"}}
    force = 0.5 * stiffness / length**2
    if kind == "release":
        held = {"kind": "force", "at": length, "force": [float(v) for v in random.uniform(-2, 2, 2) * force]}
        keys = {"initial": {"pose": "equilibrium", "held_by": [held]}}
    offset = 0.05 * length
    if kind in ("tendon", "friction", "length", "motor"):
        finger["half_thickness"] = 2.0 * offset
        finger["tendons"] = {"offset": offset, "min_tension": 0.0, "max_tension": 1e6}
        bend = float(random.uniform(0.5, 3.0))
        # The mean of the flexibility per that at the base: cones bend at their tips.
        slender = 1.0 if taper == 1.0 else (taper**-3 - 1.0) / (3.0 * (1.0 - taper))
        pull = bend * stiffness / length / offset / slender
        samples = {"times": [0.0, 0.5 * period], "values": [0.0, pull]}
        keys = {"actuation": {"tensions": [samples, 0.0]}}
    if kind in ("length", "motor"):
        # Cables that give by a tenth of what is wound up; the drive is as fast as the finger.
        pretension, wound = 0.5 * pull, {"times": [0.0, 0.5 * period], "values": [0.0, bend * offset]}
        finger["tendons"] |= {"axial_stiffness": 1e3 * pull, "series_stiffness": 10.0 * pull / (bend * offset)}
        if kind == "length":
            drive = {"kind": "length", "time_constant": 0.1 * period, "pretension": pretension}
            paid = {**wound, "values": [0.0, -bend * offset]}
            keys = {"actuation": {"lengths": [wound, paid]}}
        else:
            torque = pull * offset
            drive = {"kind": "motor", "arrangement": "one_pulley", "pretension": pretension, "winch_radius": offset}
            drive |= {"inertia": torque * (0.05 * period) ** 2, "torque_max": 20.0 * torque}
            drive |= {"position_gain": 20.0 * torque / bend, "rate_gain": torque * 0.5 * period / bend}
            keys = {"actuation": {"angles": [{**wound, "values": [0.0, bend]}]}}
        finger["tendons"]["drive"] = drive
    if kind == "friction":
        finger["tendons"]["friction"] = float(random.uniform(0.05, 0.3))
    if kind == "object":
        # A disc below the middle of the outer half, along the way of a finger that falls.
        finger["base"]["angle"] = -0.5 * math.pi
        finger["half_thickness"] = 0.02 * length
        finger["damping"]["material"] = 0.02 * stiffness * period
        size = float(random.uniform(0.1, 0.3)) * length
        at = [float(random.uniform(0.5, 0.9)) * length, -0.5 * size - float(random.uniform(0.02, 0.1)) * length]
        law = {"stiffness": 1e3 * density * 9.81, "friction": 0.3, "dissipation": 1.0 / length}
        disc = {"shape": "circle", "diameter": size, "mass": density * length, "position": at}
        keys |= {"object": disc, "object_moves": False, "contact_law": law, "contacts": [0.5 * length]}
    if kind not in ("drop", "release", "tendon") and family == "matched_clothoid":
        family = "clothoid"
    elements: int | list[float] = int(random.integers(1, 4))
    if kind == "object":  # what can touch is an end of an element
        elements = [0.5 * length, 0.5 * length]
    # Paths of tendons on winches may not be turned inside out.
    reach = 20.0 if kind not in ("length", "motor") else 4.0 / elements
    fidelity = {"family": family, "elements": elements, "bending_range": reach}
    time = {"duration": period, "step": period / 200, "space_error": True}
    given = {"finger": finger, "gravity": [0.0, -9.81], "fidelity": fidelity, "time": time, **keys}
    return kind, Scene.model_validate(given)


def motion_errors(given: Scene) -> tuple[tuple[float, float]]:
    """Estimate and true error of a motion, per length."""
    found = motion_within(given, None)
    print(*found.warnings, flush=True)
    elements: int | tuple[float, ...] = _FINE
    if isinstance(given.fidelity.elements, tuple):
        elements = tuple(h / 4 for h in given.fidelity.elements for _ in range(4))
    reach = 1.5 if given.finger.winches else 10.0
    fine = given.fidelity.replaced(family="clothoid", elements=elements, bending_range=reach)
    exact = integrate(given.replaced(fidelity=fine))
    return ((found.space_error, apart(found, exact)),)


def rest_errors(given: Scene) -> tuple[tuple[float, float], tuple[float, float]]:
    """Estimate and true error of an equilibrium, per length, and of the first frequency, relative."""
    finger = given.finger.replaced(tendons=None)
    loads = given.initial.held_by
    free = {"finger": finger, "gravity": given.gravity, "fidelity": given.fidelity, "loads": loads}
    at_rest = Scene(**free)
    found = equilibrium(at_rest)
    rod = solve_elastica(at_rest, tolerance=1e-9)
    s = np.linspace(0.0, found.model.finger.rod.length, _PLACES)
    off = np.linalg.norm(found.backbone(_PLACES) - rod.position(s), axis=1).max() / s[-1]
    vibrations = modes(at_rest, about=found)
    true = natural_frequencies(at_rest.finger, rod)
    return (found.space_error, float(off)), (
        float(vibrations.space_error[0]),
        float(abs(vibrations.frequencies_hz[0] / true[0] - 1.0)),
    )


def main() -> None:
    """Run every scene, and write the report."""
    given, report = begun(__doc__, "space_error", count=80, seed=0)
    random = np.random.default_rng(given.seed)
    motions = [f"motion, {group}" for group in dict.fromkeys(_KINDS.values())]
    pairs = {name: [] for name in ("motion", *motions, "equilibrium", "first frequency")}
    summary = report.table(
        "Share of true errors that the estimate covers",
        ["", "scenes", "off by more than 1e-4", "covered", "least estimate / true error", "median"],
    )
    note = "Motions against 8 clothoids, the rest the exact rod."
    table = report.table("Estimate / true error", ["model", "motion", "equilibrium", "first frequency"], note=note)
    for k in range(given.count):
        kind, drawn = scene(random)
        elements = drawn.fidelity.elements
        what = f"{kind}, {len(elements) if isinstance(elements, tuple) else elements} {drawn.fidelity.family}"
        cells = []
        for names, errors in ((("motion",), motion_errors), (("equilibrium", "first frequency"), rest_errors)):
            try:
                found = errors(drawn)
            except (ContinuumGraspError, np.linalg.LinAlgError) as reason:
                print(k, what, names, str(reason).splitlines()[0][:150], flush=True)
                cells += ["-"] * len(names)
                continue
            for name, pair in zip(names, found, strict=True):
                if all(map(math.isfinite, pair)):
                    pairs[name].append(pair)
                    if name == "motion":
                        pairs[f"motion, {_KINDS[kind]}"].append(pair)
                cells.append(f"{pair[0]:.1e} / {pair[1]:.1e}")
        table.add(what, *cells)
    for name, values in pairs.items():
        estimate, true = np.reshape(values, (-1, 2)).T
        ratio = (estimate / np.maximum(true, 1e-6))[true > 1e-4]
        if name not in motions:
            report.claim(f"{name}: scenes", len(values), ">=", 0.8 * given.count)
        if ratio.size:
            covered, least, median = float(np.mean(ratio >= 1.0)), float(ratio.min()), float(np.median(ratio))
            report.claim(f"{name}: share covered of those off by more than 1e-4", covered, ">=", 0.9)
            report.claim(f"{name}: least estimate / true error of these", least, ">=", 0.5)
            report.claim(f"{name}: median", median, "<=", 2.0)
            summary.add(name, len(values), ratio.size, f"{covered:.0%}", round(least, 2), round(median, 2))
    report.finish()


if __name__ == "__main__":
    main()
