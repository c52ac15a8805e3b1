"""Boards observed by exactly traced non-central cameras, as ground truth for calibrations."""

from dataclasses import dataclass

import numpy as np

import omnisight as om
from calibrating import observe
from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import polar
from omnisight.models.equisolid import Equisolid
from omnisight.models.pinhole import Pinhole
from omnisight.optics import Catadioptric
from omnisight.optics.mirrors.conic import Conic
from omnisight.optics.placed_mirror import PlacedMirror
from omnisight.pipeline.calibration.calibrate import assess, select_noncentral

SIZE = (1280, 1024)
BOARD = om.Checkerboard(9, 6, 0.03)
# Rotation from the mirror camera frame (z towards the lens) to the lens frame.
TURN = np.diag([-1.0, 1.0, -1.0])


@dataclass(frozen=True)
class MirrorCamera:
    """A lens and a mirror, in a frame at the mirror's vertex that looks back at the lens."""

    system: Catadioptric

    @property
    def vertex(self):
        pose = self.system.mirrors[0].lens_from_mirror
        return pose.translation

    def project(self, points):
        return self.system.project(points @ TURN + self.vertex)

    def rays(self, pixels):
        origins, bearings, valid = self.system.rays(pixels)
        return (origins - self.vertex) @ TURN, bearings @ TURN, valid


@dataclass(frozen=True)
class PupilShiftFisheye:
    """An equisolid fisheye whose entrance pupil moves forward with the angle: s = shift (1 - cos(theta))."""

    lens: Equisolid
    shift: float

    def project(self, points):
        rho, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
        low, high = np.zeros(len(points)), np.full(len(points), np.pi)
        for _ in range(60):
            middle = (low + high) / 2
            start = self.shift * (1 - np.cos(middle))
            outside = rho * np.cos(middle) > (z - start) * np.sin(middle)
            low, high = np.where(outside, middle, low), np.where(outside, high, middle)
        start = self.shift * (1 - np.cos(low))
        return self.lens.project(points - start[:, None] * (0.0, 0.0, 1.0))

    def rays(self, pixels):
        bearings, valid = self.lens.unproject(pixels)
        return self.shift * (1 - bearings[..., 2:]) * np.array([0.0, 0.0, 1.0]), bearings, valid


def sphere():
    """Return a camera in front of a sphere of 10 cm."""
    return _before(Conic.sphere(radius=0.05, rim=0.0475), 0.1, 1500.0)


def off_focus():
    """Return a camera 25 mm too close to a hyperbolic mirror."""
    mirror = Conic.hyperbola(a=0.028, c=0.0385, rim=0.035)
    return _before(mirror, 2 * 0.0385 - (0.0385 - 0.028) - 0.025, 700.0)


def in_focus():
    """Return a camera in the focus of a hyperbolic mirror."""
    mirror = Conic.hyperbola(a=0.028, c=0.0385, rim=0.035)
    return _before(mirror, 2 * 0.0385 - (0.0385 - 0.028), 900.0)


def pupil_shift_fisheye():
    """Return a fisheye with an entrance pupil shift of 8 mm at 90 degrees."""
    return PupilShiftFisheye(Equisolid(fx=380.0, fy=380.0, cx=641.2, cy=510.3), 0.008)


def _before(mirror, distance, focal):
    lens = Pinhole(fx=focal, fy=focal, cx=640.3, cy=511.2)
    return MirrorCamera(Catadioptric(lens, (PlacedMirror(mirror, tz=distance),)))


def observe_boards(camera, count, *, seed=0, noise=0.1, reach=(0.15, 1.6), distance=(0.12, 0.6)):
    """Observe boards over the whole field of view.

    Returns
    -------
    views, points
        Observations with noise (px), and the true corners (N, 3) in the camera frame.
    """
    rng = np.random.default_rng(seed)
    board = BOARD.points - BOARD.points.mean(0)
    views, points = [], []
    for _ in range(50 * count):
        if len(views) == count:
            break
        away = rng.uniform(*distance) * polar(np.array(rng.uniform(*reach)), np.array(rng.uniform(0, 2 * np.pi)))
        there = board @ _facing(away, rng).T + away
        pixels, valid = camera.project(there)
        use = valid & np.all((pixels > 0) & (pixels < np.array(SIZE)), axis=1)
        if use.sum() >= 40:
            seen = pixels[use] + noise * rng.standard_normal((use.sum(), 2))
            views.append((BOARD.points[use], seen))
            points.append(there[use])
    assert len(views) == count
    return observe(views, SIZE, unit="m"), np.concatenate(points)


def _facing(away, rng):
    """Return a rotation whose z axis is close to a direction."""
    z = away / np.linalg.norm(away)
    x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
    x /= np.linalg.norm(x)
    upright = np.stack([x, np.cross(z, x), z], -1)
    return so3.exp(rng.normal(0, 0.35, 3)) @ upright @ so3.exp([0, 0, rng.uniform(0, 6.28)])


def cam_from_truth(found, truth):
    """Return the rotation and translation that map true points (N, 3) best to the estimated ones.

    The rotation may be a reflection, because images of planar boards do not determine the handedness.
    """
    a, b = truth.mean(0), found.mean(0)
    u, _, vt = np.linalg.svd((found - b).T @ (truth - a))
    return u @ vt, b - u @ vt @ a


def projection_errors(camera, truth, views, found, points, distance):
    """Return the error (N,), px, of projecting points at a distance along the true rays of corners."""
    rotation, translation = cam_from_truth(found, points)
    pixels, _ = truth.project(points)
    origins, bearings, _ = truth.rays(pixels)
    there = (origins + distance * bearings) @ rotation.T + translation
    return np.linalg.norm(camera.project(there)[0] - pixels, axis=1)


def calibrate_noncentral(central, *, design=None, spline=None):
    """Calibrate a non-central camera as `om.calibrate` does, from one central calibration instead of several models."""
    options = om.CalibrateOptions(flat=True)
    design = None if design is None else om.RayCamera(design, SIZE)
    selection = select_noncentral(central.selection, design, spline, central.observations, options)
    return assess(selection, central.observations, ~central.outliers, central.quality.spline_baseline, options)
