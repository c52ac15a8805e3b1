"""The commands with non-central cameras."""

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


def test_axial_writes_a_non_central_camera(run, shots, tmp_path):
    command = "--pattern", "9x6", "--square", "30mm", "--model", "axial"
    status, out, err = run("calibrate", shots, *command, "-o", tmp_path / "camera.json")
    assert (status, err) == (0, "")
    camera = om.load(tmp_path / "camera.json")
    # The printed figures are those of the written camera; the central one is printed for comparison.
    assert re.search(rf"^axial .* \d+ +{camera.calibration['rms']:.3f} +\d\.\d+ +\d+% +selected *$", out, re.MULTILINE)
    assert re.search(r"^\w+ +\d+ +\d\.\d+ +\d\.\d+ +central, for comparison$", out, re.MULTILINE)
    assert re.search(r"^camera    axial .*, 640x480, calibrated to", out, re.MULTILINE)
    assert isinstance(camera, om.RayCamera)
    assert camera.model.name == "axial"
    assert (camera.size, camera.unit) == (SIZE, "m")
    assert camera.provenance["pattern"] == "9x6"
    assert camera.rays([[320.0, 240.0]]).valid.all()
    assert f"verdict   {camera.calibration['verdict'].upper()}" in out


def test_json_contains_the_non_centrality_test(run, shots):
    status, out, _ = run("calibrate", shots, *QUICK, "--json")
    assert status == 0
    test = json.loads(out)["noncentrality"]
    assert not test["is_noncentral"]
    assert test["unit"] == "squares"
    assert [round(error["distance"]) for error in test["central_error"]] == [8, 40, 200]
    for error in test["central_error"]:
        assert error["rms_px"] <= error["max_px"]
        assert len(error["px"]) == len(error["theta_deg"])


def test_an_unknown_model_is_rejected_with_the_known_ones(run, shots):
    status, _, err = run("calibrate", shots, "--model", "nonsense")
    assert status == 2
    assert "unknown camera model 'nonsense'" in err
    assert "kannala_brandt" in err
    assert "axial" in err


def test_the_ocamcalib_method_is_for_central_cameras(run, shots):
    status, _, err = run("calibrate", shots, "--model", "axial", "--method", "ocamcalib")
    assert status == 2
    assert "--method ocamcalib" in err


def test_inspect_describes_an_axial_camera(run, rays_file):
    status, out, err = run("inspect", rays_file)
    assert (status, err) == (0, "")
    assert "model       axial" in out
    assert "pupil0            0.006 +- 0.001    m" in out
    assert "rays        non-central: the pixel of a point depends on its distance" in out
    assert "pupil       shifts by 3.48 mm along the axis from 0 to 86 degrees" in out
    assert "radius, px" in out


def test_inspect_describes_a_lens_and_mirror(run, tmp_path):
    om.save(om.RayCamera(Catadioptric.example(), (1280, 960)), tmp_path / "mirror.json")
    status, out, err = run("inspect", tmp_path / "mirror.json")
    assert (status, err) == (0, "")
    assert "mirror_radius" in out
    assert "rays        non-central: the pixel of a point depends on its distance" in out
    status, _, err = run("inspect", tmp_path / "mirror.json", "--svg", tmp_path / "curve.svg")
    assert status == 2
    assert "no r(theta) to draw" in err


def test_convert_and_view_need_a_distance(run, rays_file, tmp_path):
    write_image(tmp_path / "image.png", np.full((962, 960), 90, np.uint8))
    for command in (
        ("convert", rays_file, "--to", "opencv"),
        ("view", tmp_path / "image.png", "--camera", rays_file, "-o", tmp_path / "view.png"),
    ):
        status, _, err = run(*command)
        assert status == 2
        assert "a non-central camera (axial): specify the distance of the scene" in err
        assert "--distance 2m" in err


def test_convert_fits_a_central_camera_to_a_mirror(run, tmp_path):
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


def test_view_accepts_a_distance(run, rays_file, tmp_path):
    write_image(tmp_path / "image.png", np.full((962, 960), 90, np.uint8))
    command = "view", tmp_path / "image.png", "--camera", rays_file, "-o", tmp_path / "view.png"
    assert run(*command, "--distance", "1m", "--size", "64x48")[0] == 0
    assert om.read_image(tmp_path / "view.png").shape[:2] == (48, 64)


@pytest.mark.parametrize(
    ("distance", "message"),
    [("1", "has no unit"), ("-1m", "must be positive"), ("nonsense", "cannot read the length")],
)
def test_an_invalid_distance_is_rejected(run, rays_file, distance, message):
    status, _, err = run("convert", rays_file, "--to", "opencv", f"--distance={distance}")
    assert status == 2
    assert message in err


def test_a_central_camera_needs_no_distance(run, camera_file):
    status, _, err = run("convert", camera_file, "--to", "opencv", "--distance", "1m")
    assert status == 2
    assert "leave it out" in err


