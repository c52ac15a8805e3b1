"""Commands with workers write the bytes that they write without."""

import json

import numpy as np
import pytest

from omnisight.camera import Camera
from omnisight.formats import save
from omnisight.images import write_image
from omnisight.models import model_class
from omnisight.pipeline.inputs.camera_sources import CameraSources
from omnisight.pipeline.inputs.image_set import image_set
from omnisight.pipeline.inputs.work_folder import WorkFolder
from omnisight.pipeline.reconstruction.detected_images import detect_images
from omnisight.pipeline.reconstruction.reconstruct import reconstruct
from omnisight.pipeline.reconstruction.reconstruct_options import ReconstructOptions
from omnisight.reconstructions import write_reconstruction
from omnisight.simulation import Renderer, fisheye_setup
from omnisight.simulation.example_rigs import back_to_back
from prints import CHARUCO, render
from prints import pose as hold
from reconstructing import independent, paint


def files(folder):
    """Return the bytes of all files of a command by name."""
    found = [file for file in folder.rglob("*") if file.is_file() and ".omnisight" not in file.parts]
    assert found
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in found}


def test_detect_finds_the_same_corners_and_keeps_them_for_the_next_run(run, tmp_path):
    setup = fisheye_setup(320)
    (tmp_path / "images").mkdir()
    for i, board in enumerate(setup.boards(3)):
        write_image(tmp_path / "images" / f"{i}.png", setup.renderer()([board], np.random.default_rng(i)).image)
    (tmp_path / "images" / "10.png").write_bytes(b"no image")  # after 2 in natural order, before it by letters
    _, plain, _ = run("detect", tmp_path / "images", "--json")
    assert sum(len(image["boards"]) for image in json.loads(plain)["images"]) == 3
    command = "detect", tmp_path / "images", "--workers", 1, "-o", tmp_path / "out"
    status, out, err = run(*command)
    assert (tmp_path / "out" / "corners.json").read_text() == plain
    assert status == 2
    assert "10.png: not an image" in out
    assert "1 of 4 images have no result" in err
    again = "detect", tmp_path / "images", "--cluster", "tcp://127.0.0.1:9", "-o", tmp_path / "out"
    assert run(*again, "--json")[1] == plain  # without a connection, because everything is finished


def test_detect_recognizes_a_board_with_markers(run, tmp_path):
    (tmp_path / "images").mkdir()
    for i, (angle, azimuth) in enumerate([(0, 0), (30, 70), (45, 180)]):
        placed = hold(CHARUCO, angle, azimuth=azimuth, distance=0.18, roll=40 * i)
        write_image(tmp_path / "images" / f"{i}.png", render(CHARUCO, "fisheye", placed, seed=i)[0])
    _, plain, _ = run("detect", tmp_path / "images", "--json")
    assert json.loads(plain)["assumption"]
    assert run("detect", tmp_path / "images", "--workers", 1, "-o", tmp_path / "out")[0] == 0
    assert (tmp_path / "out" / "corners.json").read_text() == plain


@pytest.mark.parametrize("every", [0, 2])
def test_stitch_writes_the_same_spheres(run, tmp_path, every):
    rig = back_to_back(240, 0.03)
    for k, camera in enumerate(rig.cameras):
        (tmp_path / rig.names[k]).mkdir()
        image = Renderer(camera, rig.sensor_from_rig[k].inverse(), theta=(0.0, camera.theta_max), samples=1)().image
        for i in range(4):
            write_image(tmp_path / rig.names[k] / f"{i}.png", np.clip(image * (0.7 + 0.1 * i), 0, 255).astype(np.uint8))
    save(rig, tmp_path / "rig.json")
    command = ["stitch", *(tmp_path / name for name in rig.names), "--rig", tmp_path / "rig.json"]
    command += ["--width", 256, "--at", "inf", "--every", every]
    assert run(*command, "-o", tmp_path / "plain")[0] == 0
    status, out, err = run(*command, "-o", tmp_path / "out", "--workers", 1, "--shard-size", 3)
    assert status == 0, err
    assert "4 written, 0 failed" in out
    assert files(tmp_path / "out") == files(tmp_path / "plain")
    assert sorted(files(tmp_path / "out")) == [f"{i}.jpg" for i in range(4)]


def test_export_writes_the_same_views_masks_and_model(run, tmp_path):
    made = independent()
    paint(made, tmp_path / "images")
    write_reconstruction(tmp_path / "model", made)
    command = ["export", tmp_path / "model", "--to", "splat", "--images", tmp_path / "images", "--size", "64x64"]
    assert run(*command, "-o", tmp_path / "plain")[0] == 0
    status, _, err = run(*command, "-o", tmp_path / "out", "--workers", 1, "--shard-size", 4)
    assert status == 0, err
    written = files(tmp_path / "out")
    assert written == files(tmp_path / "plain")
    assert {name.split("/")[0] for name in written} == {"images", "masks", "sparse"}
    next((tmp_path / "images").rglob("*.*g")).unlink()
    status, _, err = run(*command, "-o", tmp_path / "other", "--workers", 1)
    assert status == 2
    assert "1 of 6 images are not in" in err


def test_keypoints_of_a_reconstruction_are_the_same(tmp_path):
    rng = np.random.default_rng(0)
    model = model_class("equidistant")(60.0, 60.0, 79.5, 79.5)
    (tmp_path / "images").mkdir()
    for i in range(3):
        coarse = rng.integers(0, 256, (40, 40, 3)).astype(np.uint8)
        write_image(tmp_path / "images" / f"{i}.png", np.kron(coarse, np.ones((4, 4, 1), np.uint8)))
    sources = CameraSources.of(Camera(model, (160, 160), theta_max=1.3), None, None)
    found = image_set(tmp_path / "images")
    expected, detected = (
        detect_images(found, sources, options, lambda *_: None, WorkFolder(tmp_path / "work"))
        for options in (ReconstructOptions(), ReconstructOptions(workers=1, shard_size=2))
    )
    assert [len(each) > 20 for each in expected.keypoints] == [True] * 3
    for ours, theirs in zip(detected.keypoints, expected.keypoints, strict=True):
        assert all(np.array_equal(getattr(ours, name), getattr(theirs, name)) for name in vars(theirs))
    assert all(map(np.array_equal, detected.colors, expected.colors))
    assert len(list((tmp_path / "work" / "batch").glob("*.npz"))) == 3
    WorkFolder(tmp_path / "work").remove()
    assert not (tmp_path / "work").exists()
    with pytest.raises(ValueError, match="workers need a folder"):
        reconstruct(tmp_path / "images", sources.sources[0], options=ReconstructOptions(workers=1))
    write_image(tmp_path / "images" / "3.png", np.zeros((20, 30), np.uint8))
    by_workers = sources, ReconstructOptions(workers=1), lambda *_: None, WorkFolder(tmp_path / "work")
    with pytest.raises(ValueError, match=r"1 of 4 images cannot be used.*3.png: is 30x20 px.*same command continues"):
        detect_images(image_set(tmp_path / "images"), *by_workers)
    (tmp_path / "images" / "3.png").write_bytes((tmp_path / "images" / "0.png").read_bytes())
    last = detect_images(image_set(tmp_path / "images"), *by_workers).keypoints[-1]
    assert np.array_equal(last.pixels, expected.keypoints[0].pixels)
