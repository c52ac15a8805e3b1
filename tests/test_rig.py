"""Rigs: cameras on one body, heads that see all around, and the files that hold them."""

import dataclasses
import json

import numpy as np
import pytest

import omnisight as om
from omnisight.formats import FormatError, load_all
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import log
from omnisight.geometry.sphere import cap
from omnisight.optics.models.axial import Axial
from omnisight.rig import Rig
from omnisight.simulation.example_rigs import back_to_back, ladybug, surround_car

HEADS = [pytest.param(make(), id=make.__name__) for make in (back_to_back, ladybug, surround_car)]
every_head = pytest.mark.parametrize("rig", HEADS)
FAR = 1000 * cap(np.pi, 50)
ELEVATION = np.degrees(np.arcsin(-FAR[:, 1] / 1000))
LENS = om.Camera(om.model_class("kannala_brandt").example(), (960, 962))


def pair():
    """Return a rig of a central and a non-central camera; the second is rotated to the right and 1 m away."""
    rays = om.RayCamera(Axial.example(), (960, 962), theta_max=1.2)
    return Rig.from_sensors(
        {"left": (LENS, Pose()), "right": (rays, Pose(om.look(yaw=90), np.array([0.0, 0.0, -1.0])))}
    )


def test_rigs_with_equal_cameras_and_poses_are_equal(tmp_path):
    rig = pair()
    assert rig == pair()
    assert hash(rig) == hash(pair())
    assert rig != rig.subset(["left"])
    moved = dataclasses.replace(rig, sensor_from_rig=(rig.sensor_from_rig[0], rig.sensor_from_rig[1].moved(np.ones(6))))
    assert rig != moved
    om.save(rig, tmp_path / "rig.json")
    assert om.load_rig(tmp_path / "rig.json") == om.load_rig(tmp_path / "rig.json")


@every_head
def test_rays_and_projections_agree(rig):
    for name, camera in zip(rig.names, rig.cameras, strict=True):
        at = np.random.default_rng(0).uniform(0, 1, (50, 2)) * (np.array(camera.size) - 1)
        origins, bearings, valid = rig.rays(name, at)
        np.testing.assert_allclose(np.linalg.norm(bearings[valid], axis=1), 1)
        pixels, seen = rig.project((origins + 3 * bearings)[valid])
        assert seen[rig.index(name)].all()
        np.testing.assert_allclose(pixels[rig.index(name)], at[valid], atol=1e-8)


@every_head
def test_points_are_transformed_to_each_camera_frame(rig):
    points = np.random.default_rng(1).normal(0, 3, (40, 3))
    pixels, valid = rig.project(points)
    for k, (camera, pose) in enumerate(zip(rig.cameras, rig.sensor_from_rig, strict=True)):
        expected, shown = camera.project(points @ pose.rotation.T + pose.translation)
        np.testing.assert_array_equal(valid[k], shown)
        np.testing.assert_allclose(pixels[k], expected, atol=1e-9)


@every_head
def test_rays_start_at_the_camera_positions(rig):
    for k, pose in enumerate(rig.sensor_from_rig):
        origins = rig.rays(k, [[300.0, 300.0], [500.0, 400.0]]).origins
        np.testing.assert_allclose(pose @ origins, 0, atol=1e-12)


def test_back_to_back_covers_the_sphere_with_an_overlap():
    rig = back_to_back()
    seen = rig.in_view(FAR)
    assert seen.any(0).all()
    angle = np.degrees(np.arccos(FAR[:, 2] / 1000))
    np.testing.assert_array_equal(seen[0], angle <= 100)
    np.testing.assert_array_equal(seen.all(0), np.abs(angle - 90) <= 10)


def test_ladybug_covers_everything_except_the_poles():
    rig = ladybug()
    assert len(rig) == 5
    seen = rig.in_view(FAR)
    assert seen.any(0)[np.abs(ELEVATION) < 72].all()
    assert not seen.any(0)[np.abs(ELEVATION) > 80].any()
    assert (seen.sum(0)[np.abs(ELEVATION) < 30] <= 2).all()
    # Of every seam two cameras see both sides.
    for k in range(5):
        seam = 1000 * om.look(yaw=72 * k + 36).T @ (0.0, 0.0, 1.0)
        assert np.flatnonzero(rig.in_view(seam)).tolist() == sorted((k, (k + 1) % 5))


