"""Rigs from several files that share an IMU."""

import numpy as np
import pytest

import omnisight as om
from omnisight.formats import load_joined_rig
from omnisight.models import model_class
from omnisight.simulation.example_rigs import ladybug

NAMES = ("calib_3_cam0-1", "calib_3_cam2", "calib_3_cam3", "calib_3_cam4")
CHAIN = """cam0:
  T_cam_imu: {pose}
  camera_model: pinhole
  intrinsics: [350.0, 350.0, 360.0, 270.0]
  distortion_model: equidistant
  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]
  resolution: [720, 540]
  rostopic: {topic}
"""


@pytest.fixture
def chains(tmp_path):
    """Return the files of the cameras of a ring, each with its pose relative to the IMU."""
    rig, paths = ladybug(), []
    for k, pose in enumerate(rig.sensor_from_rig):
        path = tmp_path / f"chain{k}.yaml"
        path.write_text(CHAIN.format(pose=pose.matrix.tolist(), topic=f"/head/cam{k}/image_raw"))
        paths.append(path)
    return rig, paths


def test_cameras_of_several_files_are_joined_by_their_imu(chains):
    rig, paths = chains
    joined = load_joined_rig(paths)
    assert joined.names == rig.names
    for pose, exact in zip(joined.sensor_from_rig, rig.with_reference(0).sensor_from_rig, strict=True):
        assert pose.matrix == pytest.approx(exact.matrix, abs=1e-12)


def test_cameras_without_topics_are_named_after_their_files(chains):
    _, paths = chains
    for path in paths:
        path.write_text(path.read_text().replace("rostopic", "# rostopic"))
    assert load_joined_rig(paths).names == tuple(f"chain{k}-cam0" for k in range(5))


def test_time_offsets_of_some_cameras_are_kept_and_reported(chains, tmp_path):
    _, paths = chains
    paths[1].write_text(f"{paths[1].read_text()}  timeshift_cam_imu: 0.004\n")
    rig = load_joined_rig(paths)
    assert rig.time_offsets == ()
    note = "no time offsets: timeshift_cam_imu is known of cam1 and unknown of cam0, cam2, cam3, cam4"
    assert om.save(rig, tmp_path / "rig.json").notes == (note,)
    om.save(rig, tmp_path / "rig.yaml", format="kalibr")
    again = om.load_rig(tmp_path / "rig.yaml")
    assert [camera.extra.get("timeshift_cam_imu") for camera in again.cameras] == [None, 0.004, None, None, None]
    assert not om.save(rig.subset(["cam0", "cam2"]), tmp_path / "two.json").notes


def test_files_that_cannot_be_joined_are_named(chains):
    _, paths = chains
    with pytest.raises(ValueError, match=r"chain1-cam0: this camera is specified twice"):
        load_joined_rig([paths[1], paths[0], paths[1]])
    paths[2].write_text(paths[2].read_text().replace("T_cam_imu", "# T_cam_imu"))
    with pytest.raises(ValueError, match=r"chain2.yaml: the pose of cam0 relative to the imu is unknown"):
        load_joined_rig(paths)


def test_published_chains_of_one_head_are_converted_to_one_rig(data, tmp_path):
    folder, output = data("hilti_rig"), tmp_path / "rig.json"
    files = [folder / f"{name}-camchain-imucam.yaml" for name in NAMES]
    om.convert_rig(files, om.ConvertOptions(output=output))
    rig = om.load_rig(output)
    assert rig.names == tuple(f"cam{k}" for k in range(5))
    both = rig.relative_pose("cam0", "cam1")[0]
    assert both.translation == pytest.approx(om.load_rig(files[0]).sensor_from_rig[1].translation, abs=1e-3)
    # The head has a camera that looks up and one to each side.
    axes = np.array([pose.rotation.T[:, 2] for pose in rig.sensor_from_rig])
    assert axes[2:] @ axes[0] == pytest.approx(0.0, abs=0.02)


def test_names_that_a_format_replaces_are_reported(tmp_path):
    camera = om.Camera(model_class("kannala_brandt").example(), (960, 720))
    rig = om.Rig((camera, camera), (om.Pose(), om.Pose(np.eye(3), [-0.1, 0, 0])), ("left", "right"))
    notes = om.save(rig, tmp_path / "rig.yaml", format="kalibr").notes
    assert notes == ("the names of the cameras are those of the format: left is cam0, right is cam1",)
    assert not om.save(om.load_rig(tmp_path / "rig.yaml"), tmp_path / "again.yaml", format="kalibr").notes
