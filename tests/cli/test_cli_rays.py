"""The commands and cameras whose rays do not meet in a point."""

import json
import re

import numpy as np
import pytest
from cli_scene import QUICK, SIZE

import omnisight as om
from omnisight.images import write_image
from omnisight.optics import Catadioptric
from omnisight.optics.models.axial import Axial
from omnisight.simulation.example_rigs import back_to_back

CAMERA = om.RayCamera(Axial.example(), (960, 962), theta_max=1.5, covariance=np.eye(10) * 1e-6)
MIRROR = om.RayCamera(Catadioptric.example(), SIZE)


@pytest.fixture
def rays_file(tmp_path):
    return om.save(CAMERA, tmp_path / "rays.json").path


def test_axial_writes_a_camera_of_rays(run, shots, tmp_path):
    command = "--pattern", "9x6", "--square", "30mm", "--model", "axial"
    status, out, err = run("calibrate", shots, *command, "-o", tmp_path / "camera.json")
    assert (status, err) == (0, "")
    assert "viewpoint: " in out
    assert "0.2 m away is off by" in out
    found = om.load(tmp_path / "camera.json")
    # All that is printed is of the camera that is written, the central one is beside it.
    assert re.search(r"^axial .* px on images it was not calibrated on", out, re.MULTILINE)
    assert re.search(r"^central: \w+", out, re.MULTILINE)
    assert f"rms {found.calibration['rms']:.3f} px" in out
    assert isinstance(found, om.RayCamera)
    assert found.model.name == "axial"
    assert (found.size, found.unit) == (SIZE, "m")
    assert found.provenance["pattern"] == "9x6"
    assert found.rays([[320.0, 240.0]]).valid.all()
    assert f"verdict: {found.calibration['verdict']}" in out


def test_json_says_whether_one_is_needed(run, shots):
    status, out, _ = run("calibrate", shots, *QUICK, "--json")
    assert status == 0
    said = json.loads(out)["viewpoint"]
    assert not said["needed"]
    assert said["unit"] == "squares"
    assert [round(left["distance"]) for left in said["central_leaves"]] == [8, 40, 200]
    for left in said["central_leaves"]:
        assert left["rms_px"] <= left["max_px"]
        assert len(left["px"]) == len(left["theta_deg"])


def test_an_unknown_model_is_refused_with_the_names_of_all(run, shots):
    status, _, err = run("calibrate", shots, "--model", "nonsense")
    assert status == 2
    assert "unknown camera model 'nonsense'" in err
    assert "kannala_brandt" in err
    assert "axial" in err


def test_ocamcalibs_steps_are_for_central_cameras(run, shots):
    status, _, err = run("calibrate", shots, "--model", "axial", "--method", "ocamcalib")
    assert status == 2
    assert "--method ocamcalib" in err


def test_inspect_says_what_it_is(run, rays_file):
    status, out, err = run("inspect", rays_file)
    assert (status, err) == (0, "")
    assert "model       axial" in out
    assert "pupil0            0.006 +- 0.001    m" in out
    assert "rays        do not meet in a point" in out
    assert "viewpoint   moves by 3.48 mm along the axis, 0 to 86 degrees" in out
    assert "radius, px" in out


def test_inspect_takes_lens_and_mirror(run, tmp_path):
    om.save(om.RayCamera(Catadioptric.example(), (1280, 960)), tmp_path / "mirror.json")
    status, out, err = run("inspect", tmp_path / "mirror.json")
    assert (status, err) == (0, "")
    assert "mirror_radius" in out
    assert "rays        do not meet in a point" in out
    status, _, err = run("inspect", tmp_path / "mirror.json", "--svg", tmp_path / "curve.svg")
    assert status == 2
    assert "no r(theta) to draw" in err


def test_convert_and_view_ask_for_a_distance(run, rays_file, tmp_path):
    write_image(tmp_path / "image.png", np.full((962, 960), 90, np.uint8))
    for command in (
        ("convert", rays_file, "--to", "opencv"),
        ("view", tmp_path / "image.png", "--camera", rays_file, "-o", tmp_path / "view.png"),
    ):
        status, _, err = run(*command)
        assert status == 2
        assert "rays do not meet in a point (axial)" in err
        assert "--distance 2m" in err


def test_convert_takes_a_mirror_too(run, tmp_path):
    om.save(om.RayCamera(Catadioptric.example(), (1280, 960)), tmp_path / "mirror.json")
    command = "convert", tmp_path / "mirror.json", "--to", "native", "--distance", "2m", "-o", tmp_path / "central.json"
    status, out, err = run(*command)
    assert (status, err) == (0, "")
    assert "central     spline, at most 0.00" in out
    assert "left and right are exchanged as in the image" in out
    assert om.load(tmp_path / "central.json").provenance["central_of"]["mirrored"]


