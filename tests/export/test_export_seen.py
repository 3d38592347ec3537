"""Parts of what is seen of a finger: shape, velocities and contact against the models."""

from __future__ import annotations

import subprocess

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp import System
from continuum_grasp.base import InputError
from continuum_grasp.export import export_c
from tests.export_cases import DISC, MUG, needs, scene, shared_library, values


def moving(name):
    """A scene whose finger moves, its system, a state with rates, and an input."""
    given = cg.load(name) if not isinstance(name, str) else scene(name)
    system = System(given)
    rng = np.random.default_rng(5)
    x = np.array(system.state()) + 0.05 * rng.normal(size=system.nx)
    return given, system, x, np.abs(rng.normal(size=system.nu))


@pytest.mark.parametrize("name", ["arcs", "tendons", "friction", "winches", "contact", DISC], ids=str)
def test_velocities_of_sections_are_differences_of_their_positions(name):
    given, system, x, u = moving(name)
    p, at = system.p_nominal, np.linspace(0.0, given.finger.rod.length, 7).tolist()
    rate = np.array(system.forward_dynamics(x, u, np.zeros(system.nw), p)).ravel()
    # Positions do not depend on rates, whose own ones are large.
    rate[[name.endswith("/s]") for name in system.x_names]] = 0.0
    h = 1e-6
    ahead, back = ([np.array(v) for v in system.sections(at)(x + s * h * rate, u, p)] for s in (1.0, -1.0))
    for found, a, b in zip(system.section_velocities(at)(x, u, p), ahead, back, strict=True):
        expected = (a - b) / (2.0 * h)
        np.testing.assert_allclose(np.array(found).ravel(), expected.ravel(), atol=1e-6 * abs(expected).max())


@needs("cc")
@pytest.mark.parametrize(("name", "real"), [("tendons", "double"), ("arcs", "float")])
def test_a_shape_and_its_velocities_are_those_of_the_model(name, real, tmp_path):
    given, system, x, u = moving(name)
    export_c(given, tmp_path / "made", what=["shape", "velocities"], real=real, sections=9, substeps=16)
    (tmp_path / "made" / "build").mkdir()
    finger, library = shared_library(tmp_path / "made", tmp_path / "made" / "build")
    at = np.linspace(0.0, sum(system.finger_model.lengths), 9).tolist()
    acting = finger.State(*x[: system.finger_model.nx]), finger.Input(*u)
    shape, motion = library.shape(*acting), library.velocities(*acting)
    r, angle = (np.array(v) for v in system.sections(at)(x, u, system.p_nominal))
    v, spin = (np.array(one) for one in system.section_velocities(at)(x, u, system.p_nominal))
    pairs = [(shape.x, r[0]), (shape.y, r[1]), (shape.angle, angle)]
    pairs += [(motion.x, v[0]), (motion.y, v[1]), (motion.spin, spin)]
    for found, expected in pairs:
        bound = (1e-5 if real == "float" else 1e-13) * max(abs(expected).max(), 1e-3)
        np.testing.assert_allclose(list(found), expected.ravel(), atol=bound)


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    """Packages of a fixed disc and of a mug that moves, with their bindings."""
    found = {}
    for file in (DISC, MUG):
        folder = tmp_path_factory.mktemp(file.stem)
        what, ranges = ["dynamics", "contact"], {"contact_force": (0.0, 1e6)}
        manifest = export_c(file, folder, what=what, target="wasm", ranges=ranges).manifest
        (folder / "build").mkdir()
        found[file] = (folder, manifest, *shared_library(folder, folder / "build"))
    return found


@needs("cc")
@pytest.mark.parametrize("file", [DISC, MUG], ids=lambda file: file.stem)
def test_contact_is_that_of_the_system(file, packages):
    _, manifest, finger, library = packages[file]
    given = cg.load(file)
    fixed = not given.object_moves
    system = System(given, object_parameters=("object_x", "object_y") if fixed else ())
    rng, own = np.random.default_rng(2), system.finger_model.nx
    half, worst = 0.5 * given.object.diameter, 0.0
    for _ in range(20):
        x, p = np.array(system.state()), np.array(system.p_nominal)
        x[: system.n] += 2.0 * rng.normal(size=system.n)
        x[system.n : 2 * system.n] += rng.normal(size=system.n)
        x[own:] += 0.3 * rng.normal(size=system.nx - own)
        u, w = np.abs(rng.normal(size=system.nu)), 0.01 * rng.normal(size=system.nw)
        place = np.array(system.tip(x, u, p)).ravel() + np.array([half, 0.0])
        place += 0.02 * rng.normal(size=2)  # some of these are pressed, some are not
        if fixed:
            p[-2:] = place
        else:
            x[own : own + 2] = place
        if fixed:
            library.model.parameters.object_x, library.model.parameters.object_y = place
        acting = finger.State(*x), finger.Input(*u)
        given_forces = [finger.Forces(*w)] if system.nw else []
        seen = library.touch(*acting, *([] if fixed else given_forces))
        true = dict(zip(system.touch.name_out(), map(np.array, system.touch(x, u, w, p)), strict=True))
        for field, _ in seen._fields_:
            name, _, axis = field.rpartition("_")
            value = true[name]["xy".index(axis)] if axis in ("x", "y") else true[field].ravel()
            np.testing.assert_allclose(list(getattr(seen, field)), value, rtol=1e-9, atol=1e-9)
        worst = max(worst, true["normal_force"].max())
        rates = library.dynamics(*acting, *given_forces)
        expected = np.array(system.forward_dynamics(x, u, w, p)).ravel()
        found = values(rates)
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9 * abs(expected).max())
    assert worst > 0.01  # surfaces were pressed
    assert manifest["structs"]["contacts"][0]["shape"] == [len(system.touch_names)]


@needs("clang", "wasm-ld", "node")
@pytest.mark.parametrize("file", [DISC, MUG], ids=lambda file: file.stem)
def test_the_same_bits_in_webassembly(file, packages):
    folder = packages[file][0]
    subprocess.run(["sh", folder / "wasm" / "build.sh"], check=True, capture_output=True)
    vectors = subprocess.run(["node", folder / "wasm" / "test.mjs"], capture_output=True, text=True, check=False)
    assert vectors.returncode == 0, vectors.stdout + vectors.stderr


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"what": ["contact"]}, "object"),
        ({"what": ["shape", "metadata"]}, "MANIFEST.json: leave metadata out"),
        ({"what": ["shape"], "sections": 1}, "from 2 to 200"),
        ({"what": ["shape"], "sections": 201}, "from 2 to 200"),
    ],
)
def test_what_cannot_be_seen_is_refused(options, message, tmp_path):
    with pytest.raises(InputError, match=message):
        export_c(scene("arcs"), tmp_path, **options)
    assert not list(tmp_path.iterdir())
