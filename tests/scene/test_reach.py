"""Goals and setpoints out of reach: refused with key, value and reach, and none that a bent finger can meet."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from pydantic import BaseModel

import continuum_grasp as cg
from continuum_grasp.base import InputError

CONFIGS = Path(__file__).parents[2] / "configs"
LENGTH = 0.18
BASE = "finger={extends: ../fingers/hand_finger.yaml, base: {position: [1.0, 2.0], angle: 0.5}}"


def around(share: float, reach: float = LENGTH, angle: float = 2.2) -> list[float]:
    """A point at a share of a reach from the base that is not in the origin [m]."""
    return [1.0 + share * reach * math.cos(angle), 2.0 + share * reach * math.sin(angle)]


def at(share: float) -> dict[str, tuple[str, list[str], str]]:
    """Scenes, changes and the key at fault, with points at a share of what can be reached."""
    tip, near = around(share), around(0.3)
    half = around(share, 0.5 * LENGTH)
    shape = "controller.cost={shape: {at: [0.09, 0.18], running: 1.0}, effort: 1.0}"
    return {
        "tip": ("mpc/steady_tip.yaml", [BASE, f"reference.tip={tip}"], "reference.tip:"),
        "waypoint": (
            "mpc/steady_tip.yaml",
            [BASE, f"reference.tip={{times: [0, 1, 2], values: [{near}, {tip}, {near}]}}"],
            "reference.tip.values[1]:",
        ),
        "circle": (
            "mpc/steady_tip.yaml",
            [BASE, f"reference.tip={{center: {around(share + 0.3)}, radius: {0.3 * LENGTH}, frequency: 1}}"],
            "reference.tip:",
        ),
        "circle around the base": (
            "mpc/steady_tip.yaml",
            [BASE, f"reference.tip={{center: {near}, radius: {(share + 0.3) * LENGTH}, frequency: 1}}"],
            "reference.tip:",
        ),
        "shape": ("mpc/steady_tip.yaml", [BASE, shape, f"reference={{shape: {half + near}}}"], "reference.shape:"),
        "goal": ("plan/tip_to_point.yaml", [BASE, f"goal.tip={tip}"], "goal.tip:"),
        "weighted goal": ("plan/tip_to_point.yaml", [BASE, f"goal.tip.value={tip}"], "goal.tip:"),
        "goal shape": (
            "plan/tip_to_point.yaml",
            [BASE, f"goal={{shape: {{at: [0.09, 0.18], value: [{half}, {near}]}}}}"],
            "goal.shape:",
        ),
    }


@pytest.mark.parametrize("kind", list(at(1.0)))
def test_points_beyond_the_length_are_refused_with_their_key(kind):
    file, changes, key = at(1.001)[kind]
    with pytest.raises(InputError, match="out of reach") as caught:
        cg.load(CONFIGS / file, changes)
    assert key in str(caught.value)
    assert f"expected at most {0.5 * LENGTH if 'shape' in kind else LENGTH:g} m" in str(caught.value)
    file, changes, _ = at(0.999)[kind]
    assert isinstance(cg.load(CONFIGS / file, changes), BaseModel)


def test_file_and_line_of_a_goal_out_of_reach(tmp_path):
    text = (CONFIGS / "plan" / "tip_to_point.yaml").read_text().replace("[-0.128, 0.077]", "[1.0, 1.0]")
    file = tmp_path / "far.yaml"
    file.write_text(text.replace("../fingers", str(CONFIGS / "fingers")))
    line = 1 + next(k for k, row in enumerate(text.splitlines()) if "value: [1.0" in row)
    words = r"\(1, 1\) m is 1.414 m from the finger's base, expected at most 0.18 m"
    with pytest.raises(InputError, match=words) as caught:
        cg.load(file)
    assert (caught.value.file, caught.value.line, caught.value.key) == (str(file), line, "goal.tip")


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_circle_that_leaves_the_reach_is_a_warning(share, recwarn):
    radius = share * LENGTH - 0.1
    cg.load(
        CONFIGS / "mpc" / "steady_tip.yaml",
        [f"reference.tip={{center: [0.0, 0.1], radius: {radius}, frequency: 1, phase: 0.1}}"],
    )
    assert any("out of its reach of 0.18 m" in str(one.message) for one in recwarn) is (share > 1.0)


def test_an_object_is_touched_as_far_as_its_outline_is_from_the_tip():
    """A disc of radius R touches the end of a straight finger of half thickness h at L + h + R from the base."""
    changes = ["controller.cost.object_position=1.0", "reference.object_position=[0.0, 0.1]"]
    scene = cg.load(CONFIGS / "mpc" / "turn_bar.yaml", changes)
    body, finger = scene.object, scene.finger
    reach = finger.rod.length + finger.thickness_radius + max(part.extent for part in body.parts)
    x, y = finger.base.position
    with pytest.raises(InputError, match=r"reference.object_position: out of reach"):
        scene.changed({"reference.object_position": [x, y + 1.001 * reach]})
    scene.changed({"reference.object_position": [x, y + 0.999 * reach]})


def test_fixed_objects_are_as_far_from_a_section_as_from_the_base_up_to_its_length():
    """The distance from a disc of radius R at (a, 0) of a section s along the finger: |a| - R +- s."""
    scene = cg.load(CONFIGS / "mpc" / "wrap_post.yaml")
    (x, y), body = scene.finger.base.position, scene.object
    apart = math.dist(body.position, (x, y)) - 0.5 * body.diameter
    assert refused(scene, "gap", [apart + LENGTH]) == ("", "")
    key, words = refused(scene, "gap", [apart + 1.001 * LENGTH])
    assert key == "reference.gap"
    assert f"{apart + LENGTH:.4g} m" in words
    least = max(apart - LENGTH - scene.finger.thickness_radius, -2.0 * body.size - scene.finger.thickness_radius)
    assert refused(scene, "gap", [0.999 * least]) == ("", "")
    assert refused(scene, "gap", [1.001 * least])[0] == "reference.gap"


def test_goals_that_pull_or_bend_too_far_are_refused():
    scene = CONFIGS / "plan" / "close_on_mug.yaml"
    with pytest.raises(InputError, match="contacts push") as caught:
        cg.load(scene, ["grasp=null", "contacts=[0.1]", "goal.contact_force=[0.0, -1.0]"])
    assert caught.value.key == "goal.contact_force"
    with pytest.raises(InputError, match=r"expected -1\.2 to 1\.2 rad"):
        cg.load(CONFIGS / "plan" / "tip_to_point.yaml", ["fidelity.bending_range=1.2", "goal={bending: [0.1, 1.3]}"])


def refused(scene, name, row) -> tuple[str, str]:
    """Key and message of a setpoint, both empty where it is taken."""
    try:
        scene.changed({f"reference.{name}": row})
    except InputError as error:
        return str(error.key), error.message
    return "", ""


@pytest.mark.parametrize(
    ("file", "changes", "name", "least", "most"),
    [
        ("wrap_post", [], "contact_force", 0.0, math.inf),
        ("turn_bar", [], "object_angle", -2.0 * math.pi, 2.0 * math.pi),
        ("turn_bar", [], "gap", None, math.inf),
        *[
            (
                "steady_tip",
                [f"controller.cost={{{name}: 1.0, effort: 1.0}}", f"reference={{{name}: {row}}}"],
                name,
                a,
                b,
            )
            for name, row, a, b in (("tip_angle", 0.1, -2.4, 2.4), ("bending", [0.1, 0.1], -1.2, 1.2))
        ],
    ],
)
def test_numbers_out_of_range_are_refused_with_it(file, changes, name, least, most):
    """Angles of two elements of 1.2 rad about the base; whole turns of objects; contacts that pull."""
    changes = [*changes, *(["fidelity.bending_range=1.2"] if file == "steady_tip" else [])]
    scene = cg.load(CONFIGS / "mpc" / f"{file}.yaml", changes)
    rest = [0.1] if name == "bending" else []
    if least is None:
        least = -2.0 * scene.object.size - scene.finger.thickness_radius
    for limit, outward in ((least, -1.0), (most, 1.0)):
        if math.isinf(limit):
            assert refused(scene, name, [1e6]) == ("", "")
            continue
        size = 1e-3 * max(abs(limit), 1.0)
        assert refused(scene, name, [limit - outward * size, *rest]) == ("", "")
        key, words = refused(scene, name, [limit + outward * size, *rest])
        assert key == f"reference.{name}"
        assert f"{limit:.4g}" in words
