"""Tracking of patches through the images of the cameras of a rig."""

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.parallel import parallel_for
from omnisight.rig import Rig
from omnisight.visual_odometry.central_rig import central_cameras
from omnisight.visual_odometry.corner_detection import detect_corners
from omnisight.visual_odometry.image_pyramid import LEVELS, ImagePyramid
from omnisight.visual_odometry.patch_views import PatchViews
from omnisight.visual_odometry.patches import Patches, Textures
from omnisight.visual_odometry.ray_observations import FrameRays
from omnisight.visual_odometry.solid_angle_cells import SolidAngleCells

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
Bytes = NDArray[np.uint8]

# Normalized correlation below which a patch shows something else.
MIN_CORRELATION = 0.8
# Standard deviation of the slopes of surfaces: a slant of 45 degrees has 1.
SLOPE_SIGMA = 1.0
# Patches per task of a thread.
PATCHES_PER_TASK = 32
# Fields of patches that an alignment measures.
MEASURED = "pixels", "noise", "uncertainty", "slopes"
# Half a patch of the finest level with its derivatives, px.
MARGIN_PX = 6.0


class Tracker:
    """Patches that are tracked through the images of a rig.

    Attributes
    ----------
    patches
        All patches. Those whose point is known stay while the image does not show them, until `drop` is called.
    """

    def __init__(self, rig: Rig, regions: Sequence[Mask], count: int) -> None:
        """Prepare the cameras.

        Parameters
        ----------
        rig
            The cameras.
        regions
            For each camera the pixels (H, W) to use.
        count
            Number of patches wanted in all cameras.
        """
        import cv2

        self.rig = rig
        self.patches, self._textures = Patches.none(), Textures()
        self._next = 0
        self._clearance = [
            cv2.distanceTransform(np.pad(r.astype(np.uint8), 1), cv2.DIST_L2, 3)[1:-1, 1:-1] for r in regions
        ]
        inner = [distance > MARGIN_PX for distance in self._clearance]
        self._cells = [
            SolidAngleCells.of(c, r, count // len(rig)) for c, r in zip(central_cameras(rig), inner, strict=True)
        ]
        self._pyramids: list[ImagePyramid] = []
        self._before = self.patches

    def track(self, images: Sequence[Bytes], predicted: Pose) -> FrameRays:
        """Find the patches in the images (H, W) of the next frame, whose rig_from_world is predicted."""
        self._pyramids = [ImagePyramid.of(image, c) for image, c in zip(images, central_cameras(self.rig), strict=True)]
        self._before = self.patches
        return self.track_again(predicted)

    def track_again(self, predicted: Pose) -> FrameRays:
        """Find the patches of the frame before in the last images, with another prediction."""
        p = self._before
        copies = {name: getattr(p, name).copy() for name in MEASURED}
        found = replace(p, **copies, is_seen=np.zeros(len(p), np.bool_))
        for sensor in range(len(self.rig)):
            mine = np.flatnonzero(p.sensor == sensor)
            mine = mine[self._is_inside(sensor, p[mine], predicted)]
            if len(mine):
                aligned = self._align(sensor, p[mine], predicted)
                for name in (*MEASURED, "is_seen"):
                    getattr(found, name)[mine] = getattr(aligned, name)
        self.patches = found[found.is_seen | found.has_point]
        return self.rays(predicted)

    def rays(self, rig_from_world: Pose) -> FrameRays:
        """Return the rays of the patches that the last images show."""
        parts = list[FrameRays]()
        for sensor in range(len(self.rig)):
            seen = self.patches[self.patches.is_seen & (self.patches.sensor == sensor)]
            parts.append(self._rays_of(sensor, seen, rig_from_world))
        rays = reduce(FrameRays.joined, parts, FrameRays.none())
        return rays[np.argsort(rays.number)]

    def cross_rays(self, rig_from_world: Pose) -> FrameRays:
        """Return the rays of seen patches in the last images of the other cameras.

        Their points are known, or their distance is so large that parallax between the cameras is small.
        """
        parts = list[FrameRays]()
        for sensor in range(len(self.rig)):
            others = self.patches[self.patches.is_seen & (self.patches.sensor != sensor)]
            others = others[self._is_inside(sensor, others, rig_from_world)]
            if len(others):
                found = self._align(sensor, others, rig_from_world)
                parts.append(self._rays_of(sensor, found[found.is_seen], rig_from_world))
        return reduce(FrameRays.joined, parts, FrameRays.none())

    def _rays_of(self, sensor: int, patches: Patches, rig_from_world: Pose) -> FrameRays:
        """Return the rays of patches that an image of a sensor shows."""
        if not len(patches):
            return FrameRays.none()
        rays = self.rig.rays(sensor, patches.pixels)
        axes = self._views(sensor, patches, rig_from_world).axes(rays.bearings)
        use = np.asarray(np.isfinite(axes).all(axis=(1, 2)), np.bool_)
        return FrameRays(patches.number, patches.points, rays.origins, rays.bearings, axes)[use]

    def confirm(self, rig_from_world: Pose, rays: FrameRays, is_inlier: Mask) -> None:
        """Keep the directions of inliers in the world, and forget where outliers were seen."""
        rows, _ = self.patches.rows_of(rays.number)
        seen, directions = self.patches.is_seen.copy(), self.patches.directions.copy()
        seen[rows] = is_inlier
        directions[rows] = rays.bearings @ rig_from_world.rotation
        patches = replace(self.patches, is_seen=seen, directions=directions)
        self.patches = self._with_guesses(patches[seen | patches.has_point], rig_from_world)

    def corners(self, images: Sequence[Bytes]) -> list[Array]:
        """Return the corners (K, 2) of the last images of each camera, in cells without a patch."""
        found = list[Array]()
        for sensor, gray in enumerate(images):
            seen = (self.patches.sensor == sensor) & self.patches.is_seen
            found.append(detect_corners(gray, self._cells[sensor], self.patches.pixels[seen]))
        return found

    def start(self, corners: Sequence[Array], rig_from_world: Pose) -> FrameRays:
        """Start patches at corners of the last images; return their rays."""
        parts = list[FrameRays]()
        for sensor, pixels in enumerate(corners):
            if len(pixels):
                new = self._new_patches(sensor, pixels, rig_from_world)
                self.patches = self.patches.joined(new)
                parts.append(self._rays_of(sensor, new, rig_from_world))
        self.patches = self._with_guesses(self.patches, rig_from_world)
        return reduce(FrameRays.joined, parts, FrameRays.none())

    def _with_guesses(self, patches: Patches, rig_from_world: Pose) -> Patches:
        """Return patches whose unknown distances are guessed to be those of the known points nearest in direction."""
        centers = np.array([(pose @ rig_from_world).inverse().translation for pose in self.rig.sensor_from_rig])
        known, unknown = patches.has_point & patches.is_seen, ~patches.has_point
        guesses = np.full((len(patches), 3), np.nan)
        if known.any():
            points, origins = patches.points[known], centers[patches.sensor[unknown]]
            nearest = np.argmax(patches.directions[unknown] @ patches.directions[known].T, axis=1)
            distances = np.linalg.norm(points[nearest] - origins, axis=1)
            guesses[unknown] = origins + distances[:, None] * patches.directions[unknown]
        return replace(patches, guesses=guesses)

    @property
    def cells(self) -> int:
        """Number of cells of equal solid angle; a patch can start in each."""
        return sum(cells.used for cells in self._cells)

    def texture(self, images: Sequence[Bytes]) -> int:
        """Return the number of cells in which images show a corner."""
        nothing = np.zeros((0, 2))
        return sum(len(detect_corners(gray, cells, nothing)) for gray, cells in zip(images, self._cells, strict=True))

    def set_points(self, number: Indices, points: Array) -> None:
        """Set the points (K, 3) of patches, which are unknown for all others."""
        rows, exists = self.patches.rows_of(number)
        known = np.full((len(self.patches), 3), np.nan)
        known[rows[exists]] = points[exists]
        patches = replace(self.patches, points=known)
        self.patches = patches[patches.is_seen | patches.has_point]

    def _is_inside(self, sensor: int, patches: Patches, predicted: Pose) -> Mask:
        """Return which patches (N,) are predicted in the used region of the image of a sensor."""
        pixels = self._views(sensor, patches, predicted).pixels
        return np.asarray(self._levels(sensor, pixels) >= 0, np.bool_)

    def _align(self, sensor: int, patches: Patches, predicted: Pose) -> Patches:
        """Return patches as an image of a sensor shows them; they are predicted in its used region."""
        from omnisight.visual_odometry._patch_alignment_kernel import align

        views = self._views(sensor, patches, predicted)
        start, maps, depths = views.pixels, views.maps, views.derivatives_by_depth
        level = self._levels(sensor, start)
        level[~np.isfinite(maps).all(axis=(1, 2))] = -1
        pyramid = self._pyramids[sensor]
        at, maps = pyramid.inside(np.nan_to_num(start)), np.nan_to_num(maps)
        correlation, noise, uncertainty = np.empty(len(at)), np.empty(len(at)), np.zeros((len(at), 2, 2))
        slopes, depths = patches.slopes.copy(), np.nan_to_num(depths)
        slope_sigma = SLOPE_SIGMA * np.linalg.norm(patches.tangents, axis=1).max(axis=1) * patches.has_point
        arrays, rows = self._textures.arrays, patches.texture
        parallel_for(
            lambda first, last: align(
                pyramid.levels,
                arrays,
                rows,
                maps,
                depths,
                level,
                slope_sigma,
                slopes,
                at,
                correlation,
                noise,
                uncertainty,
                first,
                last,
            ),
            len(at),
            PATCHES_PER_TASK,
        )
        pixels = pyramid.outside(at)
        seen = (correlation > MIN_CORRELATION) & (
            self._cells[sensor].at(np.where(correlation[:, None] > 0, pixels, -9)) >= 0
        )
        pixels = np.where(seen[:, None], pixels, patches.pixels)
        slopes = np.where(seen[:, None], slopes, patches.slopes)
        return replace(patches, pixels=pixels, noise=noise, uncertainty=uncertainty, slopes=slopes, is_seen=seen)

    def _views(self, sensor: int, patches: Patches, rig_from_world: Pose) -> PatchViews:
        return PatchViews(self.rig, sensor, patches, rig_from_world, self._pyramids[sensor].period)

    def _levels(self, sensor: int, pixels: Array) -> Indices:
        """Return the coarsest level (N,) on which patches at pixels are inside the used region; -1 for none."""
        clearance = self._clearance[sensor]
        column, row = np.rint(np.nan_to_num(pixels, nan=-1.0)).astype(int).T
        height, width = clearance.shape
        inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        free = clearance[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
        level = np.floor(np.log2(np.maximum(free / MARGIN_PX, 1e-9))).astype(np.intp)
        return np.where(inside, np.clip(level, -1, LEVELS - 1), -1)

    def _new_patches(self, sensor: int, pixels: Array, rig_from_world: Pose) -> Patches:
        """Return new patches at pixels (K, 2) of the last image of a sensor."""
        from omnisight.visual_odometry._patch_kernel import extract

        count, rotation = len(pixels), rig_from_world.rotation
        rays = self.rig.rays(sensor, pixels)
        sensor_from_world = self.rig.sensor_from_rig[sensor] @ rig_from_world
        tangents = self._tangents(sensor, pixels, rays.bearings)
        new = replace(
            Patches.none(),
            number=np.arange(self._next, self._next + count),
            sensor=np.full(count, sensor, np.intp),
            pixels=pixels,
            points=np.full((count, 3), np.nan),
            directions=rays.bearings @ rotation,
            tangents=rotation.T @ tangents,
            centers=np.tile(sensor_from_world.inverse().translation, (count, 1)),
            texture=self._textures.free_rows(count, np.append(self.patches.texture, self._before.texture)),
            uncertainty=np.zeros((count, 2, 2)),
            slopes=np.zeros((count, 2)),
            guesses=np.full((count, 3), np.nan),
            noise=np.zeros(count),
            is_seen=np.ones(count, np.bool_),
        )
        self._next += count
        maps = self._views(sensor, new, rig_from_world).maps
        pyramid, level = self._pyramids[sensor], self._levels(sensor, pixels)
        at, maps = pyramid.inside(pixels), np.nan_to_num(maps)
        rows, textures = new.texture, self._textures
        extract(pyramid.levels, at, maps, rows, textures.arrays, 0, count)
        textures.usable[rows] &= np.arange(LEVELS) <= level[:, None]
        return replace(new, uncertainty=textures.inverses[rows, 0])[textures.usable[rows, 0]]

    def _tangents(self, sensor: int, pixels: Array, bearings: Array) -> Array:
        """Return perpendicular axes (K, 3, 2) of patches in the frame of the rig, of the larger side of a pixel."""
        step = np.array([[0.5, 0.0], [0.0, 0.5]])
        right, below = (
            self.rig.rays(sensor, pixels + d).bearings - self.rig.rays(sensor, pixels - d).bearings for d in step
        )
        sides = np.linalg.norm(right, axis=1), np.linalg.norm(below, axis=1)
        first = right - (right * bearings).sum(-1, keepdims=True) * bearings
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        pair = np.stack([first, np.cross(bearings, first)], -1)
        return pair * np.fmax(*sides)[:, None, None]
