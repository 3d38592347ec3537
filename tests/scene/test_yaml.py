"""Reading configurations: YAML 1.2 scalars, limits, and errors that name file, line, column and key."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from continuum_grasp.base import InputError
from continuum_grasp.scene import Finger, Scene, VectorSamples, load, read_yaml

ROD = "{length: 0.6, diameter: 0.002, density: 6450, youngs_modulus: 60e9}"
HEAD = f"schema_version: 1\ngravity: [0, -9.81]\nfinger:\n  rod: {ROD}\n"


@pytest.fixture(scope="module")
def parsed(tmp_path_factory):
    """Write a file and read it; errors name it without its folder."""
    file = tmp_path_factory.mktemp("parsed") / "file.yaml"

    def _parsed(text: str):
        file.write_text(text, encoding="utf-8")
        return read_yaml(file, name=file.name)

    return _parsed


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write files and stand in their folder, so that errors name them without a path."""
    monkeypatch.chdir(tmp_path)

    def _write(text: str, name: str = "scene.yaml") -> str:
        Path(name).write_text(text, encoding="utf-8")
        return name

    return _write


def complaint(text_file: str, **kwargs) -> list[str]:
    """The lines of the error that loading raises."""
    with pytest.raises(InputError) as caught:
        load(text_file, **kwargs)
    return str(caught.value).splitlines()


# scalars: the tables of YAML 1.2.2, sections 10.3.2 and 10.3.3
@pytest.mark.parametrize(
    ("text", "value"),
    [
        *[(t, 1e6) for t in ("1e6", "1.0e6", "1E+6", "1000000.", "10e5", "+1e6")],
        *[
            ("0.5", 0.5),
            (".5", 0.5),
            ("-.5e-3", -5e-4),
            ("60e9", 60e9),
            (".inf", math.inf),
            ("-.INF", -math.inf),
        ],
        *[("7", 7), ("-7", -7), ("+7", 7), ("007", 7), ("0o17", 15), ("0x1F", 31)],
        *[(t, True) for t in ("true", "True", "TRUE")],
        *[(t, False) for t in ("false", "False", "FALSE")],
        *[(t, None) for t in ("null", "Null", "NULL", "~", "")],
        *[(t, t) for t in ("on", "off", "yes", "no", "Yes", "y", "n", "tRUE", "nil", "inf", "nan", "1_000", "12:30")],
        *[(t, t) for t in ("2020-01-01", "0b11", "1e", "e5", "=", "1.2.3", "0.6 m")],
        *[('"1e6"', "1e6"), ("'true'", "true"), ('""', "")],
    ],
)
def test_scalars(parsed, text, value):
    got = parsed(f"key: {text}").value["key"]
    assert got == value
    assert type(got) is type(value)


@given(x=st.floats(allow_nan=False, allow_infinity=False))
def test_every_float_that_python_writes_is_read(parsed, x):
    got = parsed(f"[{x!r}]").value[0]
    assert isinstance(got, float)
    assert got == x


