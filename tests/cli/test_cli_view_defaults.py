"""omnisight view: images of another size than the camera, and the default view of a mirror camera."""

import cv2
import numpy as np
import pytest
from cli_scene import TRUTH

from omnisight.camera import Camera
from omnisight.formats import load, save
from omnisight.images import read_image, write_image


@pytest.fixture
def photo(shots):
    return shots / "1.png"


@pytest.mark.parametrize("size", [(333, 250), (960, 720), (100, 75), (639, 479)])
def test_every_image_of_the_same_aspect_ratio_is_viewed_with_a_scaled_camera(run, photo, camera_file, tmp_path, size):
    write_image(tmp_path / "resized.png", cv2.resize(read_image(photo), size, interpolation=cv2.INTER_AREA))
    options = ("--camera", camera_file, "--size", "80x60", "-o", tmp_path / "v.png")
    status, _, err = run("view", tmp_path / "resized.png", *options)
    assert status == 2
    assert "scale the camera (--scale-camera)" in err
    assert run("view", tmp_path / "resized.png", *options, "--scale-camera")[0] == 0


@pytest.mark.parametrize("size", [(1032, 778), (640, 477)])
def test_an_image_of_another_aspect_ratio_is_rejected_without_the_advice_to_scale(refuses, camera_file, tmp_path, size):
    write_image(tmp_path / "other.png", np.zeros(size[::-1], np.uint8))
    for options in ((), ("--scale-camera",)):
        error = refuses("view", tmp_path / "other.png", "--camera", camera_file, *options, "-o", tmp_path / "v.png")
        assert "a different aspect ratio" in error
        assert "--scale-camera" not in error


def test_images_of_several_sizes_are_viewed_apart(run, folder, camera_file, tmp_path):
    for name, size in (("1.png", (320, 240)), ("2.png", (160, 120))):
        write_image(folder / name, cv2.resize(read_image(folder / name), size, interpolation=cv2.INTER_AREA))
    options = ("--camera", camera_file, "--size", "80x60", "--scale-camera")
    status, _, err = run("view", folder / "1.png", folder / "2.png", *options, "-o", tmp_path / "views")
    assert status == 2
    assert "2.png: 160x120, others 320x240: view it apart" in err


@pytest.mark.parametrize("up", ["back", "front"])
def test_a_mirror_camera_is_viewed_around_its_axis_by_default(run, photo, tmp_path, up):
    mirror = save(
        Camera(TRUTH.model, TRUTH.size, theta_max=np.radians(70), theta_min=np.radians(40)), tmp_path / "m.json"
    )
    view, camera = tmp_path / "v.png", tmp_path / "v.json"
    arguments = ("view", photo, "--camera", mirror.path, "-o", view, "--view-camera", camera, "--size", "400")
    status, out, _ = run(*arguments, *(("--up", "front") if up == "front" else ()))
    assert status == 0
    assert out.startswith("view      cylinder, 400x")
    assert "100% of the view is covered" in out
    assert "warning" not in out  # everything in the view is in the calibrated field of view
    assert ("hint      a mirror camera (it is blind within 40 degrees of its axis)" in out) == (up == "back")
    # The view shows elevations of 40° - 90° to 70° - 90°, upside down if the world's up is in front.
    cylinder = load(camera)
    assert cylinder.model.name == "cylindrical"
    elevations = -np.degrees(np.arcsin(cylinder.unproject([[200.0, -0.5], [200.0, cylinder.height - 0.5]])[0][:, 1]))
    assert elevations == pytest.approx([-20, -50] if up == "back" else [50, 20], abs=0.5)


def test_a_mirror_camera_is_viewed_as_requested(run, photo, tmp_path):
    mirror = save(Camera(TRUTH.model, TRUTH.size, theta_max=1.4, theta_min=0.7), tmp_path / "m.json").path
    out = run(
        "view", photo, "--camera", mirror, "--to", "fisheye", "--up", "top", "--size", "80x80", "-o", tmp_path / "v.png"
    )[1]
    assert out.startswith("view      fisheye, 80x80")
    assert "hint" not in out
    assert run("view", photo, "--camera", mirror, "--fov", "60", "-o", tmp_path / "v.png")[1].startswith(
        "view      persp"
    )
