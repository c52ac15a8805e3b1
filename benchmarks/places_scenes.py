"""Rendered panoramas with known overlap, for the benchmark of places."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import omnisight as om
from benchmarks.rendered_images import image_cache
from omnisight.features import FeatureOptions, Keypoints, detect_features
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import look
from omnisight.places.verification import even_directions
from omnisight.simulation import Renderer, Scene, scene_named
from omnisight.simulation.preset_motion import preset_trajectory

Array = NDArray[np.float64]

CAMERA = om.sphere(720)
# The other lane of a street, driven in the other direction under a darker exposure (stops).
OTHER_LANE, OTHER_EXPOSURE = Pose(look(np.pi), np.array((-3.4, 0.0, 0.0))), -1.0
# Directions from which the overlap of two images is determined.
DIRECTIONS = 512
# A surface point overlaps if it is visible in both images, at similar distances and from similar directions: beyond
# this, descriptors of SIFT change too much for matching.
MAX_DISTANCE_RATIO, MAX_PARALLAX_RAD = 2.0, float(np.radians(30))


def loop(scene: str, count: int, seed: int = 0) -> list[Pose]:
    """Return poses at regular distances along the loop of a scene."""
    found = scene_named(scene, seed)
    return regular(preset_trajectory("loop", found.free, 0.0, found.route).poses, count)


def regular(poses: Sequence[Pose], count: int, offset: float = 0.0) -> list[Pose]:
    """Return poses at regular distances along a path of closely spaced ones, shifted by a share of the distance."""
    steps = np.linalg.norm(np.diff([pose.translation for pose in poses], axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    return [poses[i] for i in np.searchsorted(along, (np.arange(count) + offset) / count * along[-1])]


def both_lanes(scene: str, count: int) -> tuple[list[Pose], list[float]]:
    """Return poses along a loop and back along the other lane, and their exposures."""
    there = loop(scene, count // 2)
    return there + [pose @ OTHER_LANE for pose in there[::-1]], [0.0] * len(there) + [OTHER_EXPOSURE] * len(there)


def keypoints_of(
    scene: str, poses: list[Pose], exposures: list[float], options: FeatureOptions, seed: int = 0
) -> list[Keypoints]:
    """Render images at poses, or read them from the cache, and detect keypoints."""
    folder = image_cache("places") / f"{scene}-{seed}-{len(poses)}"
    folder.mkdir(parents=True, exist_ok=True)
    found: list[Keypoints] = []
    for i, (pose, exposure) in enumerate(zip(poses, exposures, strict=True)):
        path = folder / f"{i:04d}.png"
        if not path.exists():
            renderer = Renderer(CAMERA, pose, scene_named(scene, seed))
            om.write_image(path, renderer(rng=np.random.default_rng((seed, i)), exposure=exposure).image)
        found.append(detect_features(om.read_image(path), CAMERA, options))
    return found


def overlaps(scene: Scene, poses: list[Pose]) -> Array:
    """Return the share (N, N) of the surface seen from each pose that can be matched in the image of each other."""
    bearings = even_directions(DIRECTIONS)
    eyes = np.array([pose.translation for pose in poses])
    share = np.eye(len(poses))
    for a, eye in enumerate(eyes):
        distance = scene.cast(eye, bearings).distances
        known = np.isfinite(distance)
        rays, distance = bearings[known], distance[known]
        offset = eye + distance[:, None] * rays - eyes[:, None]
        length = np.linalg.norm(offset, axis=2)
        similar = np.abs(np.log(length / distance)) < np.log(MAX_DISTANCE_RATIO)
        toward = offset / length[:, :, None]
        b, k = np.nonzero(similar & (np.einsum("bki,ki->bk", toward, rays) > np.cos(MAX_PARALLAX_RAD)))
        reached = scene.cast(eyes[b], toward[b, k]).distances
        visible = np.abs(reached - length[b, k]) < 0.01 * length[b, k] + 0.02
        share[a] = np.bincount(b[visible], minlength=len(poses)) / max(len(rays), 1)
    return np.minimum(share, share.T)