@pytest.mark.parametrize(
    ("text", "line", "column", "words"),
    [
        ("a: 1\nb:\n  c: 1\n  c: 2", 4, 3, "b.c: duplicate key, first given in line 3"),
        ("a: 1\n<<: {b: 2}", 2, 1, "merge keys"),
        ("1: 2", 1, 1, "expected a word as key"),
        ("true: 2", 1, 1, "expected a word as key"),
        ("[a]: 2", 1, 1, "expected a word as key"),
        ("a: !!python/object:os.system x", 1, 4, "tags are not supported"),
        ("a: !own {b: 1}", 1, 4, "tags are not supported"),
        ("a: &x [*x]", 1, 4, "an alias may not contain itself"),
        ("a: *x", 1, 4, "undefined alias"),
        ("a: b: c", 1, 5, "not valid YAML"),
        ("a: [1,", 1, 7, "not valid YAML"),
        ("{a: 0,6, b: 0,002}", 1, 7, "expected a word as key, got '6' (write a decimal point, not a comma: 0.6)"),
        ("{a: -1,5e-3}", 1, 8, "(write a decimal point, not a comma: -1.5e-3)"),
        ("{a: x, 6: 3}", 1, 8, "expected a word as key, got '6'"),
        ("a: 1e400", 1, 4, "a: too large: expected a number up to 1.8e308, got 1e400"),
        ("a: 1\n---\nb: 2", 2, 1, "single document"),
        ("a:\n\tb: 1", 2, 1, "not valid YAML"),
        ("a: 1\nb: \x07", 2, None, "not valid YAML"),
        ("[" * 100, 1, 41, "nested deeper"),
        ("a: " + "9" * 5000, 1, 4, "cannot be read as int"),
    ],
)
def test_refused_with_position(parsed, text, line, column, words):
    with pytest.raises(InputError) as caught:
        parsed(text)
    error = caught.value
    assert (error.file, error.line, error.column) == ("file.yaml", line, column)
    assert words in str(error)