def test_surround_car_covers_the_ground_and_the_horizon():
    rig = surround_car()
    x, z = (g.ravel() for g in np.meshgrid(np.linspace(-6, 6, 25), np.linspace(-7, 7, 29)))
    ground = np.stack([x, 0 * x, z], -1)
    outside = (np.abs(x) > 1.2) | (np.abs(z) > 2.4)
    assert rig.in_view(ground)[:, outside].any(0).all()
    assert rig.in_view(FAR)[:, np.abs(ELEVATION) < 15].any(0).all()
    # Each corner of the car is seen by the two cameras beside it.
    for name, corner in (("right", (3.0, 0.0, 4.0)), ("left", (-3.0, 0.0, 4.0))):
        assert {"front", name} <= {rig.names[k] for k in np.flatnonzero(rig.in_view(corner))}


def test_non_central_camera_in_a_rig():
    rig = pair()
    pixels, valid = rig.project([[0.0, 0.0, 2.0], [5.0, 0.0, 0.0]])
    assert pixels.shape == (2, 2, 2)
    assert valid.shape == (2, 2)
    assert rig.in_view([5.0, 0.0, 0.0]).tolist() == [True, True]
    assert rig.in_view([0.3, 0.0, 2.0]).tolist() == [True, False]


def test_any_leading_shape_is_kept():
    pixels, valid = pair().project(np.ones((3, 4, 3)))
    assert (pixels.shape, valid.shape) == ((2, 3, 4, 2), (2, 3, 4))
    assert pair().in_view(np.ones((0, 3))).shape == (2, 0)
    assert pair().rays("left", np.ones((2, 5, 2))).bearings.shape == (2, 5, 3)


@every_head
def test_scaled_keeps_the_rays(rig):
    half = rig.scaled(0.5)
    at = np.array([[200.0, 300.0], [500.0, 400.0]])
    np.testing.assert_allclose(half.rays(1, (at + 0.5) / 2 - 0.5).bearings, rig.rays(1, at).bearings, atol=1e-12)
    assert half.cameras[0].width == round(rig.cameras[0].width / 2)


def test_subset_keeps_order_and_names():
    some = ladybug().subset([3, "cam1"])
    assert some.names == ("cam3", "cam1")
    np.testing.assert_array_equal(some.sensor_from_rig[1].rotation, ladybug().sensor_from_rig[1].rotation)
    np.testing.assert_array_equal(some.rays(0, [3.0, 4.0]).origins, ladybug().rays(3, [3.0, 4.0]).origins)


def test_inconsistent_rigs_are_rejected():
    with pytest.raises(ValueError, match="same number of cameras, poses and names, got 1, 0 and 1"):
        Rig((LENS,), (), ("a",))
    with pytest.raises(ValueError, match="needs at least one camera"):
        Rig.from_sensors({})
    with pytest.raises(ValueError, match="must be unique, got a, a"):
        Rig((LENS, LENS), (Pose(), Pose()), ("a", "a"))
    with pytest.raises(ValueError, match="no camera 'up'; the rig has left, right"):
        pair().rays("up", [0.0, 0.0])
    with pytest.raises(ValueError, match="no camera 2; the rig has 2"):
        pair().rays(2, [0.0, 0.0])
    with pytest.raises(dataclasses.FrozenInstanceError):
        pair().names = ()


@pytest.mark.parametrize("rig", [*HEADS, pytest.param(pair(), id="pair")])
def test_rig_file_round_trip(rig, tmp_path):
    om.save(rig, tmp_path / "rig.json")
    again = om.load_rig(tmp_path / "rig.json")
    assert again.names == rig.names
    assert [c.model for c in again.cameras] == [c.model for c in rig.cameras]
    for a, b in zip(again.sensor_from_rig, rig.sensor_from_rig, strict=True):
        np.testing.assert_allclose(a.rotation, b.rotation, atol=1e-15)
        np.testing.assert_array_equal(a.translation, b.translation)
    # Each of its cameras is a camera like any.
    assert list(load_all(tmp_path / "rig.json")) == list(rig.names)
    assert om.load(tmp_path / "rig.json", name=rig.names[1]).model == rig.cameras[1].model


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(sensors=3), "sensors"),
        (lambda d: d["sensors"].update(left={}), "sensor left: missing camera"),
        (
            lambda d: d["sensors"]["left"]["sensor_from_rig"].update(rotation=[[2, 0, 0], [0, 1, 0], [0, 0, 1]]),
            "rotation",
        ),
        (lambda d: d["sensors"]["left"]["sensor_from_rig"].update(translation=[0, 0]), "translation"),
        (lambda d: d["sensors"]["left"]["sensor_from_rig"].update(translation=[0, 0, float("nan")]), "translation"),
        (lambda d: d["sensors"]["left"]["camera"].update(model="nonsense"), "nonsense"),
        (lambda d: d["sensors"]["left"].update(sensor_from_rig=None), "sensor left: sensor_from_rig must be an object"),
        (lambda d: d["sensors"].update({"\x1b[31m": {}}), r"printable characters, got '\\x1b"),
        (lambda d: d.update(sensors={str(k): {} for k in range(10**4)}), "10000 cameras; a rig has at most 200"),
        (lambda d: d.update(sensors={}), "needs at least one camera"),
        (lambda d: d.update(format="omnisight-camera"), "is a camera, not a rig of cameras"),
        (lambda d: d.update(version="1"), "version"),
    ],
)
def test_damaged_rig_files_are_rejected(change, message, tmp_path):
    om.save(pair(), tmp_path / "rig.json")
    data = json.loads((tmp_path / "rig.json").read_text())
    change(data)
    (tmp_path / "rig.json").write_text(json.dumps(data))
    with pytest.raises(FormatError, match=message):
        om.load_rig(tmp_path / "rig.json")


