"""Values with units; from inside: the table of units, the pattern they match and the advice on what does not.

Values with units: their exact numbers, where they may stand, and what every key says of its unit.
"""

from __future__ import annotations

import math
import re
from decimal import Decimal
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import mpmath
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import constants

import continuum_grasp as cg
from continuum_grasp.addons.sweeps import SweepPlan
from continuum_grasp.base import InputError
from continuum_grasp.scene import ConfigurationData, Samples, Shape, Unit, json_schema, kinds, load, to_si
from continuum_grasp.scene.shape import alternatives
from continuum_grasp.scene.units import QUANTITIES, advice_on, pattern
from continuum_grasp.scene.value import field_docs
from tests.marks import few
from tests.scene.test_configs import FOLDER_OF
from tests.scene_keys import classes

CONFIGS = Path(__file__).parents[2] / "configs"
KINDS_OF_SCENES = [sorted(CONFIGS.glob(f"{folder}/*.yaml")) for folder in sorted({*FOLDER_OF.values()} - {"sweep"})]
SHIPPED = [path for row in zip_longest(*KINDS_OF_SCENES) for path in row if path is not None]
"""One of each kind first."""
BASE = {"m": 1.0, "kg": 1.0, "g": 1e-3, "s": 1.0, "N": 1.0, "Pa": 1.0, "rad": 1.0, "Hz": 2.0 * math.pi, "1": 1.0}
BASE |= {"deg": math.pi / 180.0, "gf": 9.80665e-3, "%": 0.01, "bar": 1e5, "rev": math.tau, "rpm": math.tau / 60.0}
BASE |= {"in": constants.inch, "ft": constants.foot, "mil": constants.mil, "lb": constants.lb, "oz": constants.oz}
BASE |= {"lbf": constants.lbf, "ozf": constants.lbf / 16.0, "psi": constants.psi, "min": 60.0, "h": constants.hour}
PREFIXES = {"": 1.0, "n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6, "G": 1e9}


def factor(unit: str) -> float:
    """A unit in SI base units, by taking it apart."""
    above, _, below = unit.partition("/")
    value = 1.0
    for words, sign in ((above, 1), (below, -1)):
        for symbol, power in re.findall(r"([A-Za-z%]+|1)([2-4]?)", words):
            known = {p + s: a * b for p, a in PREFIXES.items() for s, b in BASE.items()} | BASE
            value *= known[symbol] ** (sign * int(power or 1))
    return value


@pytest.mark.parametrize("si", QUANTITIES)
def test_every_unit_of_the_table_is_worth_what_its_parts_are(si):
    for unit, worth in Unit(si).factors.items():
        assert float(worth) == pytest.approx(factor(unit) / factor(si), rel=1e-14), unit


@pytest.mark.parametrize("si", QUANTITIES)
def test_no_spelling_is_one_of_two_units(si):
    """Without blanks, and with weights for forces, as the table allows."""
    for unit in Unit(si).factors:
        for text in {unit, unit.replace(" ", ""), unit.replace(" ", "·"), re.sub(r"f (in|cm)", r" \1", unit)}:
            assert [other for other in Unit(si).factors if to_si(f"1 {text}", si) == to_si(f"1 {other}", si)] == [
                other for other in Unit(si).factors if Unit(si).factors[other] == Unit(si).factors[unit]
            ]


@given(st.decimals(allow_nan=False, allow_infinity=False, min_value=-(10**12), max_value=10**12, places=9))
def test_a_decimal_unit_shifts_the_decimal_point(number: Decimal):
    # The double nearest to the shifted decimal, as Python reads it, is the literal that one would write.
    for unit, power in (("mm", -3), ("um", -6), ("m", 0)):
        assert to_si(f"{number:f} {unit}", "m") == float(f"{number.scaleb(power, None):f}")
    assert to_si(f"{number:f} GPa", "Pa") == float(number.scaleb(9))


@given(st.decimals(allow_nan=False, allow_infinity=False, min_value=-1000, max_value=1000, places=6))
def test_degrees_are_rounded_once(number: Decimal):
    with mpmath.workdps(60):
        exact = mpmath.mpf(str(number)) * mpmath.pi / 180
        assert to_si(f"{number:f} deg", "rad") == float(exact)


SPELLINGS = [
    ("12mm", "m", 0.012),
    ("5 um", "m", 5e-6),
    ("5 µm", "m", 5e-6),
    ("+1.e-3 m", "m", 1e-3),
    (".5 m", "m", 0.5),
    ("-90°", "rad", -math.pi / 2),
    ("1.2 N*m", "N m", 1.2),
    ("1.2 N·m", "N m", 1.2),
    ("9.81 m/s^2", "m/s2", 9.81),
    ("9.81 m/s²", "m/s2", 9.81),
    ("6110 N mm^2", "N m2", 6110e-6),
    ("0.5%", "1", 0.005),
    *[(text, "N m", 25.0) for text in ("25 Nm", "25 N-m", "25N·m")],
    *[(text, "m", 0.0508) for text in ("2 in", "2 inch", '2"', "2″")],
    *[(text, "m", 0.000254) for text in ("10 mil", "10 thou")],
    *[(text, "N m", 1.4709975) for text in ("15 kgf cm", "15 kg·cm", "15kg-cm")],
    *[(text, "s", 4e-9) for text in ("4 ns", "4 nsec", "0.004 µs", "0.004 usec")],
    *[(text, "rad/s", math.pi) for text in ("30 rpm", "30 RPM", "180 °/s")],
    ("2 1/mm", "1/m", 2000.0),
]
REFUSED = [
    *[(text, "m", "") for text in ("12 kg", "12 rad", "mm", "x", "12 s")],
    *[
        (text, "m", "units: m, cm, mm, um, in")
        for text in ("12 MM", "12 M", "1 000 mm", "1_000 mm", "2*3 mm", "12 mm + 1 mm", "12  mm", "12 mm ", "1e mm")
    ],
    *[(text, "m", "write a decimal point, not a comma, and no") for text in ("1,5 mm", "1,200 mm")],
    *[(text, "m", "too large, too small") for text in ("1e400 m", "1e999999999 mm", "1e-400 mm", "1" * 60 + " m")],
    ("51/mm", "1/m", "units: 1/m, 1/cm, 1/mm"),
    ("5 NM", "N m", "units: N m"),
    ("60 gpa", "Pa", "units: Pa, kPa"),
    *[(text, "N", "") for text in ("2 lb", "2 oz", "2 kg")],  # masses
    ("3 M", "s", "units: s, ms, us, ns, min, h"),
]


@pytest.mark.parametrize(("text", "si", "value"), SPELLINGS)
def test_spellings(text, si, value):
    assert to_si(text, si) == value
    assert re.search(pattern(si), text)


@pytest.mark.parametrize(("text", "si", "advice"), REFUSED)
def test_what_is_no_value_with_a_unit_is_refused(text, si, advice):
    assert to_si(text, si) is None
    assert advice_on(text, si).startswith(advice) if advice else not advice_on(text, si)
    # An editor sees the same, but for the size of numbers.
    assert not re.search(pattern(si), text) or "too large" in advice


# scenes with units in files, by --set and in Python
HEAD = """schema_version: 1
gravity: [0 m/s2, -981 cm/s2]
finger:
  rod: {length: 600 mm, diameter: 2 mm, density: 6.45 g/cm3, youngs_modulus: 60 GPa}
  base: {position: [12 mm, -3 cm], angle: -90 deg}
  strain_limit: 6 %
  masses: [{at: 600 mm, mass: 20 g}]
"""
PLAIN = """schema_version: 1
gravity: [0.0, -9.81]
finger:
  rod: {length: 0.6, diameter: 0.002, density: 6450.0, youngs_modulus: 60.0e+9}
  base: {position: [0.012, -0.03], angle: -1.5707963267948966}
  strain_limit: 0.06
  masses: [{at: 0.6, mass: 0.02}]
"""
REST = """loads:
- {kind: force, at: 10 cm, force: [250 mN, 1 N]}
- {kind: force, at: 0.1, force: {times: [0 ms, 500 ms], values: [[0, 0], [1 kN, 2 N]]}}
- {kind: moment, at: 0.1, moment: {times: [0, 0.5 s], values: [0, 25 N mm]}}
actuation: {tip_moment: 12 N mm}
fidelity: {elements: [25 cm, 350 mm], tolerance: 0.5 %}
time: {duration: 2 s, step: 5 ms}
"""
PLAIN_REST = """loads:
- {kind: force, at: 0.1, force: [0.25, 1]}
- {kind: force, at: 0.1, force: {times: [0, 0.5], values: [[0, 0], [1000, 2]]}}
- {kind: moment, at: 0.1, moment: {times: [0, 0.5], values: [0, 0.025]}}
actuation: {tip_moment: 0.012}
fidelity: {elements: [0.25, 0.35], tolerance: 0.005}
time: {duration: 2, step: 0.005}
"""


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def _file(text: str) -> str:
        Path("scene.yaml").write_text(text, encoding="utf-8")
        return "scene.yaml"

    return _file


def test_a_file_with_units_is_the_scene_in_si(file):
    scene = load(file(HEAD + REST))
    assert scene == load(file(PLAIN + PLAIN_REST))
    assert scene.model_dump_json() == load("scene.yaml").model_dump_json()  # what results store


def written(value: Any, shape: Shape, path: tuple[str | int, ...], data: Any) -> Any:
    """Plain data with the unit behind every number whose unit is in the table."""
    if isinstance(value, dict):
        return {key: written(one, shape, (*path, key), data) for key, one in value.items()}
    if isinstance(value, list):
        return [written(one, shape, (*path, k), data) for k, one in enumerate(value)]
    unit = shape.unit(path, data) if isinstance(value, float) else None
    if unit == "1":
        return f"{Decimal(repr(value)).scaleb(2):f} %"
    return f"{value!r} {unit}" if unit in QUANTITIES else value


@pytest.mark.parametrize("path", few(SHIPPED, 14), ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_every_number_of_the_shipped_configurations_takes_its_unit(path):
    read = ConfigurationData.load(path)
    scene = read.scene
    data = written(read.value, Shape(type(scene)), (), read.value)
    # Numbers of designs belong to keys of the scene, whose units the design does not know.
    assert data != read.value or path.parent.name == "design"
    assert type(scene).model_validate(data).model_dump() == scene.model_dump()  # a design also holds its file


def test_set_and_python_take_units(file):
    by_file, file = load(file(PLAIN)), file(PLAIN)
    changes = ["finger.rod.length=700 mm", "finger.base.angle=90 deg", "finger.base.position=[1 cm, 0]"]
    base = {"position": (0.01, 0.0), "angle": math.pi / 2}
    by_set = load(file, changes)
    assert by_set.finger.rod.length == 0.7
    assert by_set.finger.base == cg.BasePose(**base)
    assert load(file, {"finger.rod.length": "700 mm", "finger.base": base}) == by_set
    assert cg.PointMass(at="600 mm", mass="20 g") == by_file.finger.masses[0]
    assert cg.MomentLoad(at=0.1, moment={"times": (0.0, 1.0), "values": ("0 N m", "25 N mm")}).moment.values[1] == 0.025


WRONG = [
    (
        "finger.rod.length=12 kg",
        "finger.rod.length: wrong type: expected a length [m] such as 0.012 or 12 mm, got text '12 kg'",
    ),
    ("finger.rod.length=12 MM", "got text '12 MM' (units: m, cm, mm, um, in, ft, mil)"),
    ("finger.rod.length='1,200 mm'", "(write a decimal point, not a comma, and no separators of thousands)"),
    ("finger.rod.length=1 nm", "(units: m"),
    (
        "finger.rod.length=0.1 um",
        "out of range: expected a number at least 1e-06 (length L [m]), got 1e-07 (0.1 um)",
    ),
    ("finger.base.position[1]=3 N", "finger.base.position[1]: wrong type: expected a length [m]"),
    ("gravity=[0, 9.81 m]", "gravity[1]: wrong type: expected an acceleration [m/s2]"),
    ("finger.strain_limit=6 mm", "expected a share [1] such as 0.05 or 5 %, got text '6 mm'"),
    (
        "actuation.tip_moment={times: [0, 1], values: [0, 5 N]}",
        "actuation.tip_moment.values[1]: wrong type: expected a moment [N m] such as 0.025 or 25 N mm, got text '5 N'",
    ),
    (
        "actuation.tip_moment=5 N",
        "expected a moment [N m] such as 0.025 or 25 N mm or a mapping with keys like times",
    ),
    (
        "initial={q: [30 deg]}",
        "expected a number [rad or 1/m], got text '30 deg' (write the bare number, in SI units)",
    ),
    ("fidelity.elements=2 m", "fidelity.elements: wrong type: expected a whole number or a list"),
]


@pytest.mark.parametrize(("change", "words"), WRONG)
def test_a_wrong_unit_is_refused_at_its_key(file, change, words):
    with pytest.raises(InputError) as caught:
        load(file(PLAIN), [change])
    assert words in str(caught.value)


OTHERS = [
    (
        "mpc/tip_steps.yaml",
        "reference.tip.values[0]=[0, 18 kg]",
        "reference.tip.values[0][1]: wrong type: expected a length [m] such as 0.012 or 12 mm, got text '18 kg'",
    ),
    (
        "mpc/tip_steps.yaml",
        "reference.tip={center: [0, 1 cm], radius: 3 s, frequency: 1 Hz}",
        "reference.tip.radius: wrong type: expected a length [m] such as 0.012 or 12 mm, got text '3 s'",
    ),
    (
        "grasp/mug.yaml",
        "disturbances.wrenches=[[1 N, 0, 3 N]]",
        "disturbances.wrenches[0][2]: wrong type: expected a moment [N m] such as 0.025 or 25 N mm, got text '3 N'",
    ),
    (
        "plan/past_a_post.yaml",
        "goal.bending={value: [30 deg, 1 N]}",
        "goal.bending.value[1]: wrong type: expected an angle [rad] such as 0.523599 or 30 deg, got text '1 N'",
    ),
]


@pytest.mark.parametrize(("path", "change", "message"), OTHERS)
def test_of_a_choice_only_what_is_meant_is_reported(path, change, message):
    with pytest.raises(InputError) as caught:
        load(CONFIGS / path, [change])
    assert str(caught.value) == f"--set {change}: {message}"


def test_samples_alone_have_no_unit():
    with pytest.raises(InputError, match=r"values\[1\]: wrong type: expected a number, got text '5 N'"):
        Samples(times=(0.0, 1.0), values=(0.0, "5 N"))


SWEPT = """schema_version: 1
scene: {scene}
set: {{contacts.normal_force_max: 20 N}}
vary:
  object.diameter: {{min: 70 mm, max: 10 cm, count: 4}}
  object.mass: {{values: [200 g, 0.4]}}
sample:
  count: 2
  keys:
    contacts.friction: {{normal: [50 %, 0.1]}}
    finger.rest_curvature: {{choice: [0, 0.008 1/mm]}}
follow:
  object.position[0]: {{key: object.diameter, times: 0.5, plus: 0 mm}}
"""


def test_a_sweep_takes_the_units_of_its_keys(file):
    path = file(SWEPT.format(scene=CONFIGS / "grasp" / "mug.yaml"))
    plan = SweepPlan.of(path)
    diameter, mass = plan.variation.axes
    assert (diameter.values, diameter.unit) == ((0.07, 0.08, 0.09, 0.1), "m")
    assert mass.values == mass.way.listed == (0.2, 0.4)
    friction, curvature = plan.variation.draws
    assert (friction.way.normal, curvature.values, curvature.unit) == ((0.5, 0.1), (0, 8.0), "1/m")
    assert plan.variation.base["contacts"]["normal_force_max"] == 20.0
    text = Path(path).read_text()
    Path(path).write_text(text.replace("min: 70 mm", "min: 70 g"))
    with pytest.raises(InputError, match=r"scene.yaml:5:26: vary.*: expected a number, got text '70 g'"):
        SweepPlan.of(path)
    Path(path).write_text(text.replace("200 g", "200 N"))
    with pytest.raises(InputError, match=r"object.mass: wrong type: expected a mass \[kg\] such as 0.3 or 300 g"):
        SweepPlan.of(path)


# what every key says
MODELS = dict.fromkeys(
    one for kind in kinds().values() for one in sorted(classes(kind.scene_class), key=lambda one: one.__name__)
)
KEYS = [(model, key) for model in MODELS for key in model.model_fields]


def units(annotation: Any, metadata: Any = (), around: frozenset[Any] = frozenset()) -> set[Any]:
    """SI units of the numbers in the type of a key; a number without one is "no unit"."""
    if get_origin(annotation) is Annotated:
        annotation, *metadata = get_args(annotation)
    own = {one.si for one in metadata if isinstance(one, Unit)}
    if annotation is float:
        return own or around or {"no unit"}
    return set().union(*(units(part, (), frozenset(own) or around) for part in get_args(annotation)), own)


def brackets(text: str) -> set[str]:
    """What stands in brackets, in its parts."""
    return {part for one in re.findall(r"\[([^\]]+)\]", text) for part in one.split(" or ")}


def test_every_key_is_described():
    assert len(KEYS) > 300
    assert not [f"{model.__name__}.{key}" for model, key in KEYS if not field_docs(model).get(key)]


def test_every_number_has_a_unit_and_its_description_names_it():
    wrong = []
    for model, key in KEYS:
        field = model.model_fields[key]
        own = units(field.annotation, field.metadata)
        described = field_docs(model)[key]
        named = brackets(described)
        expected = set().union(*({"unit"} if si is None else set(si.split(" or ")) for si in own))
        in_words = {"unit"} if "unit of" in described and None in own else set()
        if own and named | in_words != expected:
            wrong.append(f"{model.__name__}.{key}: {sorted(expected)} in the type, {sorted(named)} in the description")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("kind", kinds())
def test_examples_of_the_schema_are_values_of_their_keys(kind):
    schema = json_schema(kind)
    count = 0
    for name, node in {kind: schema, **schema["$defs"]}.items():
        for key, child in node.get("properties", {}).items():
            nodes = list(alternatives(child))
            numbers = [one for one in nodes if "number" in one.get("type", ())]
            unit = next((one["unit"] for one in nodes if "unit" in one), None)
            if not numbers:
                continue
            examples = next((one["examples"] for one in nodes if "examples" in one), [child.get("default")])
            values = [to_si(one, unit or "m") if isinstance(one, str) else one for one in examples]
            assert len(set(values)) == 1, f"{name}.{key}: {examples}"
            assert any(fits(values[0], one) for one in numbers), f"{name}.{key}: {examples}"
            count += 1
    assert count > 3


def fits(value: float, node: dict[str, Any]) -> bool:
    """Whether a number is within the bounds of a schema."""
    low, high = node.get("minimum", -math.inf), node.get("maximum", node.get("exclusiveMaximum", math.inf))
    return isinstance(value, float) and low <= value <= high
