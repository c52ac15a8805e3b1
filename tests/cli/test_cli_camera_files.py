"""omnisight inspect and convert, and damaged camera and image files."""

import json

import cv2
import numpy as np
import pytest
from cli_scene import FOCAL, QUICK, SIZE, TRUTH, file_names

from jpegs import jpeg
from omnisight.camera import Camera
from omnisight.formats import load, save
from omnisight.geometry.pose import Pose
from omnisight.images import read_image
from omnisight.models import model_class, model_names
from omnisight.rig import Rig
from omnisight.views import perspective


def test_inspect_prints_model_size_field_focal_length_and_conventions(run, camera_file):
    status, out, err = run("inspect", camera_file)
    assert (status, err) == (0, "")
    for message in (
        *("model       equidistant: ", "size        640 x 480 px", "focal       190.00 px per radian"),
        *("centre      (322.30, 236.80), +2.8, -2.7 px", "calibrated  to 80.2 degrees", "x right, y down, z forward"),
        *(
            "193.0 deg horizontal",
            "144.7 deg vertical",
            "extrapolated beyond 160.4 deg",
            "radius, px  (* calibrated, . extrapolated, - equidistant)",
        ),
    ):
        assert message in out
    assert "nan" not in out


@pytest.mark.parametrize("model", model_names())
def test_inspect_describes_every_model(run, tmp_path, model):
    camera = Camera(model_class(model).example(), (1024, 768), theta_max=0.7)
    path = save(camera, tmp_path / "c.json").path
    status, out, err = run("inspect", path, "--svg", tmp_path / "curve.svg")
    assert (status, err) == (0, "")
    assert f"model       {model}: " in out
    assert (tmp_path / "curve.svg").read_text().startswith("<svg")


def test_the_drawing_of_inspect_replaces_no_input(refuses, camera_file, tmp_path):
    assert "is one of the inputs" in refuses("inspect", camera_file, "--svg", camera_file)
    assert "there is no folder" in refuses("inspect", camera_file, "--svg", tmp_path / "none" / "curve.svg")


def test_inspect_reports_no_image_centre_without_an_image_size(run, tmp_path):
    status, out, err = run("inspect", save(Camera(TRUTH.model, (0, 0)), tmp_path / "c.json").path)
    assert (status, err) == (0, "")
    assert "size        not in the file" in out
    assert "centre      (322.30, 236.80)\n" in out


def test_the_blind_spot_of_a_mirror_is_drawn_as_extrapolated(run, tmp_path):
    camera = Camera(TRUTH.model, SIZE, theta_min=np.radians(30), theta_max=np.radians(70))
    status, out, err = run("inspect", save(camera, tmp_path / "c.json").path)
    assert (status, err) == (0, "")
    assert "calibrated  from 30.0 to 70.0 degrees" in out
    rows = [line.split("|")[1] for line in out.splitlines() if " |" in line]
    drawn = "".join(next((c for c in column if c in "*."), " ") for column in zip(*rows, strict=True))
    end = float(out.splitlines()[-1].split()[-1])
    columns = np.array([30, 70]) / end * len(drawn)
    assert [drawn.index("*"), drawn.rindex("*")] == pytest.approx(columns, abs=1)


def test_a_camera_whose_axis_is_outside_of_the_image_has_no_drawing(run, tmp_path):
    camera = Camera(model_class("equidistant")(FOCAL, FOCAL, -50.0, 236.8), SIZE, theta_max=1.4)
    status, out, err = run("inspect", save(camera, tmp_path / "c.json").path, "--svg", tmp_path / "curve.svg")
    assert status == 2
    assert "r(theta): not drawn, the optical axis is outside of the image" in out
    assert "the optical axis is outside of the image: there is no r(theta) to draw" in err


def test_inspect_json_is_the_camera(run, camera_file):
    status, out, _ = run("inspect", camera_file, "--json")
    assert status == 0
    stored = json.loads(out)
    assert stored["camera"]["params"] == TRUTH.model.to_dict()
    assert stored["camera"]["size"] == [640, 480]


def test_inspect_lists_camera_names(refuses, camera_file):
    message = refuses("inspect", camera_file, "--name", "left")
    assert f"{camera_file}: no camera 'left'; it holds camera" in message


def test_inspect_prints_standard_deviations(run, shots, tmp_path):
    run("calibrate", shots, *QUICK, "-o", tmp_path / "c.json")
    out = run("inspect", tmp_path / "c.json")[1]
    focal = next(line for line in out.splitlines() if line.strip().startswith("fx"))
    value, sigma = float(focal.split()[1]), float(focal.split()[3])
    assert abs(value - FOCAL) < 4 * sigma + 0.2
    assert "held_out_rms" in out
    assert "pattern: 9x6" in out


def test_convert_prints_error(run, camera_file, tmp_path):
    out = tmp_path / "c.json"
    status, message, err = run("convert", camera_file, "--to", "native", "--model", "double_sphere", "-o", out)
    assert (status, err) == (0, "")
    assert "model       equidistant -> double_sphere" in message
    assert "fitted      up to 80.2 degrees" in message
    error = float(message.split("error       at most ")[1].split()[0])
    assert error < 1
    assert f"written     {out}" in message
    converted = load(out)
    bearings, pixels = TRUTH.samples()
    assert np.linalg.norm(converted.project(bearings)[0] - pixels, axis=1).max() == pytest.approx(error, rel=0.01)
    assert converted.provenance["converted_from"] == "equidistant"


