"""Laws that every format of rigs keeps: a new one is tested by existing. And inverted extrinsics."""

import dataclasses
import json

import numpy as np
import pytest
from test_formats import example

import omnisight as om
from omnisight.camera import Camera
from omnisight.formats import FormatError, format_names, get_format, load_rig, rig_format_names, save
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.models import model_class
from omnisight.rig import Rig

RIG_FORMATS = rig_format_names()
PAIRS_ONLY = {"opencv", "ros", "orb_slam3"}
IN_FIRST_FRAME = {"kalibr", "colmap_rig", *PAIRS_ONLY}
# Formats with one lens type or size for all cameras.
UNIFORM = {"opencv", "orb_slam3", "nerfstudio", "aria", "omnimvs"}
KEEPS_OFFSETS = {"native", "kalibr"}
SINGLE_IS_NO_RIG = {"kalibr", "nerfstudio", *PAIRS_ONLY}


def poses(count):
    """Return the poses of cameras that look forward side by side, each turned and moved a little."""
    chance = np.random.default_rng(4)
    turns = exp(chance.normal(0, 0.1, (count, 3)))
    return [Pose(turns[k], np.array([-0.2 * k, 0, 0]) + chance.normal(0, 0.02, 3)) for k in range(count)]


def rig_of(name):
    """Return a rig that the format holds exactly, with as many of its models as it can mix."""
    models = get_format(name).MODELS
    chosen = [models[0]] * 3 if name in UNIFORM else list(models[:2])
    chosen = (chosen * 3)[: 2 if name in PAIRS_ONLY else 3]
    cameras = [example(name, model) for model in chosen]
    rig = Rig(tuple(cameras), tuple(poses(len(cameras))), tuple(f"cam{i}" for i in range(len(cameras))))
    return rig.with_reference(0) if name in IN_FIRST_FRAME else rig


def assert_same_rig(rig, again, atol=1e-12):
    assert len(again) == len(rig)
    for a, b in zip(rig.cameras, again.cameras, strict=True):
        assert type(a.model) is type(b.model)
        np.testing.assert_allclose(b.model.params, a.model.params, rtol=1e-12, atol=1e-12)
        assert a.size == b.size
    for a, b in zip(rig.sensor_from_rig, again.sensor_from_rig, strict=True):
        np.testing.assert_allclose(b.matrix, a.matrix, atol=atol)


def test_every_rig_format_can_be_read_and_written():
    assert len(RIG_FORMATS) >= 13
    for name in format_names():
        assert hasattr(get_format(name), "parse_rig") == hasattr(get_format(name), "serialize_rig")


@pytest.mark.parametrize("name", RIG_FORMATS)
def test_a_saved_rig_reads_back_identically(name, tmp_path):
    rig = rig_of(name)
    written = save(rig, tmp_path / "rig", format=name)
    again = load_rig(tmp_path / "rig")
    assert_same_rig(rig, again)
    assert written.error_px < 1e-9
    assert written.rotation_deg < 1e-9
    assert written.translation < 1e-12
    assert again.provenance["format"] == name
    assert not any("refitted" in note or "not written:" in note for note in written.notes)


@pytest.mark.parametrize("name", RIG_FORMATS)
def test_exactly_one_format_matches_the_file_of_a_rig(name):
    text = get_format(name).serialize_rig(rig_of(name))[0]
    assert [other for other in format_names() if get_format(other).matches(text)] == [name]


@pytest.mark.parametrize("name", RIG_FORMATS)
def test_another_rig_frame_keeps_the_relative_poses(name, tmp_path):
    rig = rig_of(name)
    moved = dataclasses.replace(
        rig, sensor_from_rig=tuple(p @ Pose(om.look(50), np.ones(3)) for p in rig.sensor_from_rig)
    )
    written = save(moved, tmp_path / "rig", format=name)
    assert_same_rig(rig.with_reference(0), load_rig(tmp_path / "rig").with_reference(0))
    assert written.translation < 1e-12