def test_convert_writes_the_central_camera_of_a_distance(run, rays_file, tmp_path):
    for distance, away in (("1m", 1.0), ("inf", 1e9)):
        command = "convert", rays_file, "--to", "opencv", "-o", tmp_path / "camera.yml", "--distance", distance
        status, out, err = run(*command)
        assert (status, err) == (0, "")
        assert "written" in out
        central = om.load(tmp_path / "camera.yml")
        points, valid = CAMERA.points_at([[300.0, 400.0], [480.0, 100.0]], away)
        assert valid.all()
        np.testing.assert_allclose(central.project(points)[0], [[300.0, 400.0], [480.0, 100.0]], atol=0.01)


def test_view_shows_what_is_at_a_distance(run, rays_file, tmp_path):
    write_image(tmp_path / "image.png", np.full((962, 960), 90, np.uint8))
    command = "view", tmp_path / "image.png", "--camera", rays_file, "-o", tmp_path / "view.png"
    assert run(*command, "--distance", "1m", "--size", "64x48")[0] == 0
    assert om.read_image(tmp_path / "view.png").shape[:2] == (48, 64)


@pytest.mark.parametrize(
    ("distance", "said"),
    [("1", "has no unit"), ("-1m", "cannot read the length"), ("nonsense", "cannot read the length")],
)
def test_a_distance_that_cannot_be_read_is_refused(run, rays_file, distance, said):
    status, _, err = run("convert", rays_file, "--to", "opencv", f"--distance={distance}")
    assert status == 2
    assert said in err


def test_a_central_camera_takes_no_distance(run, camera_file):
    status, _, err = run("convert", camera_file, "--to", "opencv", "--distance", "1m")
    assert status == 2
    assert "leave it out" in err


def test_lengths_in_squares_are_given_so(run, tmp_path):
    om.save(om.RayCamera(Axial.example(), (960, 962), "squares", theta_max=1.5), tmp_path / "rays.json")
    status, _, err = run("convert", tmp_path / "rays.json", "--to", "opencv", "--distance", "2m")
    assert status == 2
    assert "20squares" in err
    command = "convert", tmp_path / "rays.json", "--to", "opencv", "--distance", "20squares"
    assert run(*command, "-o", tmp_path / "camera.yml")[0] == 0


def test_view_and_next_take_the_name_of_a_camera_of_a_rig(run, tmp_path, shots):
    om.save_rig(back_to_back(480), tmp_path / "rig.json")
    write_image(tmp_path / "image.png", np.full((480, 480), 90, np.uint8))
    command = "view", tmp_path / "image.png", "--camera", tmp_path / "rig.json", "-o", tmp_path / "view.png"
    status, _, err = run(*command, "--size", "64x48")
    assert status == 2
    assert "holds 2 cameras: front, back; say which one: --name front" in err
    assert run(*command, "--size", "64x48", "--name", "back")[0] == 0
    status, _, err = run("next", shots, "--camera", tmp_path / "rig.json", "--name", "up")
    assert status == 2
    assert "no camera 'up'; it holds front, back" in err


@pytest.mark.parametrize(
    ("camera", "more", "said"),
    [
        (MIRROR, ("--model", "mei"), "has a model of its own: leave out --model mei"),
        (MIRROR, ("--method", "ocamcalib"), "--start others"),
        (om.Camera(CAMERA.model.lens, SIZE), (), "a central camera (kannala_brandt), which needs no start"),
        (MIRROR, ("--pattern", "9x6"), "its lengths are in metres, the board's are not: give the side of a square"),
        (om.RayCamera(MIRROR.model, (9, 9)), ("--pattern", "9x6"), "for images of 9x9; these are 640x480"),
    ],
)
def test_a_start_that_does_not_fit_is_refused(run, shots, tmp_path, camera, more, said):
    om.save(camera, tmp_path / "start.json")
    status, _, err = run("calibrate", shots, "--start", tmp_path / "start.json", *more)
    assert status == 2
    assert said in err


def test_a_start_is_refined(run, shots, camera_file, tmp_path):
    central = om.load(camera_file)
    om.save(om.RayCamera(Axial(central.model, (0.0,)), central.size), tmp_path / "start.json")
    command = "calibrate", shots, "--pattern", "9x6", "--square", "30mm", "--start", tmp_path / "start.json"
    status, out, err = run(*command, "-o", tmp_path / "camera.json", "--json")
    assert (status, err) == (0, "")
    said, found = json.loads(out), om.load(tmp_path / "camera.json")
    assert said["model"] == found.model.name == "axial"
    assert said["rms"] == found.calibration["rms"]
    assert said["held_out_rms"] == found.calibration["held_out_rms"] < 0.5
    assert said["central"]["held_out_rms"] == found.calibration["central_held_out_rms"]
    squares = [picture["corners"] * picture["rms"] ** 2 for picture in said["images"]]
    assert np.sqrt(sum(squares) / found.calibration["corners"]) == pytest.approx(said["rms"])
    assert abs(found.model.pupil[0]) < 0.05


def test_next_says_what_it_takes(run, rays_file, shots):
    status, _, err = run("next", shots, "--camera", rays_file)
    assert status == 2
    assert "which this command does not take" in err
