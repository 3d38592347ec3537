"""The command line: verbs, exit codes, what is printed where, and what is not imported."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from typer.main import get_command

import continuum_grasp
from continuum_grasp.base import NumericalError, SolverError
from continuum_grasp.cli import app
from continuum_grasp.scene import kinds
from continuum_grasp.simulation import Trajectory
from tests.commands import ROOT, run

RELEASE = str(ROOT / "configs/simulate/nitinol_release_020g.yaml")
STEADY = str(ROOT / "configs/mpc/steady_tip.yaml")
FINGER = str(ROOT / "configs/fingers/nitinol_60cm.yaml")
HEAVY = ("casadi", "numpy", "matplotlib", "pydantic", "scipy", "yaml", "rich")


def fresh(code):
    """What a new interpreter prints."""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return found.stdout.strip()


@pytest.mark.parametrize("module", ["continuum_grasp", "continuum_grasp.cli"])
def test_importing_loads_nothing_heavy(module):
    loaded = fresh(f"import {module}, sys; print(*(m for m in {HEAVY!r} if m in sys.modules))")
    assert loaded == ""


def test_help_needs_nothing_heavy():
    code = (
        "import sys\nsys.argv = ['continuum-grasp', '--help']\nfrom continuum_grasp.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    print('loaded:', *(m for m in "
        f"{HEAVY[:-1]!r} if m in sys.modules))"
    )
    assert fresh(code).endswith("loaded:")


def test_linear_algebra_of_computations_takes_one_thread_unless_the_environment_says_otherwise():
    code = (
        "import os, sys\nfor name in [n for n in os.environ if n.endswith('_THREADS')]: del os.environ[name]\n"
        "import numpy\nfrom threadpoolctl import threadpool_info, threadpool_limits\n"
        "from continuum_grasp.base import interrupt\nthreadpool_limits(2)\n"
        "def count(): return {each['num_threads'] for each in threadpool_info()}\n"
        "def seen():\n    with interrupt.interruptible(): return count(), os.environ.get('OPENBLAS_NUM_THREADS')\n"
        "print(seen(), count(), 'OPENBLAS_NUM_THREADS' in os.environ)\n"
        "os.environ['OMP_NUM_THREADS'] = '2'\nprint(seen())"
    )
    assert fresh(code).splitlines() == ["({1}, '1') {2} False", "({2}, None)"]


def test_public_names_are_all_there():
    for name in continuum_grasp.__all__:
        assert getattr(continuum_grasp, name) is not None
        assert name in {"__version__", *dir(continuum_grasp)}
    with pytest.raises(AttributeError, match="attribute nothing"):
        continuum_grasp.nothing  # noqa: B018


def test_version():
    assert run("--version").output.strip() == f"continuum-grasp {continuum_grasp.__version__}"
    code = "from continuum_grasp.cli import main; import sys; sys.argv = ['x', '--version']; main()"
    assert continuum_grasp.__version__ in fresh(code)


@pytest.mark.parametrize(
    "arguments",
    [
        ("simulate", "none.yaml"),
        ("simulate", FINGER),
        ("simulate", RELEASE, "--set", "time.step=-1"),
        ("simulate", RELEASE, "--quiet", "--json"),
        ("simulate", RELEASE, "--out", FINGER),
        ("grasp", RELEASE),
        ("export", FINGER, "--to", "c"),
        ("schema", "other"),
        ("validate", "none.yaml"),
        ("no-such-verb",),
    ],
)
def test_bad_input_exits_with_2_and_says_why(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run(*arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr.strip()
    assert "Traceback" not in result.stderr
    assert not list(tmp_path.iterdir())


def test_validate_reports_every_file(tmp_path):
    bad = tmp_path / "bad.yaml"
    bad.write_text("schema_version: 1\n")
    result = run("validate", RELEASE, str(bad), FINGER)
    assert result.exit_code == 2
    assert result.stdout.splitlines() == [f"{RELEASE}: valid (simulate)", f"{FINGER}: valid (finger)"]
    assert f"{bad}:1:1: finger: missing" in result.stderr

    found = json.loads(run("validate", "--json", RELEASE, str(bad)).stdout)["files"]
    assert [one["valid"] for one in found] == [True, False]
    assert run("validate", "--quiet", RELEASE).output == ""


def test_validate_says_what_of_a_drawing_is_the_object(tmp_path):
    drawn = '<path id="plate" d="M0 0h40v20h-40z M9 9h3v3h-3z"/><text>A</text>'
    page = 'xmlns="http://www.w3.org/2000/svg" width="80mm" height="60mm" viewBox="0 0 80 60"'
    (tmp_path / "plate.svg").write_text(f"<svg {page}>{drawn}</svg>")
    scene = re.sub(
        r"(?s)object:\n.*?supports:",
        "object: {shape: outline, file: plate.svg, mass: 0.1, position: [0.02, 0]}\nsupports:",
        (ROOT / "configs/grasp/mug.yaml").read_text(),
    )
    (tmp_path / "plate.yaml").write_text(scene.replace("../fingers", str(ROOT / "configs/fingers")))
    said = "object: path 'plate' [1] (40 x 20 mm) of plate.svg; left out: path 'plate' [2] (3 x 3 mm): a hole, text"
    result = run("validate", str(tmp_path / "plate.yaml"))
    assert result.stdout.splitlines() == [f"{tmp_path}/plate.yaml: valid (grasp)", f"  {said}"]
    (found,) = json.loads(run("validate", "--json", str(tmp_path / "plate.yaml")).stdout)["files"]
    assert found["notes"] == [said]


@pytest.mark.parametrize("name", ["grasp/gear", "fingers/spirob", "sweep/mug_size_friction", "mission/turn_block"])
def test_validate_draws_the_scene_of_any_kind(tmp_path, name):
    from PIL import Image

    assert run("validate", str(ROOT / f"configs/{name}.yaml"), "--picture", str(tmp_path / "scene.png")).exit_code == 0
    with Image.open(tmp_path / "scene.png") as picture:
        shades = np.asarray(picture.convert("L"))
    assert min(shades.shape) > 300
    assert (shades < 250).mean() > 0.02


def test_validate_names_the_line_of_what_a_model_cannot_be(tmp_path):
    file = tmp_path / "scene.yaml"
    text = Path(RELEASE).read_text().replace("../fingers", str(ROOT / "configs/fingers"))
    file.write_text(text + "parameters:\n  - gravity\n  - tip_mas\n")
    count = len(file.read_text().splitlines())
    result = run("validate", str(file))
    assert result.stderr.startswith(f"{file}:{count}:5: parameters[1]: unknown parameter 'tip_mas'")
    assert run("validate", str(ROOT / "configs/grasp/mug.yaml"), "--set", "fidelity.bending_range=7").exit_code == 2


def test_what_is_found_late_is_placed_too(tmp_path):
    scene = ROOT / "configs/simulate/winch_loop.yaml"
    file = tmp_path / "scene.yaml"
    file.write_text(scene.read_text().replace("../fingers", str(ROOT / "configs/fingers")))
    (line,) = [k for k, words in enumerate(file.read_text().splitlines(), 1) if words.startswith("initial")]
    missing = "initial.reached_by: tendons with friction hold a finger anywhere between two shapes"
    for command in ("validate", "simulate", "modes"):
        result = run(command, str(file), "--set", "initial.pose=equilibrium")
        assert result.exit_code == 2
        assert f"{file}:{line}:1: {missing}" in result.stderr
    result = run("mpc", str(ROOT / "configs/mpc/steady_tip.yaml"), "--trials", "all", "--out", str(tmp_path))
    assert result.stderr == "error: --trials: works only for missions\n"


def test_an_animation_that_cannot_be_written_is_refused_before_any_work(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    refused = run("simulate", RELEASE, "--out", str(tmp_path / "out"), "--animate", "mp4")
    assert refused.exit_code == 2
    assert "--animate: mp4 needs ffmpeg" in refused.stderr
    assert not (tmp_path / "out").exists()


def test_schema_prints_and_writes(tmp_path):
    assert set(kinds()) <= {*re.findall(r"\w+", run("schema", "--help").stdout)}
    printed = json.loads(run("schema", "simulate").stdout)
    assert run("schema", "--out", str(tmp_path / "new")).exit_code == 0
    written = json.loads((tmp_path / "new" / "simulate.json").read_text().replace('"definitions.json#/', '"#/'))
    assert written == {key: value for key, value in printed.items() if key != "$defs"}
    assert {"finger", "gravity"} <= set(printed["required"])


# the verbs that compute, with a stand-in for what they call
class FakeTrajectory(SimpleNamespace):
    """As much of a trajectory as the command line touches."""

    def __init__(self):
        zero = np.zeros(3)
        super().__init__(t=np.arange(3.0), tip=np.ones((3, 2)), kinetic=zero, potential=zero + 1.5)
        self.status, self.warnings, self.statistics = "done", ["too bent"], {"substeps": 4}
        self.time_error, self.space_error, self.static_error, self.length = 2e-5, 3e-3, math.nan, 0.5

    kind, texts, pairs = Trajectory.kind, Trajectory.texts, Trajectory.pairs
    _space_error_text = Trajectory._space_error_text

    def save(self, folder):
        Path(folder).mkdir(parents=True)
        (Path(folder) / "result.npz").touch()


@pytest.fixture
def pretend(monkeypatch, tmp_path):
    """Replace functions of a module, and stand in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def _pretend(name, **names):
        module = ModuleType(name)
        vars(module).update(names)
        monkeypatch.setitem(sys.modules, name, module)

    return _pretend


