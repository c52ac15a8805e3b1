"""Inputs of omnisight reconstruct, map and localize that are not as expected, on images of a room."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import omnisight as om
from omnisight.geometry.rotation import exp
from omnisight.images.video_writer import VideoWriter
from omnisight.pipeline.inputs.camera_sources import CameraSources
from omnisight.pipeline.inputs.image_set import image_set
from omnisight.pipeline.reconstruction.known_positions import read_positions
from omnisight.rig import Rig
from omnisight.simulation import Renderer, scene_named

SPHERE = om.sphere(480)
POSES = [om.Pose(exp([0, 0.4 * k, 0]), np.array([0.3 * np.sin(1.1 * k), 0.0, 0.25 * k - 0.4])) for k in range(3)]


@pytest.fixture(scope="module")
def rendered():
    """Return images of a room."""
    return [Renderer(SPHERE, pose, scene_named("room"), samples=1)().image for pose in POSES]


@pytest.fixture
def images(rendered, tmp_path):
    """Return a folder of images."""
    folder = tmp_path / "images"
    folder.mkdir()
    for k, image in enumerate(rendered):
        om.write_image(folder / f"{k}.png", image)
    return folder


def truncate(image):
    """Write the beginning of an image to a file before it and to one after it."""
    for name in ("+.png", "b.png"):
        image.with_name(name).write_bytes(image.read_bytes()[:3000])


@pytest.mark.parametrize("workers", [(), ("--workers", 1)])
def test_an_unreadable_image_is_left_out_of_a_reconstruction(run, images, workers):
    truncate(images / "0.png")
    output = images.parent / "model"
    status, out, err = run("reconstruct", images, "-o", output, "--json", *workers)
    assert status == 0, err
    found = json.loads(out)
    assert found["images"] == 5
    reasons = {name: why for name, why in found["unregistered"].items() if name in ("+.png", "b.png")}
    assert sorted(reasons) == ["+.png", "b.png"]
    assert all(re.match(r"(truncated|damaged) PNG", why) for why in reasons.values())
    assert (
        f"omnisight: warning: 2 of 5 images cannot be used and are left out, the first is +.png: {reasons['+.png']}"
        in err
    )
    assert found["registered"] == 3


def test_one_readable_image_shows_no_motion(run, images):
    truncate(images / "0.png")
    for name in ("0.png", "1.png"):
        (images / name).unlink()
    status, out, _ = run("reconstruct", images, "-o", images.parent / "model", "--json")
    assert status == 2
    assert json.loads(out)["reason"].startswith("one image shows no motion")


def test_unreadable_images_only_are_an_error(refuses, images):
    visual_map, _ = om.build_map(images)
    om.write_map(images.parent / "map", visual_map)
    for path in images.iterdir():
        path.write_bytes(b"")
    assert "0.png: empty file" in refuses("reconstruct", images, "-o", images.parent / "model")
    assert "0.png: empty file" in refuses("localize", images, "--map", images.parent / "map")


def test_an_unreadable_image_is_left_out_of_a_map_and_reported_by_localize(run, images, tmp_path):
    truncate(images / "0.png")
    status, _, err = run("map", images, "-o", tmp_path / "map")
    assert status == 0, err
    assert "2 of 5 images cannot be used" in err
    localize = "localize", images, "--map", tmp_path / "map", "-o", tmp_path / "poses.csv"
    status, out, err = run(*localize, "--json")
    assert status == 0, err
    found = {image["name"]: image for image in json.loads(out)["images"]}
    assert [name for name, image in found.items() if image["localized"]] == ["0.png", "1.png", "2.png"]
    assert re.match(r"(truncated|damaged) PNG", found["b.png"]["reason"])
    assert "omnisight: warning: 2 of 5 images cannot be used and are left out, the first is +.png: " in err
    assert [line.split(",")[0] for line in (tmp_path / "poses.csv").read_text().splitlines()[1:]] == [
        "0.png",
        "1.png",
        "2.png",
    ]


@pytest.mark.parametrize("command", ["odometry", "reconstruct", "map"])
def test_a_file_of_another_kind_is_refused_with_the_formats_of_clips(refuses, tmp_path, command):
    (tmp_path / "clip.h264").write_bytes(b"\0\0\0\1")
    error = refuses(command, tmp_path / "clip.h264", "-o", tmp_path / "out")
    assert "clip.h264: neither a video clip (mp4 mov " in error
    assert "nor an image (jpg jpeg " in error
    assert f"ffmpeg -i {tmp_path / 'clip.h264'} " in error


@pytest.mark.parametrize(
    ("arguments", "table", "message"),
    [
        (
            ("--positions", "gps.csv"),
            "0.png,47,8,4\n1.png,147,8,4",
            "gps.csv, line 3: the latitude 147 is not from -90 to 90",
        ),
        (
            ("--positions", "gps.csv"),
            "0.png,47,-181,4",
            "gps.csv, line 2: the longitude -181 is not from -180 to 360 degrees",
        ),
        (("--scale", "0.png", "0", "3m"), "", "--scale 0.png 0 3m: specify two different images"),
    ],
)
def test_impossible_measurements_are_refused(refuses, images, monkeypatch, arguments, table, message):
    monkeypatch.chdir(images.parent)
    (images.parent / "gps.csv").write_text(f"name,latitude,longitude,altitude\n{table}\n")
    assert message in refuses("reconstruct", images, *arguments, "-o", "model")


def test_rows_without_a_number_are_reported(images):
    files = image_set(images)
    table = images.parent / "gps.csv"
    table.write_text("name,x,y,z\n0.png,1,2,3\n1.png,nan,2,3\n2.png,1,2\nother.png,,,\n")
    found = read_positions(table, files)
    assert np.isfinite(found.positions).all(axis=1).tolist() == [True, False, False]
    reason = "not used: without a finite number for each of x, y, z"
    assert found.warnings == (
        f"{table}: line 5 is not used: there is no image 'other.png'; the first image is '0.png'",
        f"{table}: 2 lines of images, the first is 3, are {reason}",
    )
    table.write_text("name,lat,lon,alt\n0.png,47,8,\n1.png,47,8.0001,\n2.png,,8,\n")
    found = read_positions(table, files)
    assert np.isfinite(found.positions).all(axis=1).tolist() == [True, True, False]
    assert found.warnings[0].startswith(f"{table}: line 4 is not used: ")


def test_rows_of_unknown_images_are_reported(refuses, images):
    files, table = image_set(images), images.parent / "positions.csv"
    table.write_text("name,x,y,z\nDSC1.JPG,0,0,0\n0.png,1,2,3\n\nDSC2.JPG,0,0,0\n")
    found = read_positions(table, files)
    unknown = "2 lines, the first is 2, are not used: there is no image 'DSC1.JPG'; the first image is '0.png'"
    assert found.warnings == (f"{table}: {unknown}",)
    table.write_text("name,x,y,z\nDSC1.JPG,0,0,0\nDSC2.JPG,0,0,0\n")
    output = refuses("reconstruct", images, "--positions", table, "-o", images.parent / "model")
    assert f"none of the 3 images has a valid position in {table}. {table}: {unknown}" in output


def test_the_first_complete_row_of_an_image_is_used_and_repeated_rows_are_reported(images):
    files, table = image_set(images), images.parent / "positions.csv"
    table.write_text("name,x,y,z\n0.png,,,\n0.png,1,2,3\n0.png,,,\n0.png,7,8,9\n1.png,4,5,6\n1.png,,,\n2.png,0,0,0\n")
    found = read_positions(table, files)
    assert found.positions.tolist() == [[1, 2, 3], [4, 5, 6], [0, 0, 0]]
    assert found.warnings == (
        f"{table}: 2 images, the first is 0.png, have several lines: the first complete one is used, of 0.png line 3",
    )


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_cells_may_be_separated_as_spreadsheets_do_where_the_comma_separates_decimals(images, delimiter):
    table = images.parent / "positions.csv"
    rows = ("name", "x", "y", "z"), ("0.png", "1,5", "-2", "3.25"), ("1.png", "1", "0", "0,5")
    table.write_text("\n".join(delimiter.join(row) for row in rows))
    found = read_positions(table, image_set(images))
    np.testing.assert_array_equal(found.positions, [[1.5, -2, 3.25], [1, 0, 0.5], [np.nan] * 3])
    assert not found.warnings


def test_a_row_of_two_images_of_one_name_is_refused(images):
    for camera in ("back", "front"):
        (images / camera).mkdir()
        om.write_image(images / camera / "0.png", np.zeros((10, 20), np.uint8))
    for image in images.glob("*.png"):
        image.unlink()
    files, table = image_set(images), images.parent / "positions.csv"
    table.write_text("name, x, y, z\n back/0.png , 1, 2, 3\n")
    found = read_positions(table, files).positions[files.names.index("back/0.png")]
    assert found.tolist() == [1.0, 2.0, 3.0]
    table.write_text("name,x,y,z\n0.png,1,2,3\n")
    with pytest.raises(ValueError, match=r"positions.csv, line 2: 0.png: 2 images have this name"):
        read_positions(table, files)


def test_a_folder_of_masks_has_one_for_the_camera(refuses, images):
    masks = images.parent / "masks"
    masks.mkdir()
    command = "reconstruct", images, "--mask", masks, "-o", images.parent / "model"
    assert "masks: contains 0 files: specify the file" in refuses(*command)
    om.write_image(masks / "robot.png", np.zeros((10, 20), np.uint8))
    assert "robot.png" in refuses(*command)


def test_frames_of_a_clip_are_chosen_by_time_and_not_written_again(tmp_path):
    texture = np.random.default_rng(0).integers(0, 255, (64, 96, 3), np.uint8)
    times = [*(k / 30 for k in range(30)), *(1 + k / 10 for k in range(10))]
    with VideoWriter(tmp_path / "clip.mp4", (96, 64), 30.0, om.VideoOptions(crf=10)) as writer:
        for seconds in times:
            writer.write(texture, seconds)
    files = om.extract_frames(tmp_path / "clip.mp4", tmp_path / "frames", 2.0)
    assert [int(times[int(file.stem[-6:])] * 2) for file in files] == [0, 1, 2, 3]
    before = [file.stat().st_mtime_ns for file in files]
    assert om.extract_frames(tmp_path / "clip.mp4", tmp_path / "frames", 2.0) == files
    assert [file.stat().st_mtime_ns for file in files] == before


@pytest.mark.parametrize("command", ["reconstruct", "map"])
def test_a_rig_in_squares_is_refused(refuses, images, command):
    for k, name in enumerate("abc"):
        (images / f"{k}.png").rename(images / f"{name}_1.png")
    sensors = {name: (SPHERE, om.Pose(np.eye(3), [-3 * k, 0, 0])) for k, name in enumerate("abc")}
    om.save(replace(Rig.from_sensors(sensors), unit="squares"), images.parent / "rig.json")
    output = refuses(command, images, "--rig", images.parent / "rig.json", "-o", images.parent / "out")
    assert "the lengths of the rig are in squares, not metres" in output


def test_the_name_of_a_camera_is_refused_with_a_rig(refuses, images):
    rig = om.save(Rig.from_sensors({"a": (SPHERE, om.Pose())}), images.parent / "rig.json").path
    output = refuses("reconstruct", images, "--rig", rig, "--name", "a", "-o", images.parent / "out")
    assert "--name a: names a camera in a file of several, and a rig is used whole" in output


def test_a_file_of_several_cameras_has_those_of_all_names(tmp_path):
    cameras = {name: om.Camera(om.fisheye(256, fov).model, (256, 256)) for name, fov in (("left", 180), ("right", 190))}
    om.save(Rig.from_sensors({name: (camera, om.Pose()) for name, camera in cameras.items()}), tmp_path / "rig.json")
    found = CameraSources.of({"right": tmp_path / "rig.json", "left": tmp_path / "rig.json"}, None, None)
    assert [camera.model for camera in found.sources] == [cameras["right"].model, cameras["left"].model]
    with pytest.raises(ValueError, match=r"rig\.json: no camera 'front'.* it holds left, right"):
        CameraSources.of({"front": tmp_path / "rig.json", "left": tmp_path / "rig.json"}, None, None)


@pytest.mark.parametrize("command", ["reconstruct", "map"])
@pytest.mark.parametrize("name", ["points.ply", "1/poses.csv", "colmap/cameras.txt"])
def test_files_that_are_not_of_a_reconstruction_are_not_replaced(refuses, images, tmp_path, command, name):
    file = tmp_path / "model" / name
    file.parent.mkdir(parents=True)
    file.write_text("a scan")
    error = refuses(command, images, "-o", tmp_path / "model")
    assert f"{file}: would be replaced, and the folder has no reconstruction.npz" in error
    assert file.read_text() == "a scan"
    assert [path for path in (tmp_path / "model").rglob("*") if path.is_file()] == [file]


@pytest.mark.parametrize("is_interrupted", [False, True])
def test_files_of_an_earlier_reconstruction_are_replaced_and_others_kept(run, images, tmp_path, is_interrupted):
    model = tmp_path / "model"
    model.mkdir()
    (model / "notes.txt").write_text("of the room")
    assert run("reconstruct", images, "-o", model)[0] == 0
    (model / "points.ply").write_text("damaged")
    if is_interrupted:  # before the last file was written
        (model / "reconstruction.npz").unlink()
        (model / "work").mkdir()
    assert run("reconstruct", images, "-o", model)[0] == 0
    assert (model / "points.ply").read_bytes().startswith(b"ply\n")
    assert (model / "notes.txt").read_text() == "of the room"


def test_a_file_in_place_of_the_output_folder_is_refused(refuses, images, tmp_path):
    (tmp_path / "model").touch()
    for command in ("reconstruct", "map"):
        assert "model: is a file; choose a folder" in refuses(command, images, "-o", tmp_path / "model")
