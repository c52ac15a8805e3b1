"""The trajectory of rendered sequences, and what interrupts it."""

import dataclasses

import numpy as np
import pytest

import omnisight as om
from omnisight.features.detection_views import valid_region
from omnisight.geometry import rotation as so3


@pytest.mark.parametrize("name", ["fisheye", "sphere"])
def test_the_trajectory_is_that_of_the_camera(request, run, name):
    sequence = request.getfixturevalue(name)
    tracking = run(sequence)
    assert [pose.frame for pose in tracking.trajectory] == list(range(len(sequence.images)))
    assert not tracking.lost
    position, rotation_deg = sequence.errors(tracking.trajectory)
    assert position < 0.003
    assert rotation_deg < 0.3


def test_the_world_is_the_frame_of_the_first_image_and_the_unit_the_first_baseline(fisheye, run):
    tracking = run(fisheye)
    first = tracking.trajectory[0].rig_from_world
    assert np.allclose(first.matrix, np.eye(3, 4), atol=1e-6)
    assert not tracking.has_scale
    steps = [np.linalg.norm(pose.rig_from_world.inverse().translation) for pose in tracking.trajectory[1:4]]
    assert min(abs(np.array(steps) - 1)) < 0.05


def test_the_same_images_and_seed_give_the_same_trajectory(sphere, run):
    first, second = (run(sphere).trajectory for _ in range(2))
    assert len(first) == len(second) > 10
    assert all(
        np.array_equal(a.rig_from_world.matrix, b.rig_from_world.matrix) for a, b in zip(first, second, strict=True)
    )