def test_simulate_saves_and_reports(pretend):
    seen = []
    pretend("continuum_grasp.simulation", simulate=lambda scene, progress=None: seen.append(scene) or FakeTrajectory())
    result = run("simulate", RELEASE, "--no-pictures", "--set", "time.duration=0.5", "-v")
    assert result.exit_code == 0, result.output
    assert seen[0].time.duration == 0.5
    assert Path("runs/simulate/nitinol_release_020g/result.npz").exists()
    assert "warning: too bent" in result.stderr
    assert "substeps" in result.stdout
    assert "time error      about 2e-05 of the length, 0.01 mm" in result.stdout
    assert "space error     about 0.003 of the length, 1.5 mm" in result.stdout

    found = json.loads(run("simulate", RELEASE, "--no-pictures", "--out", "here", "--json").stdout)
    assert found["folder"] == "here"
    assert found["energy"] == [1.5, 1.5]
    assert (found["time_error"], found["space_error"]) == (2e-5, 3e-3)
    assert run("simulate", RELEASE, "--no-pictures", "--out", "quiet", "-q").stdout == ""


def test_numerical_failure_exits_with_1_and_saves_what_there_is(pretend):
    def simulate(scene, progress=None):
        raise NumericalError("not finite at 0.1 s", time=0.1, result=FakeTrajectory())

    pretend("continuum_grasp.simulation", simulate=simulate)
    result = run("simulate", RELEASE)
    assert result.exit_code == 1
    assert "error: not finite at 0.1 s" in result.stderr
    assert "the results so far are in runs/simulate/nitinol_release_020g" in result.stderr
    assert Path("runs/simulate/nitinol_release_020g/result.npz").exists()


