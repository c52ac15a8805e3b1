"""Performance of a mirror design by ray tracing: blind spot, resolution, viewpoint, sensitivity to misalignment."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from omnisight.display import Displayed
from omnisight.geometry.sphere import angle_from_axis
from omnisight.optics.catadioptric import Catadioptric
from omnisight.optics.design.mirror_design import MirrorDesign
from omnisight.optics.ray_jacobians import ray_jacobians
from omnisight.optics.viewpoint import Viewpoint, best_viewpoint

Array = NDArray[np.float64]

# Samples of the resolution curve, and rings and spokes of the pixels for the viewpoint.
CURVE_SAMPLES, RINGS, SPOKES = 400, 12, 24
# Inner image radius as a share of the outer one; the apex of a cone reflects nothing.
MIN_RADIUS_FRACTION = 1e-6
# Outer image radius as a share of the nominal one: inside by rounding, or to stay on a displaced mirror.
EDGE_FRACTION = 1 - 1e-9
DISPLACED_EDGE_FRACTION = 0.98
# Displacements larger than this share of the rim radius are skipped: the mirror would leave the lens's view.
MAX_DISPLACEMENT_FRACTION = 0.25
# Tolerance of the field of view, for rounding.
FIELD_TOLERANCE_DEG = 1e-3
# Misalignments of the mirror, by description.
MISALIGNMENTS = {
    "as designed": {},
    "0.1 mm axial": {"along": 1e-4},
    "1 mm axial": {"along": 1e-3},
    "0.1 mm lateral": {"across": 1e-4},
    "1 mm lateral": {"across": 1e-3},
    "tilt 0.1°": {"tilt": float(np.radians(0.1))},
    "tilt 1°": {"tilt": float(np.radians(1.0))},
}


@dataclass(frozen=True)
class Resolution(Displayed):
    """Angular resolution of the image, from the blind spot outwards to the rim.

    Attributes
    ----------
    theta
        (N,) angles from straight down, radians; the elevation is theta - pi/2.
    radius
        (N,) image radii, px.
    up
        (N,) px per radian of elevation.
    around
        (N,) px per radian along the horizontal great circle: per radian of azimuth, over sin(theta).
    """

    theta: Array
    radius: Array
    up: Array
    around: Array

    def at(self, theta: Array) -> "Resolution":
        """Return the resolution at other angles, by linear interpolation."""
        order = np.argsort(self.theta)
        known = self.theta[order]
        radius, up, around = (np.interp(theta, known, v[order]) for v in (self.radius, self.up, self.around))
        return Resolution(theta, radius, up, around)


@dataclass(frozen=True)
class BlindSpot(Displayed):
    """The region below the camera where it sees only itself, or nothing: the hole of the mirror.

    Attributes
    ----------
    theta
        Half angle of the region around straight down, radians.
    radius
        Radius of the region in the image, px.
    """

    theta: float
    radius: float


@dataclass(frozen=True)
class Misalignment(Displayed):
    """The effect of a misaligned mirror.

    Attributes
    ----------
    description
        The misalignment, such as "0.1 mm lateral".
    rms, worst
        Distance of the rays from their best viewpoint, metres.
    rms_px, worst_px
        Parallax at the working distance, px. Calibration of a central model cannot remove it.
    moved_px
        Largest image displacement, px. Calibration determines it.
    """

    description: str
    rms: float
    worst: float
    rms_px: float
    worst_px: float
    moved_px: float


@dataclass(frozen=True)
class Performance(Displayed):
    """The performance of a mirror design."""

    blind: BlindSpot
    resolution: Resolution
    viewpoint: Viewpoint
    misalignments: tuple[Misalignment, ...]


def blind_spot(design: MirrorDesign) -> BlindSpot:
    """Compute the blind spot: pixels whose rays hit the camera body. A telecentric lens is as wide as the mirror."""
    system = design.system()
    lens_radius = max(design.specification.body / 2, design.mirror.rim if design.focal is None else 0.0)

    def clearance(radius: float) -> float:
        """Return the distance from the body at which the ray of an image radius passes the lens plane."""
        origin, bearing, _ = system.rays(_right(design, np.array(radius)))
        if bearing[2] >= 0:
            return np.inf
        return float(np.hypot(*(origin - origin[2] / bearing[2] * bearing)[:2])) - lens_radius

    hole = design.image_radius(design.mirror.hole)
    first, last = max(MIN_RADIUS_FRACTION * design.circle, hole / EDGE_FRACTION), design.circle * EDGE_FRACTION
    if clearance(last) <= 0:
        return BlindSpot(design.specification.theta, design.circle)
    if clearance(first) >= 0:  # a cone and a mirror with a hole show nothing straight down
        return BlindSpot(float(_theta(system.rays(_right(design, np.array(first))).bearings)), hole)
    radius = float(brentq(clearance, first, last))  # pyright: ignore[reportArgumentType]
    return BlindSpot(float(_theta(system.rays(_right(design, np.array(radius))).bearings)), radius)


def resolution(design: MirrorDesign, first: float) -> Resolution:
    """Compute the resolution from an image radius (px) outwards to the rim."""
    innermost = max(first, design.image_radius(design.mirror.hole)) / EDGE_FRACTION
    radii = np.linspace(
        max(innermost, MIN_RADIUS_FRACTION * design.circle), design.circle * EDGE_FRACTION, CURVE_SAMPLES
    )
    jacobians = ray_jacobians(design.system(), _right(design, radii))
    theta = _theta(jacobians.rays.bearings)
    # By symmetry the bearing moves within its meridional plane along u, and across it along v.
    along, across = (np.linalg.norm(jacobians.d_bearings[..., k], axis=-1) for k in range(2))
    return Resolution(theta, radii, 1 / along, 1 / across)


def viewpoint(design: MirrorDesign, blind: BlindSpot, **moved: float) -> Viewpoint:
    """Estimate the best viewpoint of the image outside the blind spot; `moved` as in `MirrorDesign.system`."""
    edge = DISPLACED_EDGE_FRACTION * design.circle
    # Rings of equal area weight the image by area.
    radii = np.sqrt(np.linspace(min(blind.radius, 0.9 * edge) ** 2, edge**2, RINGS + 1)[1:])
    phi = 2 * np.pi * np.arange(SPOKES) / SPOKES
    pixels = np.array(design.centre) + radii[:, None, None] * np.stack([np.cos(phi), np.sin(phi)], -1)
    return best_viewpoint(design.system(**moved), pixels)


def misalignments(design: MirrorDesign, blind: BlindSpot) -> tuple[Misalignment, ...]:
    """Evaluate the viewpoint for every entry of `MISALIGNMENTS` that keeps the mirror in the lens's view.

    Raises
    ------
    ValueError
        If the working distance is smaller than the mirror or than the distance of a ray from the viewpoint.
    """
    distance, rim = design.specification.working_distance, design.mirror.rim
    if distance <= rim:
        raise ValueError(
            f"the working distance {1e3 * distance:.4g}mm is inside the mirror, which is {2e3 * rim:.4g}mm wide: use a"
            " larger working distance"
        )
    results: list[Misalignment] = []
    for description, moved in MISALIGNMENTS.items():
        if max(moved.get("along", 0.0), moved.get("across", 0.0)) > MAX_DISPLACEMENT_FRACTION * rim:
            continue
        point = viewpoint(design, blind, **moved)
        if point.worst >= distance:
            raise ValueError(
                f"rays miss the viewpoint by up to {1e3 * point.worst:.3g}mm, more than the working distance"
                f" {1e3 * distance:.4g}mm: use a larger working distance"
            )
        error = point.parallax(distance)
        rms = float(np.sqrt(np.mean(error**2)))
        shift = _max_image_shift(design, design.system(**moved), point.pixels)
        results.append(Misalignment(description, point.rms, point.worst, rms, float(error.max()), shift))
    return tuple(results)


def _max_image_shift(design: MirrorDesign, moved: Catadioptric, pixels: Array) -> float:
    """Return the largest image displacement (px) of distant points at pixels (N, 2)."""
    rays, _, d_bearings = ray_jacobians(moved, pixels)
    turn = design.system().rays(pixels).bearings - rays.bearings
    both = np.isfinite(turn).all(1) & np.isfinite(d_bearings).all((1, 2))  # not in the hole of either
    return float(np.linalg.norm(np.linalg.pinv(d_bearings[both]) @ turn[both, :, None], axis=1).max())


def evaluate_design(design: MirrorDesign) -> Performance:
    """Evaluate a mirror design.

    Raises
    ------
    ValueError
        If the camera body hides a part of the specified field of view.
    """
    blind = blind_spot(design)
    down, hidden = np.degrees([design.specification.down, blind.theta])
    if down > 90 - hidden + FIELD_TOLERANCE_DEG:
        raise ValueError(
            f"the camera body hides everything more than {np.floor(900 - 10 * hidden) / 10:.1f} degrees below the"
            f" horizon, --down is {down:.4g}: reduce --down, or use a larger mirror, a larger distance or a smaller"
            " body"
        )
    return Performance(blind, resolution(design, blind.radius), viewpoint(design, blind), misalignments(design, blind))


def _right(design: MirrorDesign, radius: Array) -> Array:
    """Return the pixels (..., 2) at a distance (px) to the right of the axis."""
    u, v = design.centre
    return np.stack([u + radius, np.full_like(radius, v)], -1)


def _theta(bearings: Array) -> Array:
    """Return the angle from straight down (towards the lens)."""
    return angle_from_axis(-bearings)
