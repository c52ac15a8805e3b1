"""What a mirror camera shows, how finely, and how much it minds being put together badly: all by tracing rays."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from omnisight.geometry.sphere import angle_from_axis
from omnisight.optics.catadioptric import Catadioptric
from omnisight.optics.design.mirror_design import MirrorDesign
from omnisight.optics.ray_jacobians import ray_jacobians
from omnisight.optics.viewpoint import Viewpoint, best_viewpoint

Array = NDArray[np.float64]

# Radii of the image that a curve has, and rings and spokes of the pixels that a viewpoint is sought for.
CURVE, RINGS, SPOKES = 400, 12, 24
# A share of the image's radius: its very middle, a cone's tip, has no direction.
FIRST = 1e-6
# The rim itself may be missed by rounding, or by a mirror out of its place.
EDGE = 1 - 1e-9
MOVED_EDGE = 0.98
# A mirror that is moved by more than this share of its rim is no longer before the lens.
LEFT = 0.25
# Degrees by which a field may be missed, for rounding.
SLACK = 1e-3
# Where the mirror is put, by what is said of it.
PLACES = {
    "as designed": {},
    "0.1 mm too far": {"along": 1e-4},
    "1 mm too far": {"along": 1e-3},
    "0.1 mm across": {"across": 1e-4},
    "1 mm across": {"across": 1e-3},
    "tilted 0.1°": {"tilt": float(np.radians(0.1))},
    "tilted 1°": {"tilt": float(np.radians(1.0))},
}


@dataclass(frozen=True)
class Resolution:
    """How finely the image shows elevations, from the rim inwards to the blind spot.

    Attributes
    ----------
    theta
        (N,) angles from straight down, radians; the elevation is theta - pi/2.
    radius
        (N,) of the image, px.
    up
        (N,) px per radian of elevation.
    around
        (N,) px per radian of a great circle across it: per radian of azimuth, over sin(theta).
    """

    theta: Array
    radius: Array
    up: Array
    around: Array

    def at(self, theta: Array) -> "Resolution":
        """Give it at other angles, between those that it has."""
        order = np.argsort(self.theta)
        own = self.theta[order]
        radius, up, around = (np.interp(theta, own, v[order]) for v in (self.radius, self.up, self.around))
        return Resolution(theta, radius, up, around)


@dataclass(frozen=True)
class BlindSpot:
    """Where the camera sees itself, or nothing.

    Attributes
    ----------
    theta
        From straight down to this angle (radians) nothing else is seen.
    radius
        Of the spot in the image, px.
    """

    theta: float
    radius: float


@dataclass(frozen=True)
class Misalignment:
    """What is left of the single viewpoint with the mirror out of its place.

    Attributes
    ----------
    said
        What is wrong, such as "0.1 mm across".
    rms, worst
        Distance of rays from their best viewpoint, metres.
    rms_px, worst_px
        Their parallax at the working distance, px: no calibration mends it.
    moved_px
        How far the image moves at most, px: for one who relies on the drawing; calibration finds it.
    """

    said: str
    rms: float
    worst: float
    rms_px: float
    worst_px: float
    moved_px: float


@dataclass(frozen=True)
class Performance:
    """What a design comes to."""

    blind: BlindSpot
    resolution: Resolution
    viewpoint: Viewpoint
    misalignments: tuple[Misalignment, ...]


def blind_spot(design: MirrorDesign) -> BlindSpot:
    """Find the pixels whose rays come back to the camera's own body; a telecentric lens is as wide as the mirror."""
    system = design.system()
    lens_radius = max(design.order.body / 2, design.mirror.rim if design.focal is None else 0.0)

    def beside(radius: float) -> float:
        """Give how far from the body a ray passes the height of the lens."""
        origin, bearing, _ = system.rays(_right(design, np.array(radius)))
        if bearing[2] >= 0:
            return np.inf
        return float(np.hypot(*(origin - origin[2] / bearing[2] * bearing)[:2])) - lens_radius

    first, last = FIRST * design.circle, design.circle * EDGE
    if beside(last) <= 0:
        return BlindSpot(design.order.theta, design.circle)
    if beside(first) >= 0:  # a cone shows nothing straight down
        return BlindSpot(float(_theta(system.rays(_right(design, np.array(first))).bearings)), 0.0)
    radius = float(brentq(beside, first, last))  # pyright: ignore[reportArgumentType]
    return BlindSpot(float(_theta(system.rays(_right(design, np.array(radius))).bearings)), radius)