@pytest.mark.deep
def test_aliases_are_capped_in_number_and_in_growth(parsed):
    with pytest.raises(InputError, match="more than 100 aliases"):
        parsed("a: &a 1\nb: [" + ",".join(["*a"] * 101) + "]")
    bomb = "a0: &a0 [1]\n" + "".join(f"a{k}: &a{k} [{','.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 10))
    with pytest.raises(InputError, match="counted in full"):
        parsed(bomb)


def test_aliases_are_copies(parsed):
    data = parsed("a: &x {b: 1}\nc: *x").value
    assert data == {"a": {"b": 1}, "c": {"b": 1}}
    assert data["a"] is not data["c"]


def test_files_that_cannot_be_read(tmp_path):
    large = tmp_path / "large.yaml"
    large.write_bytes(b"#" * (2_000_001))
    latin = tmp_path / "latin.yaml"
    latin.write_bytes(b"a: 1\nname: \xe9\n")
    for path, words in [
        (tmp_path / "none.yaml", "no such file"),
        (tmp_path, "folder"),
        (large, "too large"),
        (latin, "latin.yaml:2: the file is not UTF-8"),
    ]:
        with pytest.raises(InputError, match=words):
            read_yaml(path)


def test_byte_order_mark_is_not_part_of_the_first_key(write):
    Path("bom.yaml").write_bytes(b"\xef\xbb\xbf" + HEAD.encode())
    assert isinstance(load("bom.yaml"), Scene)


# validation, at the user's own lines
@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("contcts: [0.3]", "scene.yaml:5:1: contcts: unknown key; did you mean 'contacts'?"),
        ("initial: {q_above_rest: [0]}", "scene.yaml:5:11: initial.q_above_rest: unknown key; write 'q'"),
        (
            "closing: {}",
            "scene.yaml:5:1: closing: unknown key; write 'a scene of simulate with the object, or a mission'",
        ),
        ("fidelity: {residual: a.yaml}", "fidelity.residual: unknown key; write 'finger.tendons.friction, finger"),
        (
            "contacts: [true]",
            "scene.yaml:5:12: contacts[0]: wrong type: expected a length [m] such as 0.012 or 12 mm, got true",
        ),
        (
            "contacts: [0.3, .nan]",
            "scene.yaml:5:17: contacts[1]: not finite: expected a finite number, got .nan",
        ),
        ("time: {duration: 1e400, step: 1}", "scene.yaml:5:18: time.duration: too large: expected a number up to"),
        (
            "contacts: [1e-400]",
            "scene.yaml:5:12: contacts[0]: too small: expected 0 or a number from 5e-324 on, got 1e-400",
        ),
        (
            "time: {duration: -1, step: 1}",
            "scene.yaml:5:18: time.duration: out of range: expected a number greater than 0, got -1",
        ),
        ("time: {duration: 1}", "scene.yaml:5:1: time.step: missing; expected output step [s]"),
        ("contacts: [0.7]", "scene.yaml:5:12: contacts[0]: 0.7 m is not before the tip"),
        ("contacts: 0.3", "scene.yaml:5:11: contacts: wrong type: expected a list, got 0.3"),
        (
            "initial: {pose: strait}",
            "not one of the choices: expected 'straight', 'rest' or 'equilibrium', got text 'strait'",
        ),
        (
            "name: [1]",
            "scene.yaml:5:7: name: wrong type: expected text, got a list of 1",
        ),
        ("contacts: [0.1, 1,5, 0.2]", "contacts: contacts must increase, got [0.1, 1.0, 5.0, 0.2]"),
        ("name: n\ngravity: 0", "6:1: gravity: duplicate key"),
        (
            "time: {duration: 1.0e9, step: 1.0e-6}",
            "5:31: time.step: step = 1e-06 s over 1e+09 s asks for 1e+15 output states; at most 10000000 can be stored",
        ),
        ("initial: {pose: rest, qd: [1]}", "5:27: initial.qd: a named pose is at rest"),
        ("loads: [{kind: moment, at: 0.1, moment: {times: [0, 1e-12], values: [0, 1]}}]", "1e-9 s apart"),
        ("contacts: ['0.3']", "such as 0.012 or 12 mm, got text '0.3' (write it without quotes)"),
        (
            "contacts: [300 MM]",
            "expected a length [m] such as 0.012 or 12 mm, got text '300 MM' (units: m, cm, mm, um, in, ft, mil)",
        ),
        (
            "loads:\n- {kind: force, at: 0.1, force: [0, 1], follows: yes}",
            "6:50: loads[0].follows: wrong type: expected true or false, got text 'yes' (write true)",
        ),
        # inside unions, where pydantic's own locations carry the names of branches
        ("loads:\n- {at: 0.1, force: [0, 1]}", "6:3: loads[0].kind: missing; expected 'force' or 'moment'"),
        (
            "loads:\n- {kind: torque, at: 1}",
            "6:10: loads[0].kind: not one of the choices: expected 'force', 'moment'",
        ),
        ("loads:\n- {kind: force, force: [0, 1]}", "6:3: loads[0].at: missing"),
        (
            "loads:\n- {kind: force, at: 0.1, force: [1]}",
            "6:33: loads[0].force: the list is too short: expected 2 entries, got 1",
        ),
        (
            "loads:\n- {kind: force, at: 0.1, force: [1, x]}",
            "6:37: loads[0].force[1]: wrong type: expected a force [N] such as 25",
        ),
        (
            "loads:\n- {kind: force, at: 0.1, force: up}",
            "6:33: loads[0].force: wrong type: expected a list of 2 or a mapping with keys like times",
        ),
        (
            "loads:\n- {kind: moment, at: 0.1, moment: {times: [0, 1], values: [1, 2, 3]}}",
            "6:59: loads[0].moment.values: values must have one entry per instant of times (2), got 3",
        ),
        (
            "fidelity: {elements: 0}",
            "5:22: fidelity.elements: out of range: expected a number at least 1 (number of elements",
        ),
        (
            "fidelity: {elements: 2.5}",
            "5:22: fidelity.elements: wrong type: expected a whole number or a list, got 2.5",
        ),
        (
            "actuation: {tip_moment: {times: [1, 0], values: [1, 2]}}",
            "5:33: actuation.tip_moment.times: times must increase",
        ),
        # of the finger, whose keys come before
        (
            "  strain_limit: 6",
            "5:17: finger.strain_limit: out of range: expected a number less than 1 (greatest bending",
        ),
        ("  half_thickness: 0.6", "5:19: finger.half_thickness: half_thickness = 0.6 m is not smaller"),
        ("  masses: [{at: 0.6, mass: 1e30}]", "5:28: finger.masses[0].mass: out of range"),
        (
            "  tendons: {offset: 0.01, max_tension: 1, time_constant: 1e-300}",
            "5:58: finger.tendons.time_constant: out of range: expected a number at least 1e-06 (time constant",
        ),
        ("  base: {position: [0, 1e300]}", "5:24: finger.base.position[1]: out of range"),
    ],
)
def test_problem_is_named_at_its_place(write, text, expected):
    lines = complaint(write(HEAD + text))
    assert len(lines) == 1
    assert expected in lines[0]