def test_convert_replaces_no_input(refuses, camera_file):
    options = "--to", "native", "--model", "kannala_brandt", "-o", camera_file
    assert "is one of the inputs" in refuses("convert", camera_file, *options)


def test_convert_above_max_error_writes_nothing(run, refuses, camera_file, tmp_path):
    out = tmp_path / "c.json"
    arguments = ("convert", camera_file, "--to", "native", "--model", "division", "-o", out)
    status, message, err = run(*arguments, "--max-error", "1e-6")
    assert status == 2
    assert "agreement   within 0.5 px up to" in message
    assert err.startswith("omnisight: division cannot represent this equidistant camera to 80 degrees: ")
    assert "1e-06 allowed. Nothing was written; try --model" in err
    assert "--force" in err
    assert file_names(tmp_path) == ["camera.json"]
    assert run(*arguments, "--max-error", "1e-6", "--force")[0] == 0
    assert load(out).model.name == "division"


def test_convert_over_smaller_field_of_view_is_more_accurate(run, camera_file, tmp_path):
    errors = []
    for options in ((), ("--max-theta", "40")):
        message = run(
            *("convert", camera_file, "--to", "native", "--model", "division", "--force"),
            *("-o", tmp_path / "c.json", *options),
        )[1]
        errors.append(float(message.split("at most ")[1].split()[0]))
    assert errors[1] < errors[0] / 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--to", "nonsense"), "unknown format 'nonsense'; there are:"),
        (("--to", "mei"), "mei is a camera model, not a format: --to native --model mei"),
        (("--to", "native", "--model", "nonsense"), "unknown camera model 'nonsense'; there are: cassini"),
        (("--to", "native", "--name", "left"), "no camera 'left'; it holds camera"),
        (("--to", "native", "--model", "mei", "--max-theta", "0.1"), "almost no pixel of the camera"),
        (("--to", "native", "--max-theta", "40"), "--max-theta 40: limits the fit of another model"),
    ],
)
def test_impossible_conversion_is_rejected(refuses, camera_file, tmp_path, options, message):
    assert message in refuses("convert", camera_file, "-o", tmp_path / "c.json", *options)
    assert file_names(tmp_path) == ["camera.json"]


def test_camera_without_size_cannot_be_converted(refuses, tmp_path):
    path = save(Camera(TRUTH.model, (0, 0)), tmp_path / "c.json").path
    message = refuses("convert", path, "--to", "native", "--model", "mei", "-o", tmp_path / "d.json")
    assert "image size is not known" in message


def test_convert_writes_beside_the_input(run, camera_file):
    status, message, _ = run("convert", camera_file, "--to", "native")
    assert status == 0
    assert "model       equidistant, unchanged" in message
    assert load(camera_file.with_name("camera-native.json")).model == TRUTH.model


def damaged(data, rng):
    """Cut, swap, repeat or change bytes of a file."""
    data = bytearray(data)
    start, stop = sorted(rng.integers(0, len(data), 2))
    match rng.integers(5):
        case 0:
            del data[start:]
        case 1:
            del data[start:stop]
        case 2:
            data[start : start + 3] = rng.integers(0, 256, 3, np.uint8).tobytes()
        case 3:
            data[start:start] = data[start:stop]
        case 4:
            digits = [i for i, b in enumerate(data) if chr(b).isdigit()]
            data[digits[rng.integers(len(digits))]] = b'-e.n9[{"'[rng.integers(8)]
    return bytes(data)


@pytest.mark.parametrize("model", ["ocam", "double_sphere"])
def test_damaged_camera_file_is_not_a_crash(run, tmp_path, model):
    path = tmp_path / "camera.json"
    whole = save(Camera(model_class(model).example(), SIZE, theta_max=1.2), path).path.read_bytes()
    rng = np.random.default_rng(0)
    statuses = []
    for i in range(120):
        path.write_bytes(damaged(whole, rng))
        status, _, err = run("inspect", path)
        assert status in (0, 2), f"{i}: {err} {path.read_bytes()}"
        assert err.startswith(f"omnisight: {path}: ") is (status == 2)
        statuses.append(status)
    assert {0, 2} == set(statuses)


def test_damaged_image_is_not_a_crash(run, shots, camera_file, tmp_path):
    good = read_image(shots / "1.png")[::4, ::4]
    files = [jpeg(good), *(cv2.imencode(e, good)[1].tobytes() for e in (".png", ".tif", ".bmp", ".webp", ".pgm"))]
    options = ("--scale-camera", "--size", "64x48", "-o", tmp_path / "v.png")
    rng = np.random.default_rng(0)
    for i in range(90):
        path = tmp_path / f"{i}.png"
        path.write_bytes(damaged(files[i % len(files)] + b"0", rng))
        status, _, err = run("view", path, "--camera", camera_file, *options)
        assert status in (0, 2), f"{i}: {err}"
        assert err.startswith("omnisight: ") is (status == 2)


def test_a_camera_file_is_not_replaced_by_what_is_made_from_it(refuses, camera_file, tmp_path):
    before = camera_file.read_bytes()
    assert "is one of the inputs" in refuses("convert", camera_file, "--to", "native", "-o", camera_file)
    rig = save(Rig.from_sensors({name: (TRUTH, Pose()) for name in "ab"}), tmp_path / "rig.json").path
    assert "is one of the inputs" in refuses("convert", rig, "--to", "native", "-o", rig)
    storage = save(perspective(64, 90), tmp_path / "camera.yml", format="opencv").path
    assert "is one of the inputs" in refuses("export", storage, "--to", "opencv-map", "-o", storage)
    assert camera_file.read_bytes() == before
