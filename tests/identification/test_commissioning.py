"""Benches mounted in a known way, on other plants; from inside: camera and log, before anything is fitted.

Benches that are mounted in a known way, on plants that are not the model: what is found, and what is not claimed.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import continuum_grasp as cg
from continuum_grasp.addons.identification import commission, design_commissioning
from continuum_grasp.addons.identification.commissioning.bench import Bench, Log, camera_through
from continuum_grasp.addons.identification.commissioning.log import _log_of
from continuum_grasp.base import InputError
from continuum_grasp.cli import app
from continuum_grasp.closed_loop import Plant, Wiring
from continuum_grasp.control import ControlLog
from continuum_grasp.scene import Connection, ControlScene, Mounting
from tests.identification.test_replay import SCENE

CONFIGS = Path(__file__).parents[2] / "configs"
CAMERA = {"position": (0.008, -0.006), "angle": 0.12, "scale": 0.93}
TENSIONS = ("tension_1 [N]", "tension_2 [N]")


def scene(mounting=None, known=None, gravity=(-9.81, 0.0), **plant):
    """A finger that sags to one side; the plant bends in other elements, and is stiffer, slower and later."""
    given = {**SCENE, "gravity": gravity, "initial": {"pose": "equilibrium"}}
    given["fidelity"] = {"family": "matched_clothoid", "elements": 2}
    given["estimator"] = {**SCENE["estimator"], "measured": {"tip": 3e-4, "tension": 0.1}}
    of_plant = {"fidelity": {"family": "clothoid", "elements": 3}, "stiffness": 1.12, "damping": 1.3}
    of_plant |= {"time_constant": 0.026, "delay": 0.023, "tip_mass": 0.001, "mounting": mounting, **plant}
    return ControlScene(**given, plant=of_plant, mounting=known)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_camera_is_found_from_points(mirrored):
    """Against its definition: scale times the turned, perhaps mirrored distance from its origin."""
    rng = np.random.default_rng(0)
    points, camera = (
        rng.normal(size=(40, 2)),
        {"position": (0.3, -0.2), "angle": 0.7, "scale": 1.3, "mirrored": mirrored},
    )
    c, s = np.cos(0.7), np.sin(0.7)
    away = points - [0.3, -0.2]
    seen = 1.3 * np.column_stack([away @ [c, s], (-1 if mirrored else 1) * (away @ [-s, c])])
    way, left = camera_through(points, seen, Mounting(camera={"mirrored": mirrored}))
    found = way.camera
    assert [*found.position, found.angle, found.scale] == pytest.approx([0.3, -0.2, 0.7, 1.3])
    assert left < 1e-12
    assert camera_through(points, seen, Mounting(camera={"mirrored": not mirrored}))[1] > 0.5
    wired = Wiring.of(Mounting(camera=camera), Wiring.TIP, (), "mounting").readings
    assert np.array([wired(one) for one in points]) == pytest.approx(seen)
    assert np.array([wired.back(one) for one in seen]) == pytest.approx(points)


def test_what_is_missing_stays_alone():
    mounting = Mounting(camera={"angle": 0.1}, tensions=(Connection(of=2, zero=1.0), Connection(of=1, sign=-1)))
    wired = Wiring.of(mounting, (*Wiring.TIP, *TENSIONS), TENSIONS, "mounting").readings
    assert np.isnan(wired([np.nan, 0.1, 2.0, 3.0])).tolist() == [True, True, False, False]
    assert wired([0.0, 0.0, 2.0, np.nan])[2:] == pytest.approx([np.nan, -2.0], nan_ok=True)
    assert wired([0.0, 0.0, 2.0, 3.0])[2:] == pytest.approx([4.0, -2.0])


def test_lines_are_checked():
    with pytest.raises(ValueError, match="once as `of`"):
        Mounting(drives=(Connection(of=1), Connection(of=1)))
    with pytest.raises(InputError, match="expected 2 lines"):
        Wiring.of(Mounting(drives=(Connection(of=1),)), Wiring.TIP, TENSIONS, "mounting")


def test_a_plant_whose_mounting_is_known_is_as_the_model():
    """Two errors that undo each other."""
    mounting = Mounting(
        camera=dict(**CAMERA),
        drives=(Connection(of=2, zero=0.4), Connection(of=1)),
        tensions=(Connection(of=2), Connection(of=1)),
    )
    plain, wired = Plant(scene(noise=0.0)), Plant(scene(mounting, mounting, noise=0.0))
    for one in (plain, wired):
        for _ in range(10):
            one.advance([6.0, 2.0])
    assert wired.measure() == pytest.approx(plain.measure(), abs=1e-12)
    assert wired.acting(np.array([6.0, 2.0])) == pytest.approx([6.0, 2.0])
    turned = Plant(scene(Mounting(drives=(Connection(of=1, sign=-1), Connection(of=2)))))
    assert turned.acting(np.array([6.0, 2.0])) == pytest.approx([0.0, 2.0])  # a tendon does not push


@cache
def planned():
    return design_commissioning(scene(), duration=3.0)


def test_a_motion_begins_at_rest_under_its_first_command():
    """Also after tendons that did not pull at all on a finger that hangs straight."""
    bench = Bench(scene(gravity=(0.0, -9.81)))
    p, t = bench.parameters([unknown.start for unknown in bench.unknowns]), np.arange(0.0, 0.05, 0.01)
    for tensions in ((1.8, 1.8), (0.0, 1.8), (0.0, 0.0), (1.8, 1.8)):
        begins = dict(
            zip(bench.model.x_names, bench.moved(t, np.tile(tensions, (t.size, 1)), p, t[-1])[1][0], strict=True)
        )
        assert [begins[name] for name in TENSIONS] == pytest.approx(tensions, abs=1e-9)


@pytest.mark.parametrize("at", [0.05, 0.0512])
def test_commands_are_held_from_their_instants_on(at):
    """Tensions after a step, by the closed form of two equal lags; a sixth of a step of the motion earlier is 0.2 N."""
    bench, lag = Bench(scene()), SCENE["finger"]["tendons"]["time_constant"]
    t, u = np.array([0.0, at, at + 0.03]), np.array([[2.0, 3.0], [20.0, 3.0], [9.0, 3.0]])
    values = np.array([unknown.start for unknown in bench.unknowns])
    log = Log(t, u, np.array([0.0, 0.2]), np.zeros((2, 4)), bench.names)
    instants, shown = bench.shown(log, Mounting(), values)

    def risen(time):
        return np.where(time > 0.0, 1.0 - (1.0 + time / lag) * np.exp(-time / lag), 0.0)

    expected = 2.0 + 18.0 * risen(instants - at) - 11.0 * risen(instants - at - 0.03)
    assert np.abs(shown[:, 2] - expected).max() < 0.06
    assert shown[:, 3] == pytest.approx(3.0)


def test_commands_without_a_cell_stay_as_they_were(tmp_path):
    """Of a logger that writes what changes; and times in ms, read as s, are refused before the motion is followed."""
    tried, file = scene(), tmp_path / "log.csv"
    rows = [f"{0.01 * k:g},{2 + k // 20 if k % 20 == 0 else ''},3,0,0.18,2,3" for k in range(60)]
    names = "tip_x [m],tip_y [m],tension_1 [N],tension_2 [N]"
    file.write_text("\n".join([f"t,commanded_tension_1 [N],commanded_tension_2 [N],{names}", *rows]))
    log, _ = _log_of(tried, Bench(tried), file)
    assert log.u[:, 0].tolist() == [2.0] * 20 + [3.0] * 20 + [4.0] * 20
    text = file.read_text().splitlines()
    file.write_text("\n".join([text[0], *(f"{1e4 * k:g},{row.partition(',')[2]}" for k, row in enumerate(text[1:]))]))
    with pytest.raises(InputError, match=r"is t in us\? Write t \[us\]"):
        commission(tried, file)


def test_readings_of_other_instants_count_up_to_their_age(tmp_path):
    """Load cells that are read 4 ms before the camera; the last twenty rows of theirs are missing."""
    tried, file = scene(), tmp_path / "log.csv"
    rows = [f"{0.01 * k:g},2,3,0,{0.1 + 0.001 * k:g},," for k in range(1, 101)]
    cells = [f"{0.01 * k - 0.004:g},,,,,2,{k}" for k in range(1, 81)]
    names = "commanded_tension_1 [N],commanded_tension_2 [N],tip_x [m],tip_y [m],tension_1 [N],tension_2 [N]"
    lines = sorted((*rows, *cells), key=lambda row: float(row.split(",")[0]))
    file.write_text("\n".join([f"t [s],{names}", *lines]))
    aged = tried.changed({"log.max_age": 0.005})
    log, _ = _log_of(aged, Bench(aged), file)
    at = {name.split(" ")[0]: k for k, name in enumerate(log.names)}
    assert log.at == pytest.approx(0.01 * np.arange(1, 81))
    assert log.readings[:, at["tension_2"]].tolist() == [*range(1, 81)]
    for changed in (tried, tried.changed({"log.max_age": 0.003})):
        with pytest.raises(InputError, match="0 instants with all readings"):
            _log_of(changed, Bench(changed), file)


@pytest.mark.deep
def test_the_plan_is_safe_on_another_plant():
    """Commands within limits and rates; a softer plant, with drives in either order, within its bending range."""
    plan = planned()
    assert plan.commands.min() >= 1.0
    assert plan.commands.max() <= 60.0
    assert np.abs(np.diff(plan.commands, axis=0)).max() <= 600.0 * 0.01 + 1e-9
    plant = Plant(scene(stiffness=0.85))
    for order in ([0, 1], [1, 0]):
        for u in plan.commands[::1]:
            plant.advance(u[order])
            assert np.abs(plant.x[: plant.model.system.n]).max() < 200.0


@pytest.mark.deep
def test_a_zone_holds_the_plan_back():
    near = {"wall": {"type": "half_plane", "point": (0.06, 0.0), "normal_angle": np.pi, "of": "tip"}}
    walled = scene().changed({"controller.bounds.keep_out": near})
    plan = design_commissioning(walled, duration=3.0)
    assert plan.commands.max() < planned().commands.max()
    plant = Plant(scene(stiffness=0.9))
    reach = []
    for u in plan.commands:
        plant.advance(u)
        reach.append(float(plant.model.function("t", tip=plant.model.tip)(plant.x, u, plant.model.forces(0.0)[0])[0]))
    assert 0.02 < max(reach) < 0.06


def errors(found, true):
    """Of the camera's view of four places within reach [m], and of zeros [N]."""
    one, other = (
        Wiring.of(Mounting(camera=m.camera), Wiring.TIP, (), "mounting").readings for m in (true, found.mounting)
    )
    places = ([0.0, 0.18], [0.09, 0.14], [-0.09, 0.14], [0.03, 0.17])
    seen = max(np.linalg.norm(other.back(one(place)) - place) for place in places)
    zeros = [
        abs(a.zero - b.zero)
        for key in ("drives", "tensions")
        for a, b in zip(getattr(found.mounting, key), getattr(true, key), strict=True)
    ]
    return seen, max(zeros)