def test_unknown_key_in_a_branch_of_a_union(write):
    samples = "{times: [0, 1], valus: [[0, 1], [0, 2]]}"
    lines = complaint(write(HEAD + f"loads:\n- {{kind: force, at: 0.1, force: {samples}}}"))
    assert lines == [
        "scene.yaml:6:26: loads[0].force.values: missing; expected components x, y at each instant, "
        "in the unit of the quantity",
        "scene.yaml:6:49: loads[0].force.valus: unknown key; did you mean 'values'?",
    ]


def test_several_problems_in_the_order_of_the_file(write):
    lines = complaint(write(HEAD + "contcts: []\nname: 3\ntime: {duration: 0, step: -1}\n"))
    assert [line.split(": ")[1] for line in lines] == ["contcts", "name", "time.duration", "time.step"]


@pytest.mark.parametrize(
    ("rod", "expected"),
    [
        ("{length: -1, diameter: 0.002, density: 1, youngs_modulus: 1}", "finger.rod.length: out of range"),
        ("{length: 1, diameter: 0.002}", "finger.rod: a section given by its shape needs youngs_modulus"),
        (
            "{length: 1e-300, diameter: 0.002, density: 1e3, youngs_modulus: 1e9}",
            "3:24: finger.rod.length: out of range: expected a number at least 1e-06 (length L [m]), got 1e-300",
        ),
        (
            "{length: 1, diameter: 1, density: 1e3, youngs_modulus: 1e9}",
            "rod.diameter: diameter = 1.0 m is not smaller",
        ),
        ("{length: 1, linear_density: 1, bending_stiffness: 1, rotary_inertia: 1e30}", "rotary_inertia: out of range"),
        (
            "{length: 0,6, diameter: 0,002, density: 6450, youngs_modulus: 60e9}",
            "3:26: finger.rod: expected a word as key, got '6' (write a decimal point, not a comma: 0.6)",
        ),
        ("{lenght: 1, linear_density: 1, bending_stiffness: 1}", "unknown key; did you mean 'length'?"),
    ],
)
def test_physical_sense_of_the_rod(write, rod, expected):
    lines = complaint(write(f"schema_version: 1\ngravity: [0, 0]\nfinger: {{rod: {rod}}}"))
    assert any(expected in line for line in lines)


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["finger.rod.length=600", "finger.rod.diameter=2"], ["rod.length = 600 m", "rod.diameter = 2 m"]),
        (["finger.rod.youngs_modulus=60"], ["rod.youngs_modulus = 60 Pa fits no material; 60 GPa is 60e9"]),
        (["finger.rod.density=6.45"], ["6.45 g/cm3 is 6450 (expected: kg/m3)"]),
        (["finger.masses=[{at: 0.6, mass: 20}]"], ["masses[0].mass = 20 kg on a rod of 0.012 kg; is it in grams?"]),
        (["finger.base.angle=-90"], ["base.angle = -90 rad is beyond a full turn; is it in degrees?"]),
        (["gravity=[0, -9810]"], ["is it in mm/s2?"]),
        ([], []),
    ],
)
def test_other_units_are_suspected(write, overrides, words):
    file = write(HEAD)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load(file, overrides)
    assert len(caught) == len(words)
    assert all(any(word in str(one.message) for one in caught) for word in words)
    assert all(one.filename == __file__ for one in caught)


