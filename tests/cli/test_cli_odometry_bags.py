"""omnisight odometry of ROS bags, against the folder of the same images; its trajectories read by evo."""

import json

import numpy as np
import pytest

import omnisight as om
from walks import render_walk

FRAMES, FIRST_S = 8, 1700000000.0


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Return the folder of a rendered sequence."""
    return render_walk(tmp_path_factory.mktemp("walk") / "room", FRAMES, 320)


def table(path):
    return np.loadtxt(path, ndmin=2)


@pytest.mark.parametrize("name", ["drive.bag", "drive"])
def test_a_bag_has_the_trajectory_of_the_folder(run, room, tmp_path, name):
    pytest.importorskip("rosbags")
    from tests.bags import compressed, raw, write_bag

    files = sorted((room / "images").iterdir())
    messages = [raw(om.read_image(file), "rgb8", FIRST_S + k / 10) for k, file in enumerate(files)]
    jpegs = [compressed(file.read_bytes(), FIRST_S + k / 10) for k, file in enumerate(files)]
    gray = [raw(om.images.to_gray8(om.read_image(file)), "mono8", FIRST_S + k / 10) for k, file in enumerate(files)]
    topics = {"/cam0/image_raw": messages, "/cam1/image_raw/compressed": jpegs, "/cam2/image_mono": gray}
    bag = write_bag(tmp_path / name, topics)
    camera = ("--camera", room / "camera.json")
    assert run("odometry", room / "images", *camera, "-o", "folder.tum")[0] == 0
    status, out, err = run("odometry", bag, *camera, "-o", "raw.tum", "--topic", "/cam0/image_raw")
    assert (status, err) == (0, "")
    assert f"{FRAMES} of {FRAMES} have a pose" in out
    assert run("odometry", bag, *camera, "-o", "jpeg.tum", "--topic", "/cam1/image_raw/compressed")[0] == 0
    assert run("odometry", bag, *camera, "-o", "gray.tum", "--topic", "/cam2/image_mono")[0] == 0
    expected = table("folder.tum")
    for found in (table("raw.tum"), table("jpeg.tum"), table("gray.tum")):
        assert np.allclose(found[:, 0], FIRST_S + expected[:, 0], atol=2e-6, rtol=0)
        assert np.allclose(found[:, 1:], expected[:, 1:], atol=1e-6)

    status, _, err = run("odometry", bag, *camera, "-o", "t.tum")
    assert status == 2
    assert f"/cam0/image_raw ({FRAMES} images), /cam1/image_raw/compressed ({FRAMES} images)" in err
    assert "leave out --fps" in run("odometry", bag, *camera, "-o", "t.tum", "--fps", "5")[2]
    assert "leave out --topic" in run("odometry", room / "images", *camera, "-o", "t.tum", "--topic", "/a")[2]


@pytest.mark.peer
def test_evo_reads_the_trajectories(run, room):
    file_interface = pytest.importorskip("evo.tools.file_interface")
    for name in ("t.tum", "t.kitti"):
        assert run("odometry", room / "images", "--camera", room / "camera.json", "-o", name)[0] == 0
    expected = table("t.tum")
    of_tum = file_interface.read_tum_trajectory_file("t.tum")
    assert of_tum.check()[0]
    assert np.allclose(of_tum.timestamps, expected[:, 0])
    assert np.allclose(of_tum.positions_xyz, expected[:, 1:4])
    assert np.allclose(of_tum.orientations_quat_wxyz, expected[:, [7, 4, 5, 6]])
    of_kitti = file_interface.read_kitti_poses_file("t.kitti")
    assert np.allclose(of_kitti.poses_se3, of_tum.poses_se3, atol=1e-7)


def test_the_images_of_a_topic_are_reconstructed_and_checked(run, room, tmp_path):
    pytest.importorskip("rosbags")
    from tests.bags import raw, write_bag

    files = sorted((room / "images").iterdir())
    messages = [raw(om.read_image(file), "rgb8", FIRST_S + k / 10) for k, file in enumerate(files)]
    bag = write_bag(tmp_path / "drive.bag", {"/cam0/image_raw": messages, "/cam1/image_raw": messages[:1]})
    written = om.extract_frames(bag, tmp_path / "images", 5.0, topic="/cam0/image_raw")
    assert len(written) == FRAMES // 2
    numbers = [int(path.stem.removeprefix("drive-")) for path in written]
    assert [number // 2 for number in numbers] == [0, 1, 2, 3]
    assert np.abs(om.read_image(written[0]).astype(int) - om.read_image(files[numbers[0]])).mean() < 3

    camera = ("--camera", room / "camera.json")
    for command in ("doctor", "reconstruct", "map"):
        output = () if command == "doctor" else ("-o", tmp_path / command)
        status, _, err = run(command, bag, *camera, *output)
        assert status == 2
        assert "specify one (--topic)" in err
    options = ("--images", "8", *camera, "--json")
    of_bag = json.loads(run("doctor", bag, "--topic", "/cam0/image_raw", *options)[1])["findings"]
    of_folder = json.loads(run("doctor", room / "images", *options)[1])["findings"]
    assert [finding["level"] for finding in of_bag] == [finding["level"] for finding in of_folder]
    assert "leave out --topic" in run("reconstruct", room / "images", *camera, "-o", "m", "--topic", "/a")[2]