def test_reflections_are_rejected_as_rotations(tmp_path):
    om.save(pair(), tmp_path / "rig.json")
    data = json.loads((tmp_path / "rig.json").read_text())
    data["sensors"]["left"]["sensor_from_rig"]["rotation"] = np.diag([-1.0, 1.0, 1.0]).tolist()
    (tmp_path / "rig.json").write_text(json.dumps(data))
    with pytest.raises(FormatError, match="rotation is not a rotation matrix"):
        om.load_rig(tmp_path / "rig.json")


def chain(poses):
    """Return a Kalibr chain of cameras with the given lines of their poses."""
    camera = (
        "  camera_model: pinhole\n  intrinsics: [350.0, 350.0, 360.0, 270.0]\n  distortion_model: equidistant\n"
        "  distortion_coeffs: [-0.04, 0.0, 0.0, 0.0]\n  resolution: [720, 540]\n"
    )
    return "".join(f"cam{i}:\n{camera}{pose}" for i, pose in enumerate(poses))


def matrix(pose):
    return np.vstack([np.column_stack([pose.rotation, pose.translation]), [0, 0, 0, 1]]).tolist()


@pytest.mark.parametrize("field", ["T_cn_cnm1", "T_cam_imu"])
def test_a_kalibr_chain_is_a_rig_in_the_frame_of_its_first_camera(field, tmp_path):
    first, second, third = Pose(om.look(10, 20), np.array([0.1, 0.2, 0.3])), Pose(om.look(90), np.ones(3)), Pose()
    from_first = {"cam0": Pose(), "cam1": second @ first.inverse(), "cam2": third @ first.inverse()}
    poses = {"T_cam_imu": (first, second, third), "T_cn_cnm1": (None, from_first["cam1"], third @ second.inverse())}
    lines = ["" if pose is None else f"  {field}: {matrix(pose)}\n" for pose in poses[field]]
    (tmp_path / "chain.yaml").write_text(chain(lines))
    rig = om.load_rig(tmp_path / "chain.yaml")
    assert rig.names == ("cam0", "cam1", "cam2")
    assert rig.cameras[2].model.name == "kannala_brandt"
    for name, pose in zip(rig.names, rig.sensor_from_rig, strict=True):
        np.testing.assert_allclose(pose.rotation, from_first[name].rotation, atol=1e-12)
        np.testing.assert_allclose(pose.translation, from_first[name].translation, atol=1e-12)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([""], "holds one camera, which is no rig"),
        (["", ""], "cam1: neither T_cn_cnm1 nor T_cam_imu: its pose is unknown"),
        (["", "  T_cn_cnm1: 3\n"], "cam1: T_cn_cnm1 must have 4 rows of 4 numbers"),
        (["", f"  T_cn_cnm1: {(2 * np.eye(4)).tolist()}\n"], "cam1: T_cn_cnm1 is not a rotation matrix"),
    ],
)
def test_a_kalibr_chain_without_poses_is_no_rig(lines, message, tmp_path):
    (tmp_path / "chain.yaml").write_text(chain(lines))
    with pytest.raises(FormatError, match=message):
        om.load_rig(tmp_path / "chain.yaml")


def test_a_published_kalibr_chain_is_read(data):
    rig = om.load_rig(data("hilti_rig") / "calib_3_cam0-1-camchain-imucam.yaml")
    assert rig.names == ("cam0", "cam1")
    left_from_right = rig.sensor_from_rig[1].inverse()
    # The chain holds both poses relative to the IMU and to each other.
    imu = [np.array(camera.extra["T_cam_imu"]) for camera in rig.cameras]
    np.testing.assert_allclose(matrix(left_from_right), imu[0] @ np.linalg.inv(imu[1]), atol=1e-9)
    assert np.linalg.norm(left_from_right.translation) == pytest.approx(0.108, abs=0.002)