def test_steps_of_the_exposure_have_no_effect(fisheye, run):
    gains = [1.0, 0.6, 1.3, 0.8]
    images = [np.clip(im * gains[k // 5 % 4], 0, 255).astype(np.uint8) for k, im in enumerate(fisheye.images)]
    tracking = run(fisheye, images)
    assert len(tracking.trajectory) == len(images)
    assert fisheye.errors(tracking.trajectory)[0] < 0.003


def test_a_covered_lens_is_reported_and_the_camera_relocalized(fisheye, run):
    images = list(fisheye.images)
    rng = np.random.default_rng(0)
    images[15:20] = [rng.integers(5, 12, images[0].shape).astype(np.uint8) for _ in range(5)]
    tracking = run(fisheye, images)
    assert {pose.frame for pose in tracking.trajectory} == {*range(15), *range(20, 36)}
    (lost,) = tracking.lost
    assert (lost.first, lost.last) == (15, 19)
    assert lost.recovery in ("tracking", "relocalization")
    assert "covered" in lost.reason
    assert fisheye.errors(tracking.trajectory)[0] < 0.004


def test_after_a_cut_a_new_segment_starts(fisheye, run):
    """A mirror image of the scene is another place."""
    images = [*fisheye.images[:18], *(image[:, ::-1] for image in fisheye.images[18:])]
    tracking = run(fisheye, images)
    (lost,) = tracking.lost
    assert lost.first == 18
    assert lost.recovery == "new segment"
    assert "another place" in lost.reason or "agree with a pose" in lost.reason or "points tracked" in lost.reason
    assert len(tracking.trajectory) >= len(images) - 3
    frames = [pose.frame for pose in tracking.trajectory]
    assert frames == sorted(set(frames))
    assert fisheye.errors(tracking.trajectory[:18])[0] < 0.003


def test_a_camera_that_does_not_move_has_a_pose_and_no_position(fisheye, run):
    tracking = run(fisheye, [fisheye.images[0]] * len(fisheye.images))
    assert [pose.motion for pose in tracking.trajectory] == ["rotation only"] * len(fisheye.images)
    assert all(np.allclose(pose.rig_from_world.matrix, np.eye(3, 4), atol=1e-3) for pose in tracking.trajectory)


def test_a_camera_that_turns_is_recognized(sphere, run):
    """Shifting the columns of a 360 image rotates the camera about its vertical axis."""
    step = 4
    images = [np.roll(sphere.images[0], -step * k, axis=1) for k in range(len(sphere.images))]
    tracking = run(sphere, images)
    assert {pose.motion for pose in tracking.trajectory} == {"rotation only"}
    last = tracking.trajectory[-1].rig_from_world
    assert np.allclose(last.translation, 0)
    true = om.look(yaw=360 * step * (len(images) - 1) / 512)
    assert np.degrees(np.linalg.norm(so3.log(last.rotation @ true.T))) < 0.2


def test_closing_loops_meanwhile_does_not_change_the_tracking(fisheye, run):
    tracking = om.Odometry(fisheye.camera)
    assert tracking.close_loops().reason == "there are no images"
    for k, image in enumerate(fisheye.images[:20]):
        tracking.add(image, 0.1 * k)
        if k == 12:
            closed = tracking.close_loops()
    assert not closed
    assert closed.reason == "no place was seen again"
    assert len(closed.trajectory) == 13
    expected = run(fisheye, fisheye.images[:20])
    assert all(
        np.array_equal(a.rig_from_world.matrix, b.rig_from_world.matrix)
        for a, b in zip(tracking.trajectory, expected.trajectory, strict=True)
    )
    with pytest.raises(ValueError, match=r"use MotionOptions\(loops=True\)"):
        run(fisheye, fisheye.images[:2], loops=False).close_loops()


def test_masked_pixels_are_not_used(fisheye):
    mask = np.ones((300, 400), bool)
    mask[:, :200] = False
    tracking = om.Odometry(fisheye.camera, masks=[mask])
    for image, seconds in zip(fisheye.images[:3], fisheye.seconds, strict=False):
        tracking.add(image, seconds)
    pixels = tracking.tracker.patches.pixels
    assert len(pixels) > 30
    assert pixels[:, 0].min() >= 200


def test_a_mask_without_a_usable_pixel_is_refused(fisheye):
    outside = ~valid_region(fisheye.camera)
    assert outside.any()
    with pytest.raises(ValueError, match="the mask of camera selects no pixel of the field of view"):
        om.Odometry(fisheye.camera, masks=[outside]).add(fisheye.images[0], 0.0)


def test_masks_of_another_size_are_refused(fisheye):
    with pytest.raises(ValueError, match="the mask of camera is 100x100 px, but its camera 400x300"):
        om.Odometry(fisheye.camera, masks=[np.ones((100, 100), np.bool_)])


def test_gray_images_in_memory_that_cannot_be_written_are_tracked(fisheye, run):
    read_only = [om.images.to_gray8(image) for image in fisheye.images[:12]]
    for image in read_only:
        image.flags.writeable = False
    expected = run(fisheye, fisheye.images[:12]).trajectory
    found = run(fisheye, read_only).trajectory
    assert len(found) == len(expected) == 12
    assert all(
        np.array_equal(a.rig_from_world.matrix, b.rig_from_world.matrix) for a, b in zip(found, expected, strict=True)
    )


def test_wrong_images_and_times_are_refused(fisheye):
    tracking = om.Odometry(fisheye.camera)
    with pytest.raises(ValueError, match="the image of camera is 100x100 px, but its camera 400x300"):
        tracking.add(np.zeros((100, 100), np.uint8), 0.0)
    tracking.add(fisheye.images[0], 1.0)
    with pytest.raises(ValueError, match="the time of frame 1 is 1 s, not after 1 s"):
        tracking.add(fisheye.images[1], 1.0)
    with pytest.raises(ValueError, match="2 images for 1 cameras"):
        tracking.add([fisheye.images[1]] * 2, 2.0)
    with pytest.raises(ValueError, match=r"NoneType, not an array .* count a frame without images \(skip\)"):
        tracking.add(None, 2.0)  # what OpenCV returns for a frame that a camera does not deliver
    with pytest.raises(ValueError, match="the time of frame 1 is inf s"):
        tracking.add(fisheye.images[1], np.inf)
    with pytest.raises(ValueError, match="the time of frame 0 is nan s"):
        om.Odometry(fisheye.camera).add(fisheye.images[0], np.nan)
    assert tracking.add(fisheye.images[1], 1.1).frame == 1
    with pytest.raises(ValueError, match=r"str, not a camera or a rig: read its file \(om.load, or om.load_rig\)"):
        om.Odometry(str(fisheye.folder / "camera.json"))
    with pytest.raises(ValueError, match="--window must be at least 3"):
        om.MotionOptions(window=1)


def test_a_wrong_camera_has_large_residuals(fisheye, run):
    model = fisheye.camera.model
    wrong = dataclasses.replace(model, fx=1.3 * model.fx, fy=1.3 * model.fy)
    right = np.median(run(fisheye).residuals)
    assert np.median(run(fisheye._replace(camera=dataclasses.replace(fisheye.camera, model=wrong))).residuals) > 3
    assert 0.5 < right < 2


def test_a_lens_that_is_covered_at_first_loses_only_these_images(fisheye, run):
    images = [np.full_like(fisheye.images[0], 8)] * 6 + list(fisheye.images[6:])
    tracking = run(fisheye, images)
    assert [pose.frame for pose in tracking.trajectory] == list(range(6, 36))
    (lost,) = tracking.lost
    assert (lost.first, lost.last, lost.recovery) == (0, 5, "tracking")
    assert "covered" in lost.reason
    assert fisheye.errors(tracking.trajectory)[0] < 0.004


def test_after_a_covered_lens_another_place_starts_a_new_segment(fisheye, run):
    covered = [np.full_like(fisheye.images[0], 8)] * 4
    tracking = run(fisheye, [*fisheye.images[:14], *covered, *(image[:, ::-1] for image in fisheye.images[18:])])
    assert [lost.recovery for lost in tracking.lost] == ["new segment"]
    assert (tracking.lost[0].first, len(tracking.trajectory)) == (14, 32)


def test_a_cut_right_after_the_start_is_reported(fisheye, run):
    """The keyframes are then those of the initialization."""
    started = om.Odometry(fisheye.camera)
    start = next(k for k, image in enumerate(fisheye.images) if started.add(image, 0.1 * k).is_keyframe)
    images = [*fisheye.images[: start + 1], *(image[:, ::-1] for image in fisheye.images[start + 1 :])]
    tracking = run(fisheye, images)
    assert tracking.lost[0].first == start + 1
    assert len(tracking.trajectory) >= len(images) - 3


def test_after_a_cut_to_a_known_place_tracking_goes_on_there(fisheye, run):
    """The jump is not a velocity."""
    order = [*range(30), *range(8, 28)]
    tracking = run(fisheye, [fisheye.images[k] for k in order])
    assert len(tracking.trajectory) == len(order)
    (cut,) = tracking.lost
    assert (cut.first, cut.last, cut.recovery) == (30, 30, "relocalization")
    assert "points" in cut.reason
    seen_again = [dataclasses.replace(pose, frame=order[pose.frame]) for pose in tracking.trajectory]
    assert fisheye.errors(seen_again)[0] < 0.003


def test_the_first_image_has_a_pose_although_the_second_is_turned_by_50_degrees(fisheye, run):
    """Patches of the first image are found by the rotation that descriptors determine."""
    tracking = run(fisheye, fisheye.images[::6])
    assert [pose.frame for pose in tracking.trajectory] == list(range(6))
    assert not tracking.lost


def test_all_keyframes_are_refined_together_at_the_end(fisheye, run):
    tracking = run(fisheye)
    refined = tracking.close_loops()
    assert not refined
    assert [pose.frame for pose in refined.trajectory] == [pose.frame for pose in tracking.trajectory]
    assert fisheye.errors(refined.trajectory)[0] < 0.9 * fisheye.errors(tracking.trajectory)[0]


def test_frames_without_an_image_are_lost_and_the_last_ones_not_recovered(fisheye):
    tracking = om.Odometry(fisheye.camera)
    tracking.skip("0.png cannot be read")
    for k, image in enumerate(fisheye.images[:12]):
        tracking.add(image, 0.1 * k - 1.0)
    tracking.skip("13.png cannot be read")
    tracking.finish()
    assert [(each.first, each.last, each.recovery) for each in tracking.lost] == [(0, 0, "tracking"), (13, 13, "")]
    assert [pose.frame for pose in tracking.trajectory] == list(range(1, 13))
