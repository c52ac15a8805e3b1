"""Rigs: the scale, and the frames of all cameras."""

import dataclasses

import numpy as np
import pytest

import omnisight as om
from omnisight.simulation.example_rigs import back_to_back
from omnisight.simulation.trajectory import read_trajectory
from omnisight.visual_odometry.ray_observations import FrameRays
from omnisight.visual_odometry.rig_scale import estimate_rig_scale

FRAMES = 12


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Return the folder of a sequence of two fisheyes back to back, 10 cm apart, and the rig."""
    folder, rig = tmp_path_factory.mktemp("rig") / "room", back_to_back(320, apart=0.1)
    om.simulate(om.SimulateOptions("room", rig, folder, frames=FRAMES, fps=10, rays=1, jpeg=95))
    return folder, rig


def test_the_trajectory_of_a_rig_is_in_metres(room):
    folder, rig = room
    result = om.odometry(folder, rig=rig)
    true = read_trajectory(folder / "poses.txt").poses
    assert result.has_scale
    assert [pose.frame for pose in result.trajectory] == list(range(FRAMES))
    length = np.linalg.norm(np.diff([pose.translation for pose in true], axis=0), axis=1).sum()
    assert result.path_length == pytest.approx(length, rel=0.03)
    first, last = (result.trajectory[k].rig_from_world for k in (0, -1))
    error = (first @ last.inverse()).inverse() @ (true[0].inverse() @ true[-1])
    assert np.linalg.norm(error.translation) < 0.03 * length
    assert np.degrees(np.arccos((np.trace(error.rotation) - 1) / 2)) < 0.2


def test_a_segment_without_a_scale_leaves_the_others_in_metres(room, tmp_path):
    """The mirror image of the scene is another place, in which one of the lenses is covered."""
    folder, rig = room
    for sensor, name in enumerate(rig.names):
        (tmp_path / name).mkdir()
        images = [om.read_image(path) for path in sorted((folder / name / "images").iterdir())]
        other = [np.zeros_like(image) if sensor else image[:, ::-1] for image in images[::-1]]
        for k, image in enumerate([*images, *other]):
            om.write_image(tmp_path / name / f"{k:02d}.png", image)
    result = om.odometry(tmp_path, rig=rig)
    assert result.has_scale
    first, second = result.segments
    assert (first.first, first.last, second.last) == (0, FRAMES - 1, 2 * FRAMES - 1)
    expected = (
        "the scale of 1 of 2 segments is extrapolated: the cameras of the rig do not determine it from image 12 on"
    )
    assert result.warnings == (expected,)
    centers = [pose.rig_from_world.inverse().translation for pose in result.trajectory]
    true = [pose.translation for pose in read_trajectory(folder / "poses.txt").poses]
    measured, length = (np.linalg.norm(np.diff(path[:FRAMES], axis=0), axis=1).sum() for path in (centers, true))
    assert measured == pytest.approx(length, rel=0.03)


def test_a_rig_in_one_point_has_no_scale(room):
    folder, rig = room
    poses = tuple(om.Pose(pose.rotation) for pose in rig.sensor_from_rig)
    result = om.odometry(folder, rig=dataclasses.replace(rig, sensor_from_rig=poses))
    assert result
    assert not result.has_scale


def test_cameras_that_are_taken_to_be_in_one_point_are_reported(room, tmp_path):
    """Each lens shows one half of the room only, so that no point is seen by two."""
    folder, rig = room
    for name in rig.names:
        mask = np.hypot(*(np.indices((320, 320)) - 159.5)) < 130
        om.write_image(tmp_path / f"{name}.png", np.where(mask, 255, 0).astype(np.uint8))
    result = om.odometry(folder, rig=rig, options=om.OdometryOptions(mask=tmp_path))
    assert result
    assert not result.has_scale
    assert result.neglected_baseline == pytest.approx(0.1)
    (text,) = result.warnings
    assert "the cameras of the rig, up to 0.1 units of its file apart, were taken to be in one point" in text


def test_masks_of_a_rig_are_those_of_some_cameras_or_one_of_all(room, tmp_path):
    folder, rig = room
    first, last = rig.names
    om.write_image(tmp_path / f"{last.upper()}.png", np.zeros((320, 320), np.uint8))
    for mask, name in ((tmp_path, last), (tmp_path / f"{last.upper()}.png", first)):
        with pytest.raises(ValueError, match=f"the mask of {name} selects no pixel of the field of view"):
            om.odometry(folder, rig=rig, options=om.OdometryOptions(mask=mask))


def rays(noise, scale=2.5, distance=4.0):
    """Return rays of points at a distance in units from a first camera, and of a second one 0.2 m beside it."""
    rng = np.random.default_rng(0)
    bearings = rng.normal(size=(40, 3))
    bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
    distances = distance * rng.uniform(0.7, 1.5, 40)
    origin = np.array([0.1, 0.0, 0.0])
    points = origin + scale * distances[:, None] * bearings
    seen = points + origin
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    axes = []
    for k, bearing in enumerate(seen):
        _, _, tangents = np.linalg.svd(bearing[None])
        seen[k] += noise * tangents[1:].T @ rng.normal(size=2)
        axes.append(tangents[1:] / noise)
    number, unknown = np.arange(40), np.full((40, 3), np.nan)
    one = FrameRays(number, unknown, np.tile(origin, (40, 1)), bearings, np.array(axes))
    return one, FrameRays(number, unknown, np.tile(-origin, (40, 1)), seen, np.array(axes)), distances


def test_the_scale_of_exact_rays_is_found_to_first_order_of_the_parallax():
    found = estimate_rig_scale(*rays(noise=1e-5, distance=40.0))
    assert found
    assert found.scale == pytest.approx(2.5, rel=0.01)


def test_a_scale_whose_parallax_is_below_the_noise_is_unknown():
    assert not estimate_rig_scale(*rays(noise=1e-2, distance=40.0))
    one, other, distances = rays(noise=1e-5)
    assert not estimate_rig_scale(one, other[np.arange(40) < 5], distances)
