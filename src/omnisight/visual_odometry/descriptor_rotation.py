"""Rotation between two frames by descriptors, where patches are too far from the predicted ones to be tracked."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.features import FeatureOptions, detect_features, match_features
from omnisight.optim.ransac import RansacOptions
from omnisight.rig import Rig
from omnisight.twoview.bearing_pairs import BearingPairs
from omnisight.twoview.relative_pose import estimate_relative_pose
from omnisight.visual_odometry.central_rig import central_cameras

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]

# Keypoints of each image: those of a frame of ordinary texture.
MAX_KEYPOINTS = 1500


def rotation_by_descriptors(
    rig: Rig, masks: Sequence[Mask], first: Sequence[Bytes], last: Sequence[Bytes], seed: int
) -> Array | None:
    """Return the rotation (3, 3) of the rig between the images of two frames, or None if it is unknown."""
    options = FeatureOptions(max_keypoints=MAX_KEYPOINTS)
    bearings, covariances = ([list[Array](), list[Array]()] for _ in range(2))
    for sensor, camera in enumerate(central_cameras(rig)):
        turn = rig.sensor_from_rig[sensor].rotation
        found = [detect_features(images[sensor], camera, options, mask=masks[sensor]) for images in (first, last)]
        pairs = match_features(found[0], found[1]).pairs
        for k, keypoints in enumerate(found):
            used = keypoints[pairs[:, k]]
            bearings[k].append(used.bearings @ turn)
            covariances[k].append(turn.T @ used.covariance @ turn)
    a, b, noise_a, noise_b = (np.concatenate(parts) for parts in (*bearings, *covariances))
    pairs = BearingPairs(a, b, noise_a, noise_b, is_noise_known=False)
    found = estimate_relative_pose(pairs, RansacOptions(seed=seed))
    return None if found.b_from_a is None else found.b_from_a.rotation