def test_distances_in_squares_are_accepted(run, tmp_path):
    om.save(om.RayCamera(Axial.example(), (960, 962), unit="squares", theta_max=1.5), tmp_path / "rays.json")
    status, _, err = run("convert", tmp_path / "rays.json", "--to", "opencv", "--distance", "2m")
    assert status == 2
    assert "20squares" in err
    command = "convert", tmp_path / "rays.json", "--to", "opencv", "--distance", "20squares"
    assert run(*command, "-o", tmp_path / "camera.yml")[0] == 0


def test_view_and_next_select_a_camera_of_a_rig_by_name(run, tmp_path, shots):
    om.save(back_to_back(480), tmp_path / "rig.json")
    write_image(tmp_path / "image.png", np.full((480, 480), 90, np.uint8))
    command = "view", tmp_path / "image.png", "--camera", tmp_path / "rig.json", "-o", tmp_path / "view.png"
    status, _, err = run(*command, "--size", "64x48")
    assert status == 2
    assert "holds 2 cameras: front, back; specify one: --name front" in err
    assert run(*command, "--size", "64x48", "--name", "back")[0] == 0
    status, _, err = run("next", shots, "--camera", tmp_path / "rig.json", "--name", "up")
    assert status == 2
    assert "no camera 'up'; it holds front, back" in err


@pytest.mark.parametrize(
    ("camera", "options", "message"),
    [
        (MIRROR, ("--model", "mei"), "contains its model: leave out --model mei"),
        (
            MIRROR,
            ("--method", "ocamcalib"),
            "--method ocamcalib calibrates central cameras: leave out --model axial and --start",
        ),
        (
            om.Camera(CAMERA.model.lens, SIZE),
            (),
            "a central camera (kannala_brandt), which needs no initial values: leave out --start",
        ),
        (
            MIRROR,
            ("--pattern", "9x6"),
            "lengths are in m, those of the board in squares: specify the side of a square, such as --square 30mm",
        ),
        (om.RayCamera(MIRROR.model, (9, 9)), ("--pattern", "9x6"), "for images of 9x9 px; these are 640x480 px"),
    ],
)
def test_an_unsuitable_start_is_rejected(run, shots, tmp_path, camera, options, message):
    om.save(camera, tmp_path / "start.json")
    status, _, err = run("calibrate", shots, "--start", tmp_path / "start.json", *options)
    assert status == 2
    assert message in err


def test_the_camera_does_not_replace_the_start(refuses, shots, tmp_path):
    design = om.save(MIRROR, tmp_path / "start.json").path
    assert "is one of the inputs" in refuses("calibrate", shots, "--start", design, "-o", design)


def test_a_start_is_refined(run, shots, camera_file, tmp_path):
    central = om.load(camera_file)
    om.save(om.RayCamera(Axial(central.model, (0.0,)), central.size), tmp_path / "start.json")
    command = "calibrate", shots, "--pattern", "9x6", "--square", "30mm", "--start", tmp_path / "start.json"
    status, out, err = run(*command, "-o", tmp_path / "camera.json", "--json")
    assert (status, err) == (0, "")
    result, camera = json.loads(out), om.load(tmp_path / "camera.json")
    assert result["model"] == camera.model.name == "axial"
    assert result["rms"] == camera.calibration["rms"]
    assert result["held_out_rms"] == camera.calibration["held_out_rms"] < 0.5
    assert result["central"]["held_out_rms"] == camera.calibration["central_held_out_rms"]
    squares = [image["corners"] * image["rms"] ** 2 for image in result["images"]]
    assert np.sqrt(sum(squares) / camera.calibration["corners"]) == pytest.approx(result["rms"])
    assert abs(camera.model.pupil[0]) < 0.05


def test_next_rejects_a_non_central_camera(run, rays_file, shots):
    status, _, err = run("next", shots, "--camera", rays_file)
    assert status == 2
    assert "which this command does not support" in err


def test_a_distance_is_for_the_non_central_cameras_of_a_rig(run, refuses, rays_file, tmp_path):
    rays, lens = om.load(rays_file), om.fisheye(64, 180)
    rig = om.Rig((lens, rays), (om.Pose(), om.Pose(np.eye(3), [-0.1, 0, 0])), ("lens", "rays"))
    mixed, out = om.save(rig, tmp_path / "mixed.json").path, tmp_path / "out.json"
    assert run("convert", mixed, "--to", "native", "--distance", "inf", "-o", out)[0] == 0
    assert om.load(out, name="lens").model == lens.model
    assert isinstance(om.load(out, name="rays"), om.Camera)
    lenses = om.save(om.Rig((lens, lens), rig.sensor_from_rig, rig.names), tmp_path / "lenses.json").path
    message = refuses("convert", lenses, "--to", "native", "--distance", "inf", "-o", out)
    assert "lens is central: leave it out" in message
