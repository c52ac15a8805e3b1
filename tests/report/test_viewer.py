"""The viewer of a reconstruction in a browser."""

import base64
import dataclasses

import cv2
import numpy as np
import pytest

from omnisight.report.viewer import write_viewer
from omnisight.report.viewer_data import MAX_OBSERVATIONS, _point_data
from reconstructing import independent, paint, single, two_fisheyes, without_points

PANEL_PX = 340  # the width of the panel, which covers the left side


@pytest.fixture
def viewed(opened, tmp_path):
    """Return a function that opens the viewer of a reconstruction."""

    def view(made, *, images=True):
        write_viewer(tmp_path / "viewer.html", made, paint(made, tmp_path / "images") if images else None)
        page = opened(tmp_path / "viewer.html")
        page.wait_for_function("window.viewer !== undefined")
        return page

    return view


def screenshot(page):
    page.wait_for_timeout(300)  # the images load, and the next frame is drawn
    return cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1].astype(int)


def on_screen(page, kind, k):
    """Return the position of a point or a camera on the page, px, or None if the panel hides it."""
    at = page.evaluate(f"viewer.{kind}OnScreen({k})")
    return at[:2] if at and PANEL_PX < at[0] < 1270 and 10 < at[1] < 790 else None


@pytest.mark.parametrize("make", [single, two_fisheyes, independent])
def test_the_image_around_a_camera_shows_the_points_where_they_are(viewed, make):
    made = make()
    page = viewed(made)
    page.fill("#point-size", "0")
    page.fill("#camera-size", "0")
    compared = 0
    for image in range(0, len(made), 3):
        page.select_option("#camera", str(image))
        shown = screenshot(page)
        camera = made.rig.cameras[made.sensor[image]]
        pixels, valid = camera.project(made.cam_from_world(image) @ made.points.position)
        valid &= camera.in_image(pixels) & camera.calibrated(made.cam_from_world(image) @ made.points.position)
        for k in np.flatnonzero(valid):
            at = on_screen(page, "point", k)
            if at is None or np.linalg.norm(np.delete(pixels, k, 0) - pixels[k], axis=1).min() < 25:
                continue
            square = shown[round(at[1]) - 1 : round(at[1]) + 2, round(at[0]) - 1 : round(at[0]) + 2].mean(axis=(0, 1))
            assert np.abs(square - (made.points.color[k] // 2 + 128)).max() < 40, (image, k)
            compared += 1
    assert compared > 10


def test_a_click_on_a_point_lists_its_observations_and_each_leads_into_its_image(viewed):
    made = single()
    page = viewed(made)
    page.fill("#camera-size", "0")
    k = next(k for k in range(len(made.points)) if on_screen(page, "point", k))
    page.mouse.click(*on_screen(page, "point", k))
    assert page.inner_text("#details h2") == f"Point {k}: {len(made)} observations"
    row = np.flatnonzero(made.observations.point == k)[2]
    u, v = made.observations.pixels[row]
    length = np.linalg.norm(made.observations.residuals[row])
    button = page.locator("button.image").nth(2)
    assert button.inner_text().split("\n") == ["camera/002.png", f"{u:.1f}, {v:.1f}; {length:.2f} px"]
    button.click()
    assert page.input_value("#camera") == "2"
    # The view turns to the point.
    assert page.evaluate(f"viewer.pointOnScreen({k})")[:2] == pytest.approx([640, 400], abs=1)
    page.keyboard.press("Escape")
    assert page.input_value("#camera") == "-1"


def test_a_click_on_a_camera_looks_around_from_it(viewed):
    made = single()
    page = viewed(made)
    before = screenshot(page)
    page.mouse.click(*page.evaluate("viewer.cameraOnScreen(3)")[:2])
    # A nearer camera may hide it.
    chosen = int(page.input_value("#camera"))
    assert chosen >= 0
    assert page.inner_text("#details h2") == made.names[chosen]
    inside = screenshot(page)
    assert np.abs(inside - before)[:, PANEL_PX:].mean() > 5
    page.mouse.move(800, 400)
    page.mouse.down()
    page.mouse.move(900, 450, steps=3)
    page.mouse.up()
    assert int(page.input_value("#camera")) == chosen
    assert np.abs(screenshot(page) - inside)[:, PANEL_PX:].mean() > 1


@pytest.mark.parametrize("make", [single, two_fisheyes])
def test_the_distance_of_two_points_is_measured(viewed, make):
    made = make()
    page = viewed(made, images=False)
    page.click("#measure")
    first, second = [k for k in range(len(made.points)) if on_screen(page, "point", k)][:2]
    page.mouse.click(*on_screen(page, "point", first))
    assert "second point" in page.inner_text("#details")
    page.mouse.click(*on_screen(page, "point", second))
    _, value, unit = page.inner_text("#details h2").split()
    distance = np.linalg.norm(made.points.position[first] - made.points.position[second])
    assert float(value) == pytest.approx(distance, rel=1e-3)
    assert unit == ("m" if made.has_scale else "units")


def test_the_view_turns_moves_zooms_and_flies(viewed):
    page = viewed(single(), images=False)
    last = np.array(page.evaluate("viewer.pointOnScreen(0)"))
    actions = {
        "turn": lambda: drag(page),
        "move": lambda: drag(page, button="right"),
        "zoom": lambda: page.mouse.wheel(0, -300),
        "fly": lambda: page.keyboard.press("w", delay=200),
    }
    home = last
    for name, action in actions.items():
        action()
        page.wait_for_timeout(100)
        at = np.array(page.evaluate("viewer.pointOnScreen(0)"))
        assert np.abs(at - last).max() > 0.05, name
        last = at
    page.click("#reset")
    assert page.evaluate("viewer.pointOnScreen(0)") == pytest.approx(home.tolist())


def drag(page, button="left"):
    page.mouse.move(700, 400)
    page.mouse.down(button=button)
    page.mouse.move(780, 430, steps=3)
    page.mouse.up(button=button)


def test_a_reconstruction_without_points_or_images_is_shown(viewed):
    page = viewed(without_points(single()), images=False)
    assert "6 images, 0 points" in page.inner_text("#figures")
    assert screenshot(page)[:, PANEL_PX:].std() > 1


def test_names_cannot_inject_markup(viewed, opened, tmp_path):
    made = single()
    made = dataclasses.replace(made, names=("</script><script>alert(1)</script>", *made.names[1:]))
    page = viewed(made, images=False)
    assert page.locator("#camera option").nth(1).inner_text() == made.names[0]
    assert page.locator("script").count() == 2


def test_of_too_many_observations_those_of_the_longest_tracks_are_embedded(monkeypatch):
    made = two_fisheyes()
    count = np.bincount(made.observations.point, minlength=len(made.points))
    assert len(made.observations) < MAX_OBSERVATIONS
    monkeypatch.setattr("omnisight.report.viewer_data.MAX_OBSERVATIONS", len(made.observations) // 2)
    data = _point_data(made, np.zeros(3))
    kept = np.frombuffer(base64.b64decode(data["index"]), "<u4")
    first = np.frombuffer(base64.b64decode(data["first"]), "<u4")
    assert 0 < len(kept) < len(made.points)
    assert first[-1] <= len(made.observations) // 2
    np.testing.assert_array_equal(np.diff(first), count[kept])
    assert count[kept].min() >= np.delete(count, kept).max()