def test_a_file_of_another_kind_is_no_rig(tmp_path):
    (tmp_path / "rig.txt").write_text("no rig")
    with pytest.raises(FormatError, match=r"rig\.txt: not a rig; formats of rigs: .*kalibr, .*native"):
        om.load_rig(tmp_path / "rig.txt")


def test_a_format_of_single_cameras_refuses_a_rig(tmp_path):
    with pytest.raises(FormatError, match=r"holds no rigs; formats of rigs: .*native"):
        om.save(pair(), tmp_path / "rig.txt", format="ocamcalib")
    assert not list(tmp_path.iterdir())


def with_covariance(rig):
    """Return the rig with correlated errors of about a tenth of a degree and two millimetres."""
    mixed = np.random.default_rng(0).normal(0, 2e-3, (6 * len(rig), 6 * len(rig)))
    return dataclasses.replace(rig, covariance=mixed @ mixed.T / len(mixed))


def test_the_covariance_follows_the_reference():
    rig = with_covariance(surround_car())
    moved = rig.with_reference("right")
    assert (rig.reference, moved.reference) == (None, "right")
    assert not moved.covariance[6:12].any()
    steps = np.random.default_rng(1).multivariate_normal(np.zeros(24), rig.covariance, 4000)
    samples = []
    for step in steps:
        poses = [pose.moved(step[6 * k : 6 * k + 6]) for k, pose in enumerate(rig.sensor_from_rig)]
        relative = [pose @ poses[1].inverse() for pose in poses]
        pairs = zip(relative, moved.sensor_from_rig, strict=True)
        samples.append([[*log(a.rotation @ b.rotation.T), *(a.translation - b.translation)] for a, b in pairs])
    observed = np.cov(np.reshape(samples, (len(steps), -1)).T)
    # The standard error of a variance of 4000 samples is 2.2 %.
    scale = np.sqrt(np.outer(*[np.diagonal(moved.covariance)] * 2))
    off = np.abs(observed - moved.covariance)[scale > 0] / scale[scale > 0]
    assert off.max() < 0.11


def test_relative_poses_do_not_depend_on_the_reference():
    rig = with_covariance(surround_car())
    for other in (rig, rig.with_reference(2)):
        pose, covariance = other.relative_pose("front", "left")
        expected = rig.sensor_from_rig[3] @ rig.sensor_from_rig[0].inverse()
        np.testing.assert_allclose(pose.matrix, expected.matrix, atol=1e-12)
        np.testing.assert_allclose(covariance, rig.relative_pose(0, 3).covariance, atol=1e-15)
    assert surround_car().relative_pose(0, 1).covariance is None


def test_a_replaced_camera_keeps_its_pose():
    rig = surround_car()
    changed = rig.replaced("right", LENS)
    assert changed.cameras[1] == LENS
    assert changed.cameras[2:] == rig.cameras[2:]
    assert changed.sensor_from_rig == rig.sensor_from_rig


def test_the_overlap_of_turned_hemispheres_is_that_of_lunes():
    # Equidistant fisheyes of 180 degrees: the common field of view of two at an angle a is a lune of 180 - a degrees.
    lens = om.Camera(om.model_class("equidistant").example(), (4000, 4000), theta_max=np.pi / 2)
    lens = dataclasses.replace(lens, model=lens.model.with_values({"cx": 1999.5, "cy": 1999.5, "fx": 900, "fy": 900}))
    rig = Rig((lens,) * 4, tuple(Pose(om.look(yaw=a)) for a in (0, 45, 90, 180)), ("a", "b", "c", "d"))
    assert rig.overlap()[0] == pytest.approx([1, 0.75, 0.5, 0], abs=0.005)


def test_the_overlap_depends_on_the_distance():
    lens = om.perspective(fov=90, size=(400, 400))
    rig = Rig((lens, lens), (Pose(), Pose(np.eye(3), np.array([-1.0, 0, 0]))), ("left", "right"))
    assert rig.overlap()[0, 1] == pytest.approx(1, abs=0.01)
    near = rig.overlap(2.0)
    assert 0.3 < near[0, 1] < 0.9
    assert near[0, 1] == pytest.approx(near[1, 0], abs=0.01)
    assert rig.overlap(0.4)[0, 1] == 0
    with pytest.raises(ValueError, match="must be positive, got -1"):
        rig.overlap(-1.0)
