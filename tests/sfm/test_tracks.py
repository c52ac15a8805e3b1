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
