"""Patches of known surfaces as a camera shows them from a pose."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.rig import Rig
from omnisight.visual_odometry.patches import Patches

Array = NDArray[np.float64]

# Standard deviation of a position: that of the noise of the image times a factor, because differences of neighbouring
# pixels are correlated; that of interpolation (px); and, per radian between the views now and in the template, that of
# surfaces which are not planes. They maximize the likelihood of the true errors in five rendered sequences.
NOISE_FACTOR, POSITION_SIGMA_PX, SLANT_SIGMA_PX = 2.0, 0.02, 0.15
# Change of the logarithm of a distance for the derivative of pixels by it.
DEPTH_STEP = 1e-3
# Steps along the axes of a patch from which its map follows.
STEPS = (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1)


class PatchViews:
    """Patches as a camera of a rig shows them.

    A patch of unknown distance is at its guess; without one it is in its last direction from the rig, so far away that
    its parallax is zero.
    """

    def __init__(self, rig: Rig, sensor: int, patches: Patches, rig_from_world: Pose, period: int) -> None:
        """Place the patches in the world.

        Parameters
        ----------
        rig, sensor
            The cameras, and the index of one of them.
        patches
            The patches.
        rig_from_world
            Pose of the rig.
        period
            Width (px) after which the image of the camera repeats, or 0.
        """
        self._camera, self._patches, self._period = rig.cameras[sensor], patches, period
        self._rig_from_world, self._sensor_from_world = rig_from_world, rig.sensor_from_rig[sensor] @ rig_from_world
        far = rig_from_world.inverse().translation + _far(rig) * patches.directions
        points = np.where(patches.has_point[:, None], patches.points, patches.guesses)
        self._points = np.where(np.isfinite(points), points, far)
        radial = self._points - patches.centers
        tangents = patches.tangents * np.linalg.norm(radial, axis=1)[:, None, None]
        # What a unit of the patches is at the points, (N, 3, 2).
        self._units = tangents - radial[:, :, None] * patches.slopes[:, None, :]

    @cached_property
    def pixels(self) -> Array:
        """The pixels (N, 2) of the patches; NaN where not visible."""
        return self._project(self._points)

    @cached_property
    def maps(self) -> Array:
        """The first and second derivatives (N, 2, 5) of pixels by the units of a patch; NaN where not visible."""
        right, left, below, above, later, before = (self._from_center(end) for end in self._ends)
        along = [(right + left) / 2, (below + above) / 2]
        mixed = (later + before) / 2 - along[0] - along[1]
        return np.stack([(right - left) / 2, (below - above) / 2, along[0], mixed, along[1]], -1)

    @property
    def derivatives_by_depth(self) -> Array:
        """The derivatives (N, 2) of pixels by the logarithm of the distance from the centre of the template."""
        farther = self._points + DEPTH_STEP * (self._points - self._patches.centers)
        return self._from_center(self._project(farther)) / DEPTH_STEP

    def axes(self, bearings: Array) -> Array:
        """Return the whitened tangents (N, 2, 3) of measured bearings (N, 3), all in the frame of the rig."""
        from omnisight.visual_odometry._whitened_axes_kernel import whitened_axes

        patches, center = self._patches, self._sensor_from_world.inverse().translation
        scale = np.linalg.norm(self._points - center, axis=1)[:, None, None]
        units = self._rig_from_world.rotation @ (self._units / scale)
        of_noise = (NOISE_FACTOR * np.maximum(patches.noise, 1.0))[:, None, None] ** 2 * patches.uncertainty
        variance = POSITION_SIGMA_PX**2 + (SLANT_SIGMA_PX * patches.view_changes(center)) ** 2
        axes = np.empty((len(bearings), 2, 3))
        whitened_axes(self.maps, units, bearings, of_noise, variance, axes)
        return axes

    @property
    def _ends(self) -> Array:
        """The pixels (6, N, 2) of the steps along the axes of the patches."""
        steps = np.array(STEPS, float)
        slopes = self._patches.slopes
        ends = [self._points + (self._units @ step) / (1.0 + slopes @ step)[:, None] for step in steps]
        return self._project(np.stack(ends))

    def _project(self, points: Array) -> Array:
        pixels, valid = self._camera.project(self._sensor_from_world @ points)
        return np.where(valid[..., None], pixels, np.nan)

    def _from_center(self, pixels: Array) -> Array:
        """Return the differences of pixels (N, 2) from those of the patches, across the seam if they are shorter."""
        difference = pixels - self.pixels
        if self._period:
            difference[:, 0] -= self._period * np.round(difference[:, 0] / self._period)
        return difference


def _far(rig: Rig) -> float:
    """Return a distance at which the origins of rays do not matter."""
    return 1e4 * max(1.0, *(float(np.linalg.norm(pose.translation)) for pose in rig.sensor_from_rig))
