"""omnisight birdseye with cameras in place of a rig, and with ground that no camera sees."""

import json

import numpy as np
import pytest

import omnisight as om
import rendered_car as car

SMALL = ("--pixel", "4cm", "--margin", "2m")


@pytest.fixture
def folder(tmp_path):
    car.write(tmp_path)
    return tmp_path


def arguments(folder):
    return "birdseye", *(folder / f"{name}.png" for name in car.RIG.names), "--rig", folder / "rig.json"


def _view(run, command, output):
    """Run a command that writes a view, and return the view."""
    status, _, err = run(*command, "-o", output)
    assert status == 0, err
    return om.read_image(output)


def test_cameras_without_a_rig_are_posed_by_marks(run, folder):
    cameras, marks = [], {}
    for name, camera, pose in zip(car.RIG.names, car.RIG.cameras, car.RIG.sensor_from_rig, strict=True):
        om.save(camera, folder / f"{name}_camera.json")
        cameras += ["--camera", f"{name}={folder / name}_camera.json"]
        grid = np.stack(np.meshgrid(np.linspace(-3, 3, 13), np.linspace(-4, 4, 17)), -1).reshape(-1, 2)
        pixels, visible = camera.project(pose @ np.insert(grid, 1, 0.0, axis=1))
        visible &= ((pixels > 0) & (pixels < camera.size)).all(axis=1)
        pairs = zip(pixels[visible].tolist(), grid[visible].tolist(), strict=True)
        marks[name] = [{"pixel": pixel, "ground": ground} for pixel, ground in pairs]
    (folder / "marks.json").write_text(json.dumps({"marks": marks}))
    files = [folder / f"{name}.png" for name in car.RIG.names]
    expected = _view(run, (*arguments(folder), *SMALL), folder / "expected.png")
    ground = ("--ground", folder / "marks.json")
    found = _view(run, ("birdseye", *files, *cameras, *ground, *SMALL), folder / "found.png")
    assert np.percentile(np.abs(found.astype(int) - expected), 99) <= 4
    for others, message in [
        (cameras, "specify marks on the ground that each of them sees"),
        ((), "specify either the rig"),
        ((*cameras, "--rig", folder / "rig.json"), "specify either the rig"),
        (("--camera", folder / "front_camera.json"), "must be NAME=FILE"),
    ]:
        status, _, err = run("birdseye", *files, *others, "-o", folder / "top.png")
        assert status == 2
        assert message in err


def test_share_of_the_view_that_no_camera_sees_is_reported(run, folder):
    (folder / "masks").mkdir()
    mask = np.full(car.RIG.cameras[0].size[::-1], 255, np.uint8)
    mask[:, 60:] = 0
    om.write_image(folder / "masks" / "front.png", mask)
    unseen = []
    for k, masks in enumerate([(), ("--masks", folder / "masks")]):
        status, out, err = run(*arguments(folder), *SMALL, *masks, "-o", folder / f"{k}.png", "--json")
        assert status == 0, err
        unseen.append(json.loads(out)["unseen_share"])
    image = om.read_image(folder / "1.png")
    black = (image == 0).all(axis=2).mean() - (om.read_image(folder / "0.png") == 0).all(axis=2).mean()
    assert unseen[1] - unseen[0] == pytest.approx(black, abs=0.005)
