"""Tracks of keypoints: division of long ones."""

import numpy as np

from omnisight.sfm.tracks import Tracks


def test_a_long_track_is_divided_into_neighbouring_cameras():
    rng = np.random.default_rng(0)
    track = np.repeat([0, 1, 2], [3, 10, 4])
    image = np.concatenate([np.arange(3), np.arange(10), np.arange(4)])
    along = rng.permutation(10)  # places of the cameras on a line, in an order of their own
    positions = np.concatenate([rng.normal(size=(3, 3)), along[:, None] * np.array([1.0, 2.0, -1.0]), np.eye(4, 3)])
    divided = Tracks(track, image, np.arange(17)).divided(positions, 4)
    assert len(divided) == 5
    assert sorted(divided.keypoint.tolist()) == list(range(17))
    lengths = np.diff(divided.starts)
    assert lengths.max() <= 4
    assert sorted(lengths.tolist()) == [3, 3, 3, 4, 4]
    parts = [np.sort(along[divided.image[divided.track == k]]) for k in (1, 2, 3)]
    assert all((np.diff(places) == 1).all() for places in parts)
    same = (np.diff(divided.track) == 0) & (np.diff(divided.image) <= 0)
    assert not same.any()  # sorted by image


def test_short_tracks_stay():
    tracks = Tracks(np.array([0, 0, 1, 1]), np.array([0, 1, 0, 2]), np.arange(4))
    assert tracks.divided(np.zeros((4, 3)), 2) is tracks
    none = Tracks(*(np.zeros(0, np.intp),) * 3)
    assert none.divided(np.zeros((0, 3)), 40) is none


def test_two_frames_of_a_track_have_enough_tracks_in_common():
    # Frames 0 to 2 share tracks 0 to 4, frames 3 and 4 tracks 5 to 9; only track 10 connects both groups.
    track = np.concatenate([np.repeat(np.arange(5), 3), np.repeat(np.arange(5, 10), 2), [10] * 5])
    frame = np.concatenate([np.tile([0, 1, 2], 5), np.tile([3, 4], 5), np.arange(5)])
    tracks = Tracks(track, 2 * frame, np.arange(len(track)))
    divided = tracks.divided_where_few_are_common(frame, 5)
    assert len(divided) == 12
    assert sorted(divided.keypoint.tolist()) == list(range(len(track)))
    parts = {tuple(divided.image[divided.track == k] // 2) for k in range(12)}
    assert parts == {(0, 1, 2), (3, 4)}
    assert (np.diff(divided.track) >= 0).all()
    assert tracks.divided_where_few_are_common(frame, 1) is tracks


def test_a_frame_without_enough_tracks_in_common_loses_its_observation():
    track, frame = np.array([0, 0, 0, 1, 1]), np.array([0, 1, 2, 0, 1])
    divided = Tracks(track, frame, np.arange(5)).divided_where_few_are_common(frame, 2)
    assert divided.image.tolist() == [0, 1, 0, 1]


def test_several_images_of_a_frame_count_once():
    """Both sensors of a rig see the same point: that is one track in common, not two."""
    track, frame = np.array([0, 0, 0, 0]), np.array([0, 0, 1, 1])
    tracks = Tracks(track, np.arange(4), np.arange(4))
    assert len(tracks.divided_where_few_are_common(frame, 2)) == 2
    assert tracks.divided_where_few_are_common(frame, 1) is tracks