def test_the_frame_of_an_imu_is_forgotten_with_the_frame(tmp_path):
    save(rig_of("basalt"), tmp_path / "basalt.json", format="basalt")
    rig = load_rig(tmp_path / "basalt.json")
    assert rig.provenance["rig_frame"] == "imu"
    moved = rig.with_reference(0)
    assert "rig_frame" not in moved.provenance
    save(moved, tmp_path / "kalibr.yaml", format="kalibr")
    assert "T_cam_imu" not in (tmp_path / "kalibr.yaml").read_text()


@pytest.mark.parametrize("name", RIG_FORMATS)
def test_time_offsets_and_covariances_are_kept_or_reported(name, tmp_path):
    rig = rig_of(name)
    offsets = tuple(0.001 * k for k in range(len(rig)))
    full = dataclasses.replace(rig, time_offsets=offsets, covariance=1e-6 * np.eye(6 * len(rig)))
    notes = " ".join(save(full, tmp_path / "rig", format=name).notes)
    again = load_rig(tmp_path / "rig")
    assert (again.time_offsets == offsets) == (name in KEEPS_OFFSETS)
    assert ("the time offsets" in notes) == (name not in KEEPS_OFFSETS)
    assert ("the covariance of the poses" in notes) == (again.covariance is None)


@pytest.mark.parametrize("name", sorted(set(RIG_FORMATS) - {"native"}))
def test_a_non_central_camera_is_refused_with_what_to_do(name, tmp_path):
    from omnisight.optics.models.axial import Axial

    rays = om.RayCamera(Axial.example(), (960, 962), theta_max=1.2)
    rig = rig_of(name).replaced(1, rays)
    with pytest.raises(FormatError, match=r"non-central.*native"):
        save(rig, tmp_path / "rig", format=name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", RIG_FORMATS)
def test_a_damaged_rig_is_read_or_refused(name, tmp_path):
    text, chance = get_format(name).serialize_rig(rig_of(name))[0], np.random.default_rng(5)
    refused = 0
    for _ in range(60):
        at, length = chance.integers(len(text)), chance.integers(12)
        inserted = "".join(chance.choice(list("[]{}:,-#!'\"\\\n\t 0.eN<>/&*|%")) for _ in range(chance.integers(6)))
        (tmp_path / "rig").write_text(text[:at] + inserted + text[at + length :])
        try:
            rig = load_rig(tmp_path / "rig")
        except FormatError:
            refused += 1
            continue
        for pose in rig.sensor_from_rig:
            np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-9)
            assert np.isfinite(pose.translation).all()
    assert refused
    (tmp_path / "rig").write_text(text[: len(text) // 2])
    with pytest.raises(FormatError):
        load_rig(tmp_path / "rig")


@pytest.mark.parametrize("name", sorted(SINGLE_IS_NO_RIG))
def test_a_file_of_one_camera_is_no_rig(name, tmp_path):
    save(example(name, get_format(name).MODELS[0]), tmp_path / "camera", format=name)
    with pytest.raises(FormatError, match="no rig"):
        load_rig(tmp_path / "camera")


def test_a_matrix_that_is_no_rotation_is_refused_with_its_error(tmp_path, data):
    content = json.loads((data("aria_glasses") / "rig.json").read_text())
    content["cameras"]["camera-slam-left"]["device_from_camera"][0][0] = 1.1
    (tmp_path / "rig.json").write_text(json.dumps(content))
    with pytest.raises(FormatError, match=r"camera-slam-left: device_from_camera is not a rotation.*by 0\.1"):
        load_rig(tmp_path / "rig.json")


def test_a_quaternion_of_another_length_is_refused(tmp_path):
    text = get_format("basalt").serialize_rig(rig_of("basalt"))[0]
    content = json.loads(text)
    content["value0"]["T_imu_cam"][1] |= {"qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 3.0}
    (tmp_path / "rig.json").write_text(json.dumps(content))
    with pytest.raises(FormatError, match=r"cam1: T_imu_cam must be a unit quaternion, got one of length 3"):
        load_rig(tmp_path / "rig.json")


def test_too_many_cameras_are_refused(tmp_path):
    entry = {"image_prefix": "a/", "camera_model_name": "PINHOLE", "camera_params": [1, 1, 1, 1]}
    (tmp_path / "rig.json").write_text(json.dumps([{"cameras": [entry] * 300}]))
    with pytest.raises(FormatError, match="300 cameras; a rig has at most 200"):
        load_rig(tmp_path / "rig.json")


@pytest.mark.parametrize(
    ("folder", "file", "name", "count"),
    [
        ("omnimvs_rig", "config.yaml", "omnimvs", 4),
        ("hilti_rig", "calib_3_cam0-1-camchain-imucam.yaml", "kalibr", 2),
        ("aria_glasses", "rig.json", "aria", 3),
    ],
)
def test_published_rigs_are_read_and_written_without_loss(folder, file, name, count, data, tmp_path):
    rig = load_rig(data(folder) / file)
    assert len(rig) == count
    written = save(rig, tmp_path / "rig", format=name)
    again = load_rig(tmp_path / "rig")
    assert_same_rig(rig, again)
    assert again.names == rig.names
    assert again.time_offsets == rig.time_offsets
    for a, b in zip(rig.cameras, again.cameras, strict=True):
        assert b.theta_max == a.theta_max
        assert set(b.extra) >= set(a.extra)
        for key, value in a.extra.items():
            if key.startswith("T_"):
                np.testing.assert_allclose(b.extra[key], value, atol=1e-8)
            else:
                assert b.extra[key] == value
    assert not written.notes


def test_the_imu_of_kalibr_is_that_of_basalt(data, tmp_path):
    rig = load_rig(data("hilti_rig") / "calib_3_cam0-1-camchain-imucam.yaml")
    save(rig, tmp_path / "basalt.json", format="basalt")
    at_imu = load_rig(tmp_path / "basalt.json")
    np.testing.assert_allclose(
        at_imu.sensor_from_rig[0].matrix, np.array(rig.cameras[0].extra["T_cam_imu"])[:3], atol=1e-8
    )
    save(at_imu, tmp_path / "chain.yaml", format="kalibr")
    again = load_rig(tmp_path / "chain.yaml")
    assert_same_rig(rig, again)
    np.testing.assert_allclose(again.cameras[1].extra["T_cam_imu"], rig.cameras[1].extra["T_cam_imu"], atol=1e-8)


def test_opencv_reads_the_stereo_pair(tmp_path):
    import cv2

    rig = rig_of("opencv")
    save(rig, tmp_path / "stereo.yml", format="opencv")
    storage = cv2.FileStorage(str(tmp_path / "stereo.yml"), cv2.FILE_STORAGE_READ)
    r, t = storage.getNode("R").mat(), storage.getNode("T").mat()
    points = np.random.default_rng(0).uniform((-1, -1, 2), (1, 1, 4), (20, 3))
    k, d = storage.getNode("M2").mat(), storage.getNode("D2").mat()
    pixels = cv2.fisheye.projectPoints(points[:, None], cv2.Rodrigues(r)[0], t, k, d)[0][:, 0]
    np.testing.assert_allclose(rig.project(points)[0][1], pixels, atol=1e-6)


def test_opencv_rectification_agrees_with_the_pose_of_ros(tmp_path):
    import cv2

    lens = Camera(model_class("radial_tangential").example(), (960, 720))
    rig = Rig((lens, lens), tuple(poses(2)), ("left", "right")).with_reference(0)
    save(rig, tmp_path / "pair.yaml", format="ros")
    assert_same_rig(rig, load_rig(tmp_path / "pair.yaml"))
    # A file with the rectification of OpenCV gives the same pose.
    v = lens.model.to_dict()
    k = np.array([[v["fx"], 0, v["cx"]], [0, v["fy"], v["cy"]], [0, 0, 1]])
    pose, none = rig.sensor_from_rig[1], np.zeros(5)
    r1, r2, p1, p2 = cv2.stereoRectify(k, none, k, none, lens.size, pose.rotation, pose.translation[:, None])[:4]
    documents = (tmp_path / "pair.yaml").read_text().split("---\n")
    for i, (r, p) in enumerate(((r1, p1), (r2, p2))):
        lines = [x for x in documents[i].splitlines() if not x.startswith(("rectification", "projection"))]
        lines += [f"rectification_matrix: {{rows: 3, cols: 3, data: {r.ravel().tolist()}}}"]
        lines += [f"projection_matrix: {{rows: 3, cols: 4, data: {p.ravel().tolist()}}}"]
        documents[i] = "\n".join(lines) + "\n"
    (tmp_path / "opencv.yaml").write_text("---\n".join(documents))
    assert_same_rig(rig, load_rig(tmp_path / "opencv.yaml"), atol=1e-9)


def stereo_text(pose, **matrices):
    rig = Rig(rig_of("opencv").cameras, (Pose(), pose), ("a", "b"))
    text = get_format("opencv").serialize_rig(rig)[0]
    for name, value in matrices.items():
        rows, columns = value.shape
        text += f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n"
        text += f"   data: {value.ravel().tolist()}\n"
    return text


@pytest.mark.parametrize("evidence", ["E", "R1, R2 and P2"])
def test_redundant_numbers_of_opencv_show_inverted_extrinsics(evidence, tmp_path):
    import cv2

    from omnisight.geometry.rotation import hat

    pose = rig_of("opencv").sensor_from_rig[1]
    k, none = np.array([[300.0, 0, 320], [0, 300, 240], [0, 0, 1]]), np.zeros(5)
    r1, r2, _, p2 = cv2.stereoRectify(k, none, k, none, (640, 480), pose.rotation, pose.translation[:, None])[:4]
    given = {"E": hat(pose.translation) @ pose.rotation} if evidence == "E" else {"R1": r1, "R2": r2, "P2": p2}
    (tmp_path / "right.yml").write_text(stereo_text(pose, **given))
    assert_same_rig(Rig(rig_of("opencv").cameras, (Pose(), pose), ("a", "b")), load_rig(tmp_path / "right.yml"))
    (tmp_path / "inverted.yml").write_text(stereo_text(pose.inverse(), **given))
    with pytest.raises(FormatError, match=rf"camera 2 are inverted.*{evidence}.*use R' and -R' T"):
        load_rig(tmp_path / "inverted.yml")


def chain(step, imu):
    """Return a Kalibr chain with these matrices."""
    text = get_format("kalibr").serialize_rig(dataclasses.replace(rig_of("kalibr").subset([0, 1])))[0]
    head, rows = text.partition("  T_cn_cnm1")[0], lambda p: np.vstack([p.matrix, [0, 0, 0, 1]]).tolist()
    first, second = head.split("cam1:\n")
    return (
        f"{first}  T_cam_imu: {rows(imu[0])}\ncam1:\n{second}  T_cam_imu: {rows(imu[1])}\n  T_cn_cnm1: {rows(step)}\n"
    )


def test_both_poses_of_kalibr_show_inverted_extrinsics(tmp_path):
    imu = (Pose(om.look(10, 20), np.array([0.1, 0.2, 0.3])), Pose(om.look(40, 5), np.array([-0.3, 0.1, 0.0])))
    step = imu[1] @ imu[0].inverse()
    path = tmp_path / "chain.yaml"
    path.write_text(chain(step, imu))
    np.testing.assert_allclose(load_rig(path).sensor_from_rig[1].matrix, step.matrix, atol=1e-12)
    path.write_text(chain(step.inverse(), imu))
    with pytest.raises(FormatError, match="extrinsics of cam1 are inverted: T_cn_cnm1 maps points of cam1 to cam0"):
        load_rig(path)
    path.write_text(chain(step, [pose.inverse() for pose in imu]))
    with pytest.raises(FormatError, match="cam0 and cam1 are inverted: T_cam_imu maps points of the cameras to"):
        load_rig(path)


def test_a_chain_of_inverted_steps_is_fixed_step_by_step(tmp_path):
    rig = rig_of("kalibr")
    steps = [rig.sensor_from_rig[1], rig.sensor_from_rig[2] @ rig.sensor_from_rig[1].inverse()]
    wrong = [Pose(), steps[0].inverse(), steps[1].inverse() @ steps[0].inverse()]
    save(dataclasses.replace(rig, sensor_from_rig=tuple(wrong)), tmp_path / "chain.yaml", format="kalibr")
    assert_same_rig(rig, load_rig(tmp_path / "chain.yaml").inverted())


def test_versions_of_caliscope_are_distinguished(tmp_path):
    pose = Pose(om.look(30, 10), np.array([0.1, 0.2, 0.9]))
    lens = "size = [ 1280, 720,]\nmatrix = [ [ 900.0, 0.0, 618.0,], [ 0.0, 907.0, 394.0,], [ 0.0, 0.0, 1.0,],]\n"
    lens += f"distortions = [ -0.3, 0.04, -0.004, 0.004, 0.06,]\ntranslation = {pose.translation.tolist()}\n"
    from omnisight.geometry.rotation import log

    rotations = {"matrix": pose.rotation.tolist(), "vector": log(pose.rotation).tolist()}
    for header, own in (("cameras.2", "cam_id = 2\n"), ("cam_2", "port = 2\n"), ("cam_2", 'name = "cam_2"\n')):
        for rotation in rotations.values():
            (tmp_path / "a.toml").write_text(f"[{header}]\n{own}{lens}rotation = {rotation}\n")
            rig = load_rig(tmp_path / "a.toml")
            assert rig.names == ("cam_2",)
            np.testing.assert_allclose(rig.sensor_from_rig[0].matrix, pose.matrix, atol=1e-12)


def test_relative_poses_of_multical_refer_to_the_named_camera(tmp_path):
    rig = rig_of("multical").with_reference(0)
    content = json.loads(get_format("multical").serialize_rig(rig)[0])
    content["camera_poses"] = {
        f"{name}_to_cam0" if name != "cam0" else name: value for name, value in content["camera_poses"].items()
    }
    (tmp_path / "calibration.json").write_text(json.dumps(content))
    assert_same_rig(rig, load_rig(tmp_path / "calibration.json"))


@pytest.mark.peer
def test_pycolmap_reads_the_rig_of_colmap(tmp_path):
    pycolmap = pytest.importorskip("pycolmap")
    rig = rig_of("colmap_rig")
    save(rig, tmp_path / "rig_config.json", format="colmap_rig")
    (config,) = pycolmap.read_rig_config(tmp_path / "rig_config.json")
    assert [camera.ref_sensor for camera in config.cameras] == [True, False, False]
    points = np.random.default_rng(0).uniform((-1, -1, 2), (1, 1, 4), (20, 3))
    pixels, valid = rig.project(points)
    assert valid.all()
    for k, theirs in enumerate(config.cameras):
        pose = np.eye(4)[:3] if theirs.ref_sensor else theirs.cam_from_rig.matrix()
        np.testing.assert_allclose(pose, rig.sensor_from_rig[k].matrix, atol=1e-12)
        seen = theirs.camera.img_from_cam(points @ pose[:, :3].T + pose[:, 3])
        np.testing.assert_allclose(seen - 0.5, pixels[k], atol=1e-6)
