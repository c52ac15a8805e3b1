"""Mapping: poses of all images of a view graph, and their points."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.features import Keypoints
from omnisight.geometry.pose import Pose
from omnisight.optim.loss import StudentT
from omnisight.parallel import parallel_for
from omnisight.sfm.bundle_adjustment import Bundle, RayObservations, Structure, adjust_bundle
from omnisight.sfm.initial_poses import initial_poses, panorama_poses
from omnisight.sfm.registration import register_images
from omnisight.sfm.tracks import Tracks, build_tracks
from omnisight.sfm.view_graph import MIN_INLIERS, Edge
from omnisight.twoview.triangulation import whitening

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Watch = Callable[[str], None]

# Residuals of inliers in standard deviations. The noise is measured on inliers, so that lower thresholds shrink it.
MAX_RESIDUAL_SIGMA = 5.0
# Least parallax of a point: below, its distance is hardly known, and its covariance not symmetric.
MIN_PARALLAX_RAD = float(np.radians(0.5))
# Standard deviation of the residuals of the averaged poses in units of that of the keypoints.
INITIAL_SCALE = 10.0
# Rounds of triangulation and bundle adjustment; they end when the noise changes by less than this share.
MAX_ROUNDS, CONVERGED_CHANGE = 6, 0.05
TRACKS_PER_TASK = 1024


@dataclass(frozen=True, eq=False)
class KeypointRays:
    """Rays of the keypoints of all images.

    Attributes
    ----------
    offsets
        (I + 1,) first keypoint of each image.
    origins, bearings, axes
        (K, 3), (K, 3) and (K, 2, 3); see `RayObservations`.
    """

    offsets: Indices
    origins: Array
    bearings: Array
    axes: Array

    @classmethod
    def of(cls, keypoints: Sequence[Keypoints]) -> "KeypointRays":
        """Join the keypoints of central cameras."""
        offsets = np.concatenate([[0], np.cumsum([len(k) for k in keypoints])]).astype(np.intp)
        bearings = np.concatenate([k.bearings for k in keypoints])
        axes = whitening(np.concatenate([k.covariance for k in keypoints]))
        return cls(offsets, np.zeros_like(bearings), bearings, axes)

    def indices(self, images: Indices, tracks: Tracks) -> Indices:
        """Return which keypoints (M,) are the observations of tracks whose `image` counts in `images`."""
        return self.offsets[images[tracks.image]] + tracks.keypoint


@dataclass(frozen=True, eq=False)
class Map:
    """Poses of images, and points with their tracks.

    Attributes
    ----------
    images
        (I,) indices of the images.
    cam_from_world
        (I, 3, 4) poses.
    points
        (P, 3); none if all images were taken in one place.
    tracks
        Observations of the points; `image` counts in `images`.
    noise
        Distribution of the residuals in units of the standard deviations of the keypoints.
    """

    images: Indices
    cam_from_world: Array
    points: Array
    tracks: Tracks
    noise: StudentT

    def observations(self, rays: KeypointRays) -> RayObservations:
        """Return the rays of the observations."""
        which = rays.indices(self.images, self.tracks)
        sensor = np.zeros(len(which), np.intp)
        of_rays = rays.origins[which], rays.bearings[which], rays.axes[which]
        return RayObservations(self.tracks.image, sensor, self.tracks.track, *of_rays)

    @property
    def structure(self) -> Structure:
        """Poses and points of the bundle adjustment."""
        return Structure(self.cam_from_world, Pose().matrix[None], self.points)

    def bundle(self, rays: KeypointRays) -> Bundle:
        """Return the least-squares problem of the poses and points."""
        return Bundle(self.observations(rays), self.noise, self.structure)


def map_images(keypoints: Sequence[Keypoints], rays: KeypointRays, edges: Sequence[Edge], watch: Watch) -> list[Map]:
    """Return the maps of all connected parts of a view graph, the one with most images first.

    Orientations and positions are averaged over the edges; tracks are triangulated, and poses and points refined by
    bundle adjustment (as in L. Pan et al., Global structure-from-motion revisited, ECCV 2024, but with positions from
    relative scales). Images that averaging left out are registered by resection. Images that are connected by rotations
    only form a map without points.
    """
    maps, rest = list[Map](), list(edges)
    while rest:
        moving = [edge for edge in rest if edge.has_translation]
        images, poses = initial_poses(moving, keypoints) if moving else panorama_poses(rest, len(keypoints))
        found = Map(images, poses, np.zeros((0, 3)), build_tracks([], []), StudentT(sigma=INITIAL_SCALE))
        count = 0
        while moving:
            found = _refined(found, _tracks(found.images, rest, rays), rays, watch)
            if len(found.images) <= count:  # the registered images did not agree with the map
                break
            count = len(found.images)
            added, poses = register_images(found.images, found.tracks, found.points, rest, keypoints)
            if not len(added):
                break
            together = np.concatenate([found.cam_from_world, poses])
            found = replace(found, images=np.concatenate([found.images, added]), cam_from_world=together)
        is_map = len(found.images) > 1
        maps += [found] if is_map else []
        inside = set((found.images if is_map else images).tolist())
        rest = [edge for edge in rest if edge.a not in inside and edge.b not in inside]
    return sorted(maps, key=lambda found: -len(found.images))


def _tracks(images: Indices, edges: Sequence[Edge], rays: KeypointRays) -> Tracks:
    """Return the tracks of the edges between some images, in which these are counted."""
    position = {int(image): i for i, image in enumerate(images)}
    inside = [
        replace(edge, a=position[edge.a], b=position[edge.b])
        for edge in edges
        if edge.a in position and edge.b in position
    ]
    return build_tracks(inside, np.diff(rays.offsets)[images].tolist())


def _refined(current: Map, tracks: Tracks, rays: KeypointRays, watch: Watch) -> Map:
    """Triangulate tracks and adjust poses and points until the noise of the residuals stays the same."""
    for _ in range(MAX_ROUNDS):
        before = current.noise.sigma
        current = _triangulated(current, tracks, rays)
        watch(f"{len(current.images)} images, {len(current.points)} points")
        current = _adjusted(current, rays)
        if abs(current.noise.sigma - before) <= CONVERGED_CHANGE * before:
            break
    return _without_unsupported_images(current)


def _without_unsupported_images(current: Map) -> Map:
    """Return the map without images whose observations do not agree with it: their poses are wrong or unknown."""
    tracks = current.tracks
    keep = np.bincount(tracks.image, minlength=len(current.images)) >= MIN_INLIERS
    if keep.all():
        return current
    supported, used = tracks.select(keep[tracks.image])
    index = np.cumsum(keep) - 1
    return replace(
        current,
        images=current.images[keep],
        cam_from_world=current.cam_from_world[keep],
        points=current.points[used],
        tracks=replace(supported, image=index[supported.image]),
    )


def _triangulated(current: Map, tracks: Tracks, rays: KeypointRays) -> Map:
    """Return the map with the points of all tracks that agree with its poses."""
    from omnisight.sfm._track_kernel import triangulate_tracks

    which = rays.indices(current.images, tracks)
    rotations = current.cam_from_world[tracks.image, :, :3]
    origins = np.einsum("mji,mj->mi", rotations, rays.origins[which] - current.cam_from_world[tracks.image, :, 3])
    directions = np.einsum("mji,mj->mi", rotations, rays.bearings[which])
    world_rays = tracks.starts, tracks.image, origins, directions, rays.axes[which] @ rotations
    limits = (MAX_RESIDUAL_SIGMA * current.noise.sigma) ** 2, MIN_PARALLAX_RAD
    points, inliers = np.empty((len(tracks), 3)), np.zeros(len(which), bool)
    parallel_for(
        lambda first, last: triangulate_tracks(*world_rays, *limits, first, last, points, inliers),
        len(tracks),
        TRACKS_PER_TASK,
    )
    agreeing, kept = tracks.select(inliers)
    return replace(current, points=points[kept], tracks=agreeing)


def _adjusted(current: Map, rays: KeypointRays) -> Map:
    """Return the map with poses and points of the least robust cost, and the noise of the residuals."""
    observations = current.observations(rays)
    current = replace(current, noise=_noise(current.structure, observations))
    structure = adjust_bundle(current.bundle(rays)).state
    poses, points = structure.rig_from_world, structure.points
    return replace(current, cam_from_world=poses, points=points, noise=_noise(structure, observations))


def _noise(structure: Structure, observations: RayObservations) -> StudentT:
    """Return the distribution of the whitened residuals, corrected for the parameters that were fitted to them."""
    fitted = StudentT.fit(structure.squared_residuals(observations))
    freedom = 2 * len(observations) - structure.points.size - 6 * len(structure.rig_from_world)
    return replace(fitted, sigma=fitted.sigma * float(np.sqrt(2 * len(observations) / max(freedom, 1))))
