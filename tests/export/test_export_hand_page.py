"""Pages of hands: their numbers follow the response, and Chromium draws them, turns them and moves the sliders."""

from __future__ import annotations

import base64
import json
import re
import shutil

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
COSTLY_FIXTURES = ("ball", "folder", "browser")
SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


@pytest.fixture(scope="module")
def ball():
    return cg.optimize_grasp("configs/hand/ball.yaml")


@pytest.fixture(scope="module")
def folder(ball, tmp_path_factory):
    folder = ball.save(tmp_path_factory.mktemp("hands") / "ball")
    ball.save_pictures(folder)
    return folder


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("needs Chromium")
    with playwright.sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        yield found
        found.close()


def known(text):
    return json.loads(re.search(r'id="known">(.*?)</script>', text, re.DOTALL)[1])


def test_the_report_of_a_grasp_is_its_page_and_that_of_its_folder(ball, folder, tmp_path):
    report = (folder / "report.html").read_text(encoding="utf-8")
    assert ball.show().text == report == cg.export_web(folder, tmp_path / "page.html").text
    assert not re.search(r'(?:src|href)="|https?://', report)
    data = known(report)
    assert [finger["name"] for finger in data["fingers"]] == ["finger_1", "finger_2", "finger_3"]
    forces = np.array([contact["force"] for contact in data["contacts"]])
    assert forces.sum(axis=0) == pytest.approx([0.0, 0.0, -0.08 * 9.81], abs=1e-4)
    corners = np.frombuffer(base64.b64decode(data["object"]["corners"]), "<f4").reshape(-1, 3)
    surface = corners - np.array([2.0, 3.0, -90.0])
    assert np.linalg.norm(surface, axis=1) == pytest.approx(30.0, abs=0.02)


@pytest.mark.deep
def test_a_hand_without_a_grasp_has_a_page_without_sliders():
    scene = cg.load("configs/hand/ball.yaml").changed({"object.mass": 50.0, "solver.effort": "quick"})
    text = cg.optimize_grasp(scene, raise_on_failure=False).show().text
    assert '<div id="sliders">' not in text
    assert "the object is too heavy" in text or "no grasp" in text


@pytest.mark.deep
def test_the_folder_of_a_planar_grasp_is_refused(tmp_path):
    folder = cg.optimize_grasp(cg.load("configs/grasp/mug_arcs.yaml", {"solver.effort": "quick"})).save(
        tmp_path / "run"
    )
    with pytest.raises(InputError, match="expected the grasp of a hand"):
        cg.export_web(folder, tmp_path / "page.html")


def test_sliders_move_fingers_and_forces_by_the_response(ball, folder, browser):
    page, errors = browser.new_page(viewport={"width": 900, "height": 700}), []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.goto((folder / "report.html").as_uri())
    page.wait_for_function("window.page !== undefined")

    def seen():
        return page.evaluate("({ press: page.shown().map((c) => c.press), tip: page.finger(0).at(-1) })")

    before = seen()
    assert before["press"] == pytest.approx([contact.normal_force for contact in ball.contacts], rel=1e-4)
    page.locator("#sliders input").first.fill("1.1")
    by = 0.1 * np.concatenate(list(ball.tensions.values()))
    response = ball.certificate.response
    normals = np.array([contact.normal for contact in ball.contacts])
    more = (normals[:, :, None] * response.forces_by_tension).sum(axis=1) @ by
    assert np.array(seen()["press"]) - before["press"] == pytest.approx(more, abs=1e-5)
    shift = 1e3 * response.places_by_tension[0][-1] @ by
    assert np.array(seen()["tip"]) - before["tip"] == pytest.approx(shift, abs=1e-3 * np.abs(shift).max())
    page.get_by_role("button", name="Reset").click()
    assert seen() == before
    assert errors == []
    page.close()


@pytest.mark.parametrize(("width", "scheme"), [(1200, "light"), (380, "dark")])
def test_fingers_object_and_forces_are_drawn_and_turn(folder, browser, width, scheme, tmp_path):
    from PIL import Image

    page = browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
    page.goto((folder / "report.html").as_uri())
    page.wait_for_function("window.page !== undefined")
    stage = page.locator("#world")

    def picture(name):
        page.wait_for_timeout(200)
        stage.screenshot(path=tmp_path / name)
        return np.asarray(Image.open(tmp_path / name).convert("RGB"), dtype=float)

    first = picture("first.png")
    hues = {"blue": (2, 0), "green": (1, 0), "orange": (0, 2)}
    for more, less in hues.values():  # the three fingers
        assert (first[:, :, more] - first[:, :, less] > 60.0).sum() > 200
    box = stage.bounding_box()
    page.mouse.move(box["x"] + 100, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 180, box["y"] + 200)
    page.mouse.up()
    assert np.abs(picture("turned.png") - first).max(axis=2).mean() > 2.0
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.locator("#labels span").count() == 3
    page.close()
