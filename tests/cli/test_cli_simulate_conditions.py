"""omnisight simulate with conditions of the visit."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

import omnisight as om
from omnisight.formats import save
from omnisight.images import read_image

ROOM_OPTIONS = ("--rays", 1, "--frames", 4, "--fps", 0.1)


@pytest.fixture
def small(tmp_path):
    return save(om.fisheye(32, 180), tmp_path / "small.json").path


def test_exposure_drift_changes_the_images_as_the_file_states(run, small, tmp_path):
    common = ("simulate", "lines", "--camera", small, *ROOM_OPTIONS, "--trajectory", "still", "--noise", 0)
    assert run(*common, "--exposure-drift", 0.4, "-o", tmp_path / "out")[0] == 0
    rows = [line.split(",") for line in (tmp_path / "out" / "exposure.csv").read_text().splitlines()[1:]]
    assert [row[1] for row in rows] == [f"images/{i:06d}.png" for i in range(4)]
    exposures = np.array([float(row[2]) for row in rows])
    assert exposures.std() > 0.05
    means = [read_image(tmp_path / "out" / row[1]).mean() for row in rows]
    np.testing.assert_array_equal(np.argsort(means), np.argsort(exposures))
    assert "exposure.csv" in (tmp_path / "out" / "README.txt").read_text()
    assert run(*common, "--exposure", float(exposures[2]), "-o", tmp_path / "fixed")[0] == 0
    fixed = read_image(tmp_path / "fixed" / "images" / "000002.png").astype(int)
    assert np.abs(fixed - read_image(tmp_path / "out" / rows[2][1])).max() <= 1


def test_time_and_weather_of_a_street(run, small, tmp_path):
    options = ("--rays", 1, "--frames", 1, "--time", "18:00", "--weather", "fog", "-o", tmp_path / "out")
    status, _, err = run("simulate", "street", "--camera", small, *options)
    assert status == 0
    assert "warning: the light is -" in err
    assert "add --exposure" in err
    settings = json.loads((tmp_path / "out" / "settings.json").read_text())
    assert (settings["time"], settings["weather"]) == ("18:00", "fog")


def test_invalid_conditions_are_rejected(refuses, small, tmp_path):
    common = ("simulate", "lines", "--camera", small, "-o", tmp_path / "out")
    assert "--time must be HH:MM, such as 17:30, got 'noon'" in refuses(*common, "--time", "noon")
    assert "only to outdoor scenes" in refuses(*common, "--time", "12:00")
    assert "--exposure-drift must be from 0 to 10 stops" in refuses(*common, "--exposure-drift", -1)
    assert not (tmp_path / "out").exists()


def test_masks_of_moving_objects_agree_with_the_instances(run, small, tmp_path, monkeypatch):
    from omnisight.pipeline.simulation import simulated_scene
    from omnisight.simulation import scene_named
    from omnisight.simulation.solids import ellipsoid
    from omnisight.simulation.texture import Texture
    from omnisight.simulation.traffic import Actor
    from omnisight.simulation.trajectory import Trajectory

    way = Trajectory(np.array((0.0, 4.0)), tuple(om.Pose(translation=np.array((x, 0.0, 1.0))) for x in (-1, 1)))
    ball = Actor("ball", (ellipsoid((0, 0, 0), 0.3, Texture.plain((200, 0, 0)), "x"),), way, 0.0)
    scene = replace(scene_named("lines"), traffic=lambda: (ball,))
    monkeypatch.setattr(simulated_scene, "scene_named", lambda name, seed: scene)
    options = ("--rays", 1, "--frames", 3, "--fps", 1, "--trajectory", "still", "--traffic", "-o", tmp_path / "out")
    assert run("simulate", "lines", "--camera", small, *options, "--export", "colmap")[0] == 2  # an equidistant lens
    assert run("simulate", "lines", "--camera", small, *options, "--export", "covisibility")[0] == 0
    names = json.loads((tmp_path / "out" / "instances.json").read_text())
    number = next(int(key) for key, name in names.items() if name == "ball")
    centres = []
    for i in range(3):
        mask, instances = (
            cv2.imread(str(tmp_path / "out" / kind / f"{i:06d}.png"), cv2.IMREAD_UNCHANGED)
            for kind in ("masks", "instances")
        )
        np.testing.assert_array_equal(mask, np.where(instances == number, 0, 255))
        centres.append(np.nonzero(mask == 0)[1].mean())
    assert centres[0] < centres[1] - 2 < centres[2] - 4
    assert "masks/" in (tmp_path / "out" / "README.txt").read_text()
    assert run("simulate", "lines", "--camera", small, "--rays", 1, "--frames", 1, "-o", tmp_path / "out")[0] == 0
    assert not (tmp_path / "out" / "masks").exists()


def test_scenes_without_cars_are_rejected(refuses, small, tmp_path):
    common = ("simulate", "lines", "--camera", small, "-o", tmp_path / "out")
    assert "--visit 1 applies only to scenes with parked cars: town" in refuses(*common, "--visit", 1)
    assert "--visit must not be negative" in refuses(*common, "--visit", -1)
    assert "--traffic applies only to scenes with moving objects: town" in refuses(*common, "--traffic")


def test_exposure_time_blurs_images_and_keeps_the_ground_truth(run, refuses, small, tmp_path):
    (tmp_path / "way.txt").write_text("0 0 0 0 0 0 0 1\n1 0 0 0 0 0.7071068 0 0.7071068\n")
    common = ("simulate", "lines", "--camera", small, "--frames", 2, "--fps", 2, "--trajectory", tmp_path / "way.txt")
    images = {}
    for name, duration in (("sharp", 0), ("blurred", 100)):
        options = ("--noise", 0, "--rolling-shutter", 10, "--exposure-time", duration)
        assert run(*common, *options, "-o", tmp_path / name)[0] == 0
        images[name] = read_image(tmp_path / name / "images" / "000001.png").astype(int)
    depths = [(tmp_path / name / "depth" / "000001.png").read_bytes() for name in images]
    assert depths[0] == depths[1]
    assert np.abs(images["sharp"] - images["blurred"]).mean() > 2
    contrasts = [np.abs(np.diff(image, axis=1)).mean() for image in images.values()]
    assert contrasts[1] < 0.95 * contrasts[0]
    settings = json.loads((tmp_path / "blurred" / "settings.json").read_text())
    assert settings["exposure_time_ms"] == 100
    assert "--exposure-time must be from 0" in refuses(*common, "--exposure-time", -1, "-o", tmp_path / "out")