@pytest.mark.deep
@pytest.mark.parametrize("seed", range(3))
def test_a_bench_mounted_at_random_is_found(seed):
    rng = np.random.default_rng(seed)
    order, shared = rng.permutation(2) + 1, rng.uniform(-0.4, 0.4)
    true = Mounting(
        camera={
            "position": tuple(rng.uniform(-0.01, 0.01, 2)),
            "angle": rng.uniform(-0.14, 0.14),
            "scale": rng.uniform(0.9, 1.1),
            "mirrored": bool(seed % 2),
        },
        drives=tuple(Connection(of=int(k), zero=shared * (1 if k == 1 else -1)) for k in order),
        tensions=tuple(
            Connection(of=int(k), sign=int(rng.choice([-1, 1])), zero=rng.uniform(-5.0, 5.0))
            for k in rng.permutation(2) + 1
        ),
    )
    found = commission(scene(true), duration=6.0)
    assert found.status == "identified", found.undetermined
    for key in ("drives", "tensions"):
        assert [(a.of, a.sign) for a in getattr(found.mounting, key)] == [(a.of, a.sign) for a in getattr(true, key)]
    assert found.mounting.camera.mirrored == true.camera.mirrored
    seen, zero = errors(found, true)
    assert seen < 1.5e-3
    assert zero < 0.25
    assert found["bending_stiffness"] == pytest.approx(1.12 * SCENE["finger"]["rod"]["bending_stiffness"], rel=5e-3)
    assert found["material_damping"] == pytest.approx(1.3 * SCENE["finger"]["damping"]["material"], rel=1e-2)
    assert found["drive_time_constant"] == pytest.approx(0.026, abs=5e-4)
    assert found["drive_delay"] == pytest.approx(0.023, abs=1e-3)
    corrected = found.apply()
    assert corrected.estimator.delay == pytest.approx(0.02)
    assert corrected.mounting == found.mounting


