"""Height of the camera above the ground, in units of the world, from points below it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.visual_odometry.scale_estimate import MIN_MEASUREMENTS, ScaleEstimate, robust_mean

Array = NDArray[np.float64]

# Angle (radians) between the ground's normal and the camera's vertical axis: hand-held cameras tilt.
MAX_TILT_RAD = np.radians(20.0)
# Angle (radians) below the horizon of points on the ground: flatter ones are known less precisely.
MIN_DEPRESSION_RAD = np.radians(15.0)
# Distance from the plane, as a share of the height, of its points: the error of a distance at a parallax of 2 degrees.
TOLERANCE = 0.04
# Points of the plane, samples of three that the search draws, and fits to its points.
MIN_POINTS, SAMPLES, REFINEMENTS = 12, 200, 3
# Share of the points below the horizon that are below the plane: reflections and wrong points.
MAX_BELOW_SHARE = 0.25
# Standard deviation (metres) of the height of a camera that a person measures.
HEIGHT_SIGMA_M = 0.01
# Keyframes per independent measurement: those of a window share points.
BLOCK = 8


@dataclass(frozen=True, eq=False)
class GroundHeight:
    """A plane below the camera: its height, in units of the world, and its number of points."""

    frame: int
    height: float
    points: int


def ground_height(frame: int, points: Array, rig_from_world: Pose, down: Array) -> GroundHeight | None:
    """Find the ground below a camera.

    The ground is the plane with the most points, less those below it.

    Parameters
    ----------
    frame
        Index of the frame.
    points
        (P, 3) in the world.
    rig_from_world
        Pose of the camera.
    down
        (3,) approximate direction of the vertical in its frame.

    Returns
    -------
    The plane; None if there is none.
    """
    x = rig_from_world @ points
    depth = x @ down
    x = x[depth > np.sin(MIN_DEPRESSION_RAD) * np.linalg.norm(x, axis=1)]
    if len(x) < MIN_POINTS:
        return None
    samples = np.random.default_rng(frame).integers(0, len(x), (SAMPLES, 3))
    a, b, c = (x[samples[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    normals *= np.where(normals @ down < 0, -1.0, 1.0)[:, None]
    heights = (normals * a).sum(axis=1)
    usable = (normals @ down > np.cos(MAX_TILT_RAD)) & (heights > 0)
    if not usable.any():
        return None
    normals, heights = normals[usable], heights[usable]
    relative = x @ normals.T / heights - 1.0
    score = (np.abs(relative) < TOLERANCE).sum(axis=0) - (relative > TOLERANCE).sum(axis=0)
    plane = normals[score.argmax()] / heights[score.argmax()]
    on = np.zeros(len(x), np.bool_)
    for _ in range(REFINEMENTS):
        on = np.abs(x @ plane - 1.0) < TOLERANCE
        if on.sum() < MIN_POINTS:
            return None
        plane = np.linalg.lstsq(x[on], np.ones(int(on.sum())), rcond=None)[0]
    below = int((x @ plane > 1.0 + 2 * TOLERANCE).sum())
    if below > MAX_BELOW_SHARE * len(x) or plane @ down < np.cos(MAX_TILT_RAD) * np.linalg.norm(plane):
        return None
    return GroundHeight(frame, 1.0 / float(np.linalg.norm(plane)), int(on.sum()))


def scale_from_height(heights: list[GroundHeight], metres: float) -> ScaleEstimate:
    """Return the scale, given the height of the camera in metres.

    Its uncertainty includes that of the height, which a person measures, and which differs by the load of a vehicle.
    """
    source = "the height over the ground"
    if len(heights) < MIN_MEASUREMENTS:
        return ScaleEstimate(source, reason=f"the ground is visible in {len(heights)} keyframes: too few points on it")
    blocks = np.array_split(np.array([h.height for h in heights]), max(len(heights) // BLOCK, 1))
    values = (
        np.array([np.median(block) for block in blocks])
        if len(blocks) >= MIN_MEASUREMENTS
        else np.array([h.height for h in heights])
    )
    height, sigma = robust_mean(values)
    return ScaleEstimate.checked(source, metres / height, float(np.hypot(sigma / height, HEIGHT_SIGMA_M / metres)))
