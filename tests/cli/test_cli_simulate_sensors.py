"""omnisight simulate with sensors of the motion."""

import json

import numpy as np
import pytest

import omnisight as om
from omnisight.formats import save
from omnisight.geometry.geodesy import east_north_up
from omnisight.simulation.trajectory import read_trajectory


@pytest.fixture
def small(tmp_path):
    return save(om.fisheye(32, 180), tmp_path / "small.json").path


@pytest.fixture
def common(small, tmp_path):
    """Arguments of a data set that takes little time."""
    return ("simulate", "lines", "--camera", small, "--rays", 1, "-o", tmp_path / "out")


def test_sensors_have_files_at_their_rates(run, common, tmp_path):
    options = ("--frames", 5, "--fps", 10, "--imu", 200, "--odometry", 50, "--gnss", 5, "--sensor-noise", 0)
    status, _, err = run(*common, *options, "--origin", "-33.9,18.4,20")
    assert (status, err) == (0, "")
    folder, poses = tmp_path / "out" / "motion", read_trajectory(tmp_path / "out" / "poses.txt")
    tables = {name: np.loadtxt(folder / f"{name}.csv", delimiter=",") for name in ("imu", "odometry", "gnss")}
    for name, rate in (("imu", 200), ("odometry", 50), ("gnss", 5)):
        times = tables[name][:, 0]
        assert times[0] == round(poses.times[0] * 1e9)
        np.testing.assert_allclose(np.diff(times), 1e9 / rate, atol=1)
        assert 0 <= times[-1] - poses.times[-1] * 1e9 < 1e9 / rate
    assert np.linalg.norm(tables["imu"][:, 4:], axis=1).mean() == pytest.approx(9.81, abs=0.3)
    x, y, z = poses.poses[2].translation
    local = east_north_up(tables["gnss"][1, 1:4], (-33.9, 18.4, 20.0))
    np.testing.assert_allclose(local, (x, z, -y), atol=1e-6)
    assert not np.loadtxt(folder / "imu_biases.csv", delimiter=",")[:, 1:].any()
    assert "update_rate: 200" in (folder / "imu.yaml").read_text()
    assert "motion/ " in (tmp_path / "out" / "README.txt").read_text()
    settings = json.loads((tmp_path / "out" / "settings.json").read_text())["motion_sensors"]
    assert settings == {"imu_hz": 200, "odometry_hz": 50, "gnss_hz": 5, "noise": 0, "origin": [-33.9, 18.4, 20]}


def test_files_of_an_older_data_set_are_removed(run, common, tmp_path):
    assert run(*common, "--frames", 1, "--imu", 100)[0] == 0
    assert (tmp_path / "out" / "motion" / "imu.csv").is_file()
    assert run(*common, "--frames", 1)[0] == 0
    assert not (tmp_path / "out" / "motion").exists()


def test_noisy_poses_of_a_file_cause_a_note(run, common, tmp_path):
    rng = np.random.default_rng(0)
    lines = [f"{0.01 * i} {rng.normal(0, 0.1)} 0 0 0 0 0 1" for i in range(100)]
    (tmp_path / "way.txt").write_text("\n".join(lines) + "\n")
    status, _, err = run(*common, "--frames", 1, "--trajectory", tmp_path / "way.txt", "--imu", 100)
    assert status == 0
    assert "way.txt differs from its poses by up to 0." in err


def test_invalid_sensors_are_rejected(refuses, common):
    assert "--imu must be from 0 to 10000 Hz" in refuses(*common, "--imu", -5)
    message = "--origin must be LATITUDE,LONGITUDE,ALTITUDE, such as 47.3769,8.5417,408, got 'Zurich'"
    assert message in refuses(*common, "--origin", "Zurich")


def test_options_of_sensors_that_are_not_simulated_are_refused(run, refuses, common):
    message = "--sensor-noise 0: there is no sensor of the motion: add --imu, --odometry or --gnss RATE"
    assert message in refuses(*common, "--sensor-noise", 0)
    message = "--origin -33.9,18.4,20: nothing depends on it: add --gnss RATE"
    assert message in refuses(*common, "--origin", "-33.9,18.4,20")
    assert message in refuses(*common, "--origin", "-33.9,18.4,20", "--imu", 200)
    street = [argument if argument != "lines" else "street" for argument in common]
    assert run(*street, "--frames", 1, "--origin", "-33.9,18.4,20", "--time", "10:00")[0] == 0