@pytest.mark.parametrize("version", ["2", "true", "1.0", "'1'"])
def test_other_versions_are_refused(write, version):
    (line,) = complaint(write(HEAD.replace("schema_version: 1", f"schema_version: {version}")))
    assert line.startswith("scene.yaml:1:17: schema_version: ")


@pytest.mark.parametrize(("text", "words"), [("", "an empty file"), ("[1]", "no keys"), ("5", "no keys")])
def test_not_a_mapping(write, text, words):
    (line,) = complaint(write(text))
    assert line == f"scene.yaml:1:1: expected a mapping of keys to values, got {words}"


# fingers in files of their own
FINGER = f"""schema_version: 1
rod: {ROD}
damping: {{material: 1e-4, per_arc: 2e-4}}
masses: [{{at: 0.6, mass: 1}}]
"""
SCENE = "schema_version: 1\ngravity: [0, -9.81]\nfinger: "


def test_finger_file_is_relative_to_the_file_that_names_it(write, tmp_path, monkeypatch):
    (tmp_path / "deep" / "fingers").mkdir(parents=True)
    write(FINGER, "deep/fingers/one.yaml")
    write(SCENE + "fingers/one.yaml", "deep/scene.yaml")
    monkeypatch.chdir("/")
    scene = load(tmp_path / "deep" / "scene.yaml")
    assert scene.finger == load(tmp_path / "deep" / "fingers" / "one.yaml")
    assert isinstance(scene.finger, Finger)


def test_changes_to_a_finger_file(write):
    write(FINGER, "one.yaml")
    changed = "\n  extends: one.yaml\n  damping: {material: 3e-4}\n  masses: []\n"
    finger = load(write(SCENE + changed)).finger
    assert finger.damping.material == 3e-4
    assert finger.damping.per_arc == 2e-4  # mappings change key by key
    assert finger.masses == ()  # lists change whole
    assert finger.rod.length == 0.6


def test_finger_files_extend_each_other(write):
    write(FINGER, "one.yaml")
    write("schema_version: 1\nextends: one.yaml\nrod: {length: 0.7}\n", "two.yaml")
    assert load("two.yaml").rod.length == 0.7
    assert load(write(SCENE + "two.yaml")).finger.rod.length == 0.7


@pytest.mark.parametrize(
    ("finger", "scene", "expected"),
    [
        (
            FINGER + "mases: []\n",
            "one.yaml",
            "one.yaml:5:1: finger.mases: unknown key; did you mean 'masses'?",
        ),
        (
            FINGER.replace("length: 0.6", "length: -1"),
            "one.yaml",
            "one.yaml:2:15: finger.rod.length: out of range",
        ),
        (FINGER, "{extends: one.yaml, mases: []}", "scene.yaml:3:29: finger.mases: unknown key"),
        (
            FINGER,
            "{extends: one.yaml, rod: {length: 0.5}}",
            "one.yaml:4:15: finger.masses[0].at: 0.6 m is beyond",
        ),
        (FINGER, "{extends: one.yaml, rod: {length: x}}", "scene.yaml:3:43: finger.rod.length: wrong type"),
        (FINGER, "two.yaml", "scene.yaml:3:9: finger: no such finger file: two.yaml"),
        (FINGER, "{extends: 3}", "scene.yaml:3:19: finger.extends: expected the path of a finger file"),
        (FINGER, "scene.yaml", "scene.yaml:3:9: finger: scene.yaml leads back to itself"),
        ("a: [", "one.yaml", "one.yaml:1:5: not valid YAML"),
        ("[1]", "one.yaml", "one.yaml:1:1: expected a finger"),
        (HEAD, "one.yaml", "one.yaml:1:1: expected a finger"),
        (f"rod: {ROD}", "one.yaml", "one.yaml:1:1: schema_version: missing"),
        (
            "schema_version: 1\nextends: one.yaml",
            "one.yaml",
            "one.yaml:2:10: extends: one.yaml leads back to itself",
        ),
    ],
)
def test_errors_name_the_file_they_are_in(write, finger, scene, expected):
    write(finger, "one.yaml")
    (line,) = complaint(write(SCENE + scene))
    assert line.startswith(expected)


