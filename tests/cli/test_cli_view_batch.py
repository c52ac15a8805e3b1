"""omnisight view with workers."""

import json

import numpy as np
import pytest

from omnisight.camera import Camera
from omnisight.formats import save
from omnisight.images import write_image
from omnisight.models import model_class


@pytest.fixture
def images(tmp_path):
    camera = Camera(model_class("equidistant")(60.0, 60.0, 63.5, 47.5), (128, 96), theta_max=1.4)
    save(camera, tmp_path / "fisheye.json")
    folder = tmp_path / "images"
    folder.mkdir()
    for i in range(5):
        write_image(folder / f"{i}.png", np.full((96, 128), 40 * i, np.uint8))
    return folder


def test_views_are_counted_and_written(run, images, tmp_path):
    command = ("view", images, "--camera", tmp_path / "fisheye.json", "--workers", "1", "-o", tmp_path / "views")
    status, out, err = run(*command)
    assert (status, err) == (0, "")
    assert "images    5; 5 written, 0 failed" in out
    assert len(list((tmp_path / "views").glob("*.png"))) == 5
    result = json.loads(run(*command, "--json")[1])
    assert (result["images"], result["resumed"], result["failed"]) == (5, 5, [])


def test_an_unreadable_image_is_listed_and_the_status_is_2(run, images, tmp_path):
    (images / "bad.png").write_bytes(b"nothing")
    command = ("view", images, "--camera", tmp_path / "fisheye.json", "--workers", "1", "-o", tmp_path / "views")
    status, out, err = run(*command)
    assert status == 2
    assert "images    6; 5 written, 1 failed" in out
    assert "bad.png: not an image" in out
    assert "1 of 6 images" in err


def test_another_camera_is_refused(refuses, run, images, tmp_path):
    command = ("view", images, "--workers", "1", "-o", tmp_path / "views", "--camera")
    assert run(*command, tmp_path / "fisheye.json")[0] == 0
    other = Camera(model_class("equidistant")(61.0, 60.0, 63.5, 47.5), (128, 96), theta_max=1.4)
    save(other, tmp_path / "other.json")
    assert "holds a run with another camera" in refuses(*command, tmp_path / "other.json")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--workers", "0"), "--workers must be 1 or more"),
        (("--cluster", "here"), "--cluster must be local or the address of a Dask scheduler"),
        (("--workers", "2", "--mask", "m.png"), "apply to one view of one folder or pattern of images"),
        (("--workers", "2", "--scale-camera"), "--scale-camera applies to images of one size"),
    ],
)
def test_unusable_options_are_reported(run, images, tmp_path, options, message):
    command = ("view", images, "--camera", tmp_path / "fisheye.json", "-o", tmp_path / "views", *options)
    status, out, err = run(*command)
    assert status == 2
    assert message in " ".join((out + err).replace("│", " ").split())