@pytest.mark.deep
def test_a_flat_finger_does_not_show_which_side_is_up():
    """Mirrored camera and exchanged tendons look alike without gravity, unless the camera is known."""
    true = Mounting(camera=dict(**CAMERA, mirrored=True), drives=(Connection(of=2), Connection(of=1)))
    log = None
    for known in (None, Mounting(camera={"mirrored": True})):
        tried = scene(true, known, gravity=(0.0, 0.0))
        found = commission(tried, log, duration=4.0)
        log = found.log or log
        if known is None:
            assert found.status == "undecided"
            assert len(found.alternatives) == 2
            assert not found.usable
            with pytest.raises(InputError, match="undecided"):
                found.apply()
        else:
            assert found.status == "identified"
            assert [line.of for line in found.mounting.drives] == [2, 1]


@pytest.mark.deep
def test_a_drive_that_turns_the_other_way_is_not_guessed():
    """From one log it may be dead as well; a second plan, with its sign turned, shows it."""
    true = Mounting(
        drives=(Connection(of=1), Connection(of=2, sign=-1)), tensions=(Connection(of=2, sign=-1), Connection(of=1))
    )
    tried = scene(true)
    found = commission(tried, duration=4.0)
    assert [(line.of, line.sign) for line in found.mounting.tensions] == [(2, -1), (1, 1)]
    assert found.status == "identified"
    assert [line.sign for line in found.mounting.drives] == [1, -1]
    once = scene(true, Mounting(drives=(Connection(of=1), Connection(of=2))))
    alone = commission(once, duration=4.0)  # which commands as it did
    assert alone.status == "undecided"
    assert any("drive 2 moves nothing" in one for one in alone.undetermined)