def test_solver_failure_exits_with_1(pretend):
    def modes(scene):
        raise SolverError("no equilibrium", status="diverged", advice="load it in steps")

    pretend("continuum_grasp.simulation", modes=modes)
    result = run("modes", RELEASE)
    assert result.exit_code == 1
    assert result.stderr == "error: no equilibrium (status: diverged)\nload it in steps\n"


def test_modes_prints_a_table(pretend):
    found = SimpleNamespace(
        frequencies_hz=np.array([2.5, 15.7]),
        space_error=np.array([0.002, 0.17]),
        damping_ratios=np.array([0.01, np.nan]),
        stable=True,
        status="stable",
        outcome="stable",
        statistics={},
        warnings=(),
        stuck_frequencies_hz=None,
        free_frequencies_hz=None,
    )
    pretend("continuum_grasp.simulation", modes=lambda scene: found)
    lines = run("modes", RELEASE).stdout.splitlines()
    assert lines[0].split() == ["mode", "frequency", "[Hz]", "space", "error", "damping", "ratio"]
    assert lines[2].split() == ["2", "15.7", "0.17", "-"]
    assert json.loads(run("modes", RELEASE, "--json").stdout)["frequencies_hz"] == [2.5, 15.7]


OPTIONS = {
    "no such option: --foo": ("simulate", RELEASE, "--foo"),
    "no such command 'foo'": ("foo",),
    "no such option: --bad": ("--bad",),
    "missing argument 'CONFIG'": ("simulate",),
    "missing option '--to'": ("export", RELEASE),
    "invalid value for '--animate'": ("simulate", RELEASE, "--animate", "avi"),
    "invalid value for '--to': expected c, casadi, mjcf, fmu or web, got 'zip'": ("export", RELEASE, "--to", "zip"),
    "--measure: has no effect on --to mjcf": ("export", RELEASE, "--to", "mjcf", "--measure"),
    "export-c: write export CONFIG --to c": ("export-c", RELEASE, "--what", "step"),
}