def resolution(design: MirrorDesign, first: float) -> Resolution:
    """Trace the image from a radius (px) outwards to the rim."""
    radii = np.linspace(max(first, FIRST * design.circle), design.circle * EDGE, CURVE)
    found = ray_jacobians(design.system(), _right(design, radii))
    theta = _theta(found.rays.bearings)
    # With all azimuths alike, the bearing moves in its meridional plane along u, and across it along v.
    along, across = (np.linalg.norm(found.d_bearings[..., k], axis=-1) for k in range(2))
    return Resolution(theta, radii, 1 / along, 1 / across)


def viewpoint(design: MirrorDesign, blind: BlindSpot, **moved: float) -> Viewpoint:
    """Find the best viewpoint for all of the image outside of the blind spot; `moved` as in `MirrorDesign.system`."""
    edge = MOVED_EDGE * design.circle
    # Rings of equal area, so that the image's area is what counts.
    radii = np.sqrt(np.linspace(min(blind.radius, 0.9 * edge) ** 2, edge**2, RINGS + 1)[1:])
    phi = 2 * np.pi * np.arange(SPOKES) / SPOKES
    pixels = np.array(design.centre) + radii[:, None, None] * np.stack([np.cos(phi), np.sin(phi)], -1)
    return best_viewpoint(design.system(**moved), pixels)


def misalignments(design: MirrorDesign, blind: BlindSpot) -> tuple[Misalignment, ...]:
    """Put the mirror out of its place in every way, and see what becomes of the viewpoint.

    A mirror so small that the lens would hardly see it any more is not moved so far.

    Raises
    ------
    ValueError
        If things at the working distance lie within the mirror, or between the rays.
    """
    if design.order.working_distance <= design.mirror.rim:
        raise ValueError(
            f"the mirror is {2e3 * design.mirror.rim:.4g}mm wide: what is {1e3 * design.order.working_distance:.4g}mm"
            " from the viewpoint lies within it; give a larger working distance"
        )
    found: list[Misalignment] = []
    for said, moved in PLACES.items():
        if max(moved.get("along", 0.0), moved.get("across", 0.0)) > LEFT * design.mirror.rim:
            continue
        point = viewpoint(design, blind, **moved)
        if point.worst >= design.order.working_distance:
            raise ValueError(
                f"rays pass the viewpoint at up to {1e3 * point.worst:.3g}mm, and the working distance is"
                f" {1e3 * design.order.working_distance:.4g}mm: give a larger one"
            )
        error = point.parallax(design.order.working_distance)
        rms = float(np.sqrt(np.mean(error**2)))
        shift = _shift(design, design.system(**moved), point.pixels)
        found.append(Misalignment(said, point.rms, point.worst, rms, float(error.max()), shift))
    return tuple(found)


def _shift(design: MirrorDesign, moved: Catadioptric, pixels: Array) -> float:
    """Give how far (px) what lies in the directions of pixels (N, 2) is seen from there at most, far things."""
    rays, _, d_bearings = ray_jacobians(moved, pixels)
    turn = design.system().rays(pixels).bearings - rays.bearings
    return float(np.linalg.norm(np.linalg.pinv(d_bearings) @ turn[:, :, None], axis=1).max())


def evaluate_design(design: MirrorDesign) -> Performance:
    """Find all of it.

    Raises
    ------
    ValueError
        If the camera's own body hides some of the field asked for.
    """
    blind = blind_spot(design)
    down, hidden = np.degrees([design.order.down, blind.theta])
    if down > 90 - hidden + SLACK:
        raise ValueError(
            f"the camera hides what is more than {np.floor(900 - 10 * hidden) / 10:.1f} degrees below the horizon,"
            f" --down is {down:.4g}:"
            " ask for less, or for a larger mirror, more distance or a smaller body"
        )
    return Performance(blind, resolution(design, blind.radius), viewpoint(design, blind), misalignments(design, blind))


def _right(design: MirrorDesign, radius: Array) -> Array:
    """Give the pixels (..., 2) to the right of the axis by so many px."""
    u, v = design.centre
    return np.stack([u + radius, np.full_like(radius, v)], -1)


def _theta(bearings: Array) -> Array:
    """Give the angle from straight down, which is back to the lens."""
    return angle_from_axis(-bearings)
