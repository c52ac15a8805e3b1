"""omnisight compass, on rolled panoramas and on a robot's route."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

import omnisight as om

DATA = Path(os.environ.get("OMNISIGHT_DATA", Path(__file__).resolve().parents[3] / "shared/data"))
ROUTE = DATA / "robot_route"
KEYS = ["name", "nearest", "heading_deg", "sigma_deg", "similarity"]


def panorama(seed):
    noise = np.random.default_rng(seed).integers(40, 220, (5, 24), np.uint8)
    return np.kron(noise, np.ones((5, 5), np.uint8))


@pytest.fixture
def folders(tmp_path):
    """Return folders of queries, each a rolled reference with another brightness, and of references."""
    images, route = tmp_path / "images", tmp_path / "route"
    images.mkdir()
    route.mkdir()
    for i in range(3):
        om.write_image(route / f"r{i}.png", panorama(i))
        om.write_image(images / f"q{i}.png", np.roll(panorama(i), -10 * (i + 1), axis=1) // 2)
    return images, route


def test_json(run, folders):
    images, route = folders
    status, out, err = run("compass", images, "--reference", route, "--json")
    data = json.loads(out)
    assert (status, err) == (0, "")
    assert list(data) == ["headings", "references", "failed", "reason"]
    assert [list(each) for each in data["headings"]] == [KEYS] * 3
    assert [(each["name"], each["nearest"]) for each in data["headings"]] == [
        (f"q{i}.png", f"r{i}.png") for i in range(3)
    ]
    assert [each["heading_deg"] for each in data["headings"]] == pytest.approx([30, 60, 90], abs=0.2)
    assert all(0 <= each["sigma_deg"] < 1 for each in data["headings"])
    assert (data["references"], data["failed"], data["reason"]) == (3, {}, "")


def test_the_table_and_the_first_image_as_reference(run, folders):
    images, _ = folders
    om.write_image(images / "q1.png", np.roll(om.read_image(images / "q0.png"), -7, axis=1))
    status, out, err = run("compass", images)
    assert (status, err) == (0, "")
    rows = [line.split() for line in out.splitlines()]
    assert rows[0] == ["image", "nearest", "heading", "sigma", "similarity"]
    assert [row[:3] for row in rows[1:3]] == [["q0.png", "q0.png", "+0.0°"], ["q1.png", "q0.png", "+21.0°"]]
    assert out.splitlines()[-2].startswith("headings  3, 1 reference,")
    assert out.splitlines()[-1].startswith("note      1 unknown (σ of 45° or more)")  # q2.png is another place


def test_images_and_references_of_equal_names_are_distinct(run, folders):
    images, route = folders
    rng = np.random.default_rng(0)
    for i in range(3):
        noisy = np.clip(om.read_image(images / f"q{i}.png") + rng.normal(0, 12, (25, 120)), 0, 255)
        om.write_image(images / f"r{i}.png", noisy.astype(np.uint8))
        (images / f"q{i}.png").unlink()
    for folder in (images, route):
        om.write_image(folder / "uniform.png", np.full((25, 120), 80, np.uint8))
    _, out, _ = run("compass", images, "--reference", route)
    assert "± 0.00°" not in out
    assert out.count("left out") == 2
    failed = json.loads(run("compass", images, "--reference", route, "--json")[1])["failed"]
    assert set(failed) == {str(folder / "uniform.png") for folder in folders}


def test_the_first_image_specified_is_the_reference(folders):
    _, route = folders
    for i in range(3):
        om.write_image(route / f"r{i}.png", np.roll(panorama(0), -10 * i, axis=1))
    found = om.compass([route / f"r{i}.png" for i in (2, 0, 1)]).headings
    assert [each.name for each in found] == ["r2.png", "r0.png", "r1.png"]
    assert {each.nearest for each in found} == {"r2.png"}
    assert [each.is_reference for each in found] == [True, False, False]


def test_an_image_is_not_its_own_reference(run, folders):
    _, route = folders
    status, out, _ = run("compass", route / "r0.png", "--reference", route, "--json")
    assert status == 0
    assert json.loads(out)["headings"][0]["nearest"] != "r0.png"
    status, out, err = run("compass", route / "r0.png", "--reference", route / "r0.png", "--json")
    assert status == 2
    assert "is the only reference" in err
    assert "is the only reference" in json.loads(out)["reason"]


def test_unusable_images_are_left_out_with_a_reason(run, folders):
    images, route = folders
    om.write_image(images / "uniform.png", np.full((25, 120), 80, np.uint8))
    om.write_image(images / "other.png", panorama(1)[:20])
    om.write_image(images / "color.png", np.repeat(panorama(2)[..., None], 3, axis=2))
    om.write_image(images / "large.png", np.kron(panorama(0), np.ones((4, 4), np.uint8)))
    (images / "broken.png").write_bytes(b"no image")
    status, out, _ = run("compass", images, "--reference", route, "--json")
    data = json.loads(out)
    nearest = {each["name"]: each["nearest"] for each in data["headings"]}
    assert status == 0
    assert (nearest["color.png"], nearest["large.png"]) == ("r2.png", "r0.png")
    assert set(data["failed"]) == {"uniform.png", "other.png", "broken.png"}
    assert not any(name in reason for name, reason in data["failed"].items())
    assert "is uniform along its rows" in data["failed"]["uniform.png"]
    assert "is 120x20 px, the first panorama 120x25" in data["failed"]["other.png"]
    assert "left out  uniform.png" in run("compass", images, "--reference", route)[1]


def test_invalid_input_is_refused(refuses, folders, tmp_path):
    images, _ = folders
    (tmp_path / "empty").mkdir()
    assert "no images in" in refuses("compass", tmp_path / "empty")
    assert "no images in" in refuses("compass", images, "--reference", tmp_path / "empty")
    assert "missing: no such file" in refuses("compass", images, "--reference", tmp_path / "missing")
    assert "missing.json" in refuses("compass", images, "--camera", tmp_path / "missing.json")
    assert "specify its file (--camera)" in refuses("compass", images, "--up", "back")
    om.write_image(tmp_path / "photo.png", np.zeros((48, 64), np.uint8))
    assert "specify the camera of raw images (--camera)" in refuses("compass", tmp_path / "photo.png")
    om.save(om.perspective((64, 48), 90), tmp_path / "camera.json")
    message = refuses("compass", tmp_path / "photo.png", "--camera", tmp_path / "camera.json")
    assert "does not see 360° around the vertical" in message
    assert "--up front" in message


@pytest.mark.slow
@pytest.mark.skipif(not ROUTE.is_dir(), reason="robot_route is absent")
def test_places_and_headings_on_the_route_of_a_robot():
    files = [ROUTE / f"snapshot_{i}.png" for i in range(100, 200)]
    result = om.compass(files[1::2], files[::2])
    away = [int(each.nearest[9:-4]) - int(each.name[9:-4]) for each in result.headings]
    assert len(away) == 50
    assert np.median(np.abs(away)) <= 3
    assert np.max(np.abs(away)) < 20
    assert np.max(np.abs([each.heading_deg for each in result.headings])) < 15