@pytest.mark.parametrize("said", OPTIONS)
def test_what_is_wrong_with_options_is_one_line(said):
    result = run(*OPTIONS[said])
    assert result.exit_code == 2
    assert result.stderr.startswith(f"error: {said}")
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(("most", "status", "verdict"), [(16_800_000, 0, "fits"), (16_800_001, 1, "does not fit")])
def test_calls_are_shares_of_the_period_of_a_clock(monkeypatch, tmp_path, most, status, verdict):
    """Of 100 ms at 168 MHz, which has 16.8 million cycles."""
    counted = {"mean_instructions": 4_200_000, "most_instructions": most, "stack_bytes": 100}
    made = {
        "functions": {"mpc": {"test_cases": 1}},
        "measured": {"functions": {"mpc": counted}},
        "loop": {"period_s": 0.1},
        "real": "float",
        "configuration_hash": "0",
    }
    found = SimpleNamespace(manifest=made, folder=tmp_path, files=())
    monkeypatch.setattr("continuum_grasp.export.export_c", lambda scene, out, measured: found)
    monkeypatch.setattr("continuum_grasp.export.PackageOptions", lambda measured: None)  # host has no board
    line = ["export", STEADY, "--to", "c", "--out", str(tmp_path / "c"), "--measure", "--clock", "168MHz"]
    result = run(*line)
    assert result.exit_code == status
    assert f"mpc: 25% of the period in the mean, 100% at most: {verdict}" in result.stdout


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--measure", "--clock", "168"), "168MHz"),
        (("--clock", "168MHz"), "needs --measure"),
        (("--measure", "--clock", "0 Hz"), "expected a frequency"),
        # Before the package is made, which takes its time: host has no board, of which export_c would speak.
        (("--measure", "--clock", "168MHz"), "needs the period of a closed loop or mission"),
    ],
)
def test_clocks_that_cannot_be_are_refused(options, said):
    result = run("export", RELEASE, "--to", "c", *options)
    assert result.exit_code == 2
    assert said in result.stderr


@pytest.mark.parametrize(
    ("name", "line", "said"),
    [
        ("mug", "c --what mpg", "what: expected some of"),
        ("mug", "c --target cortex-m9", "target: expected one of host"),
        ("mug", "c --target cortex-m4f --real double", "real: cortex-m4f computes double in software"),
        ("mug", "c --prefix int", "prefix: expected a C identifier"),
        ("mug", "c --measure", "target: host has no emulated board"),
        ("pinch", "c", "finger: expected one of"),
        ("pinch", "c --finger middle", "got 'middle'"),
        ("pinch", "fmu --finger middle", "got 'middle'"),
        ("mug", "fmu --what plant", "what: a mission has only a controller"),
        ("mug", "fmu --step 0.001", "step: is for a simulated scene"),
        ("mug", "fmu --preview", "preview: follows its phases"),
        ("mug", "casadi --what tips", "what: expected some of"),
        ("pinch", "web", "a page shows one finger"),
    ],
)
def test_options_of_an_export_are_refused_before_the_grasp_of_a_mission_is_optimized(
    name, line, said, monkeypatch, tmp_path
):
    def optimized(*_, **__):
        raise AssertionError("the grasp was optimized first")

    monkeypatch.setattr("continuum_grasp.addons.mission.assign_mission", optimized)
    monkeypatch.setattr("continuum_grasp.addons.mission.exported.assign_mission", optimized)
    line = ["export", str(ROOT / f"configs/mission/{name}.yaml"), "--to", *line.split(), "--out", str(tmp_path / "out")]
    result = run(*line)
    assert result.exit_code == 2
    assert said in result.stderr
    assert not (tmp_path / "out").exists()


def test_help_fits_80_columns_and_no_summary_is_cut(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for verb in ("", *get_command(app).commands):
        text = run(*verb.split(), "--help").stdout
        assert max(map(len, text.splitlines())) <= 80
        assert "..." not in text.partition("Commands:")[2]


OF_OTHERS = {
    "simulate": ("hanging.yaml", "a scene"),
    "grasp": ("mug.yaml", "a grasp"),
    "mpc": ("pulse.yaml", "a closed loop"),
    "mission": ("mug.yaml", "a mission"),
    "plan": ("tip_to_point.yaml", "a plan"),
    "sweep": ("finger_design.yaml", "a sweep"),
}
TAKES = {"simulate": ["simulate"], "grasp": ["grasp"], "plan": ["plan"], "mpc": ["mpc", "mission"]}


@pytest.mark.parametrize(("command", "kind"), [(c, k) for c in TAKES for k in OF_OTHERS if k not in TAKES[c]])
def test_a_file_of_another_kind_is_reported_with_its_own_command(command, kind):
    name, called = OF_OTHERS[kind]
    result = run(command, str(Path(__file__).parents[2] / "configs" / kind / name))
    assert result.exit_code == 2
    assert f"got {called} (continuum-grasp {'mpc' if kind == 'mission' else kind})" in result.stderr
