"""omnisight simulate with conditions of the visit."""

import json

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
    assert "note: the light is -" in err
    assert "add --exposure" in err
    settings = json.loads((tmp_path / "out" / "settings.json").read_text())
    assert (settings["time"], settings["weather"]) == ("18:00", "fog")


def test_invalid_conditions_are_rejected(refuses, small, tmp_path):
    common = ("simulate", "lines", "--camera", small, "-o", tmp_path / "out")
    assert "--time must be HH:MM, such as 17:30, got 'noon'" in refuses(*common, "--time", "noon")
    assert "only to outdoor scenes" in refuses(*common, "--time", "12:00")
    assert "--exposure-drift must be from 0 to 10 stops" in refuses(*common, "--exposure-drift", -1)
    assert not (tmp_path / "out").exists()