# overrides
@pytest.mark.parametrize(
    ("override", "look", "value"),
    [
        ("time.step=1e-2", lambda s: s.time.step, 0.01),
        ("finger.masses[0].mass=2", lambda s: s.finger.masses[0].mass, 2.0),
        ("finger.masses.0.mass=2", lambda s: s.finger.masses[0].mass, 2.0),
        ("finger.rod.length=0.9", lambda s: s.finger.rod.length, 0.9),
        ("gravity=[0, 0]", lambda s: s.gravity, (0.0, 0.0)),
        ("gravity[1]=-1", lambda s: s.gravity, (0.0, -1.0)),
        ("fidelity.family=arc", lambda s: s.fidelity.family, "arc"),
        ("name=on", lambda s: s.name, "on"),
        ("name=", lambda s: s.name, None),
        ("name=a=b", lambda s: s.name, "a=b"),
        ("finger={extends: one.yaml, masses: []}", lambda s: s.finger.masses, ()),
        ("finger.damping={material: 7}", lambda s: s.finger.damping.per_arc, 0.0),
    ],
)
def test_overrides(write, override, look, value):
    write(FINGER, "one.yaml")
    file = write(SCENE + "one.yaml\ntime: {duration: 1, step: 0.1}\n")
    assert look(load(file, [override])) == value


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("gravity[0]=x", "--set gravity[0]=x: gravity[0]: wrong type: expected an acceleration [m/s2] such as"),
        ("tme.step=1", "--set tme.step=1: tme: unknown key; did you mean 'time'?"),
        ("gravity", "--set gravity: expected key.path=value"),
        ("=1", "--set =1: expected key.path=value"),
        ("a..b=1", "expected a key path"),
        ("gravity[2]=1", "--set gravity[2]=1: gravity[2]: no entry [2]: gravity has 2 entries"),
        ("name.x=1", "--set name.x=1: name.x: name has no keys"),
        ("gravity=[1", "--set gravity=[1: gravity: not valid YAML"),
        ("finger=none.yaml", "--set finger=none.yaml: finger: no such finger file: none.yaml"),
    ],
)
def test_wrong_overrides_are_named(write, override, expected):
    (line,) = complaint(write(HEAD + "name: n\n"), overrides=[override])
    assert line.startswith(expected) or (override == "a..b=1" and expected in line)


def test_overrides_from_python(write):
    write(FINGER, "one.yaml")
    load_case = {"kind": "force", "at": 0.1, "force": {"times": [0, 1], "values": [[0, 0], [0, 1]]}}
    scene = load(write(SCENE + "one.yaml"), {"loads": [load_case], "finger": {"extends": "one.yaml", "masses": []}})
    assert isinstance(scene.loads[0].force, VectorSamples)
    assert scene.finger.masses == ()
    (line,) = complaint("scene.yaml", overrides={"loads": [{**load_case, "at": -1}]})
    assert line.startswith("override loads: loads[0].at: out of range")


@pytest.mark.parametrize(
    ("path", "overrides", "words"),
    [
        (0, (), "expected the path of a file, got 0"),
        (None, (), "expected the path of a file, got None"),
        ("scene.yaml", "gravity[0]=1", "overrides: expected a list of key.path=value texts, or a mapping"),
        ("scene.yaml", 5, "overrides: expected a list of key.path=value texts, or a mapping, got 5"),
        ("scene.yaml", [5], "overrides: expected a text, got 5"),
        ("scene.yaml", {5: 5}, "overrides: expected a text, got 5"),
    ],
)
def test_what_cannot_be_loaded_is_said(write, path, overrides, words):
    write(HEAD)
    (line,) = complaint(path, overrides=overrides)
    assert line.startswith(words)