@pytest.mark.deep
def test_a_log_of_another_finger_is_no_bench(tmp_path):
    log = commission(scene(), duration=4.0).log
    wrong = ControlLog(log.t, log.u, log.y[np.random.default_rng(0).permutation(len(log.y))], log.u_names, log.y_names)
    assert commission(scene(), wrong).status != "identified"
    file = tmp_path / "log.csv"
    file.write_text("t,tip_x,tip_y\n0,0,0.18\n0.01,0,0.18\n")
    with pytest.raises(InputError, match="no commanded_tension_1"):
        commission(scene(), file)


def test_what_cannot_be_commissioned_is_refused():
    blind = ControlScene(**{key: value for key, value in SCENE.items() if key != "estimator"})
    with pytest.raises(InputError, match=r"estimator\.measured\.tip"):
        design_commissioning(blind)
    with pytest.raises(InputError, match="drives that take tensions"):
        design_commissioning(CONFIGS / "mpc/winches.yaml")


@pytest.mark.deep
def test_the_commands(tmp_path):
    """A plan, a log of it, and the corrected configuration, which is one."""
    config = tmp_path / "bench.yaml"
    config.write_text((CONFIGS / "mpc/steady_tip.yaml").read_text().replace("../fingers", str(CONFIGS / "fingers")))
    runner = CliRunner()
    plan = runner.invoke(app, ["commission", str(config), "--duration", "4", "--out", str(tmp_path / "plan")])
    assert plan.exit_code == 0, plan.output
    assert (tmp_path / "plan" / "excitation.csv").read_text().startswith("t [s],commanded_tension_1 [N]")
    stated = ["--set", "mounting.camera.mirrored=false", "--duration", "4", "--no-pictures"]
    done = runner.invoke(app, ["commission", str(config), "--plant", *stated, "--out", str(tmp_path / "run")])
    assert done.exit_code == 0, done.output
    assert isinstance(cg.load(tmp_path / "run" / "commissioned.yaml"), ControlScene)
    read = runner.invoke(
        app, ["commission", str(config), str(tmp_path / "run" / "log.csv"), *stated, "--out", str(tmp_path / "read")]
    )
    assert read.exit_code == 0, read.output
    both = runner.invoke(app, ["commission", str(config), str(tmp_path / "run" / "log.csv"), "--plant"])
    assert both.exit_code == 2
