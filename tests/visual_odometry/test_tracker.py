"""Patches of rendered images, with true distances."""

import numpy as np

from omnisight.images import to_gray8
from omnisight.simulation import scene_named
from omnisight.visual_odometry.central_rig import central_rig
from omnisight.visual_odometry.tracker import Tracker

# Frames between two images: near surfaces move by many pixels.
STEP = 5


def tracked(fisheye, known, fold):
    """Return the share of a quarter of the patches found within 1.5 px in a distant frame, given points of others."""
    first, second = (fisheye.poses[k] for k in (0, STEP))
    camera, images = fisheye.camera, [to_gray8(fisheye.images[k]) for k in (0, STEP)]
    tracker = Tracker(central_rig(camera), [np.ones(images[0].shape, bool)], 400)
    tracker.track(images[:1], first.inverse())
    tracker.start(tracker.corners(images[:1]), first.inverse())
    patches = tracker.patches
    directions = camera.rays(patches.pixels).bearings @ first.rotation.T
    origins = np.tile(first.translation, (len(patches), 1))
    distances = scene_named("room").cast(origins, directions).distances
    points = origins + distances[:, None] * directions
    is_new = np.arange(len(patches)) % 4 == fold
    if known:
        tracker.set_points(patches.number[~is_new], points[~is_new])
        tracker.start(tracker.corners(images[:1]), first.inverse())
    tracker.track(images[1:], second.inverse())
    seen = tracker.patches[tracker.patches.is_seen]
    true, valid = camera.project(second.inverse() @ points[is_new])
    rows, exists = seen.rows_of(patches.number[is_new])
    found = exists & (np.linalg.norm(seen.pixels[rows] - true, axis=1) < 1.5)
    assert valid.sum() > 20
    return found[valid].mean()


def test_patches_of_unknown_distance_are_searched_at_that_of_their_neighbours(fisheye):
    near, far = (np.mean([tracked(fisheye, known, fold) for fold in range(4)]) for known in (True, False))
    assert near > 1.15 * far > 0
