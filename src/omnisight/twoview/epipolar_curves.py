"""Epipolar curves and epipoles in the image of any camera."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.camera import Camera
from omnisight.display import named_tuple_text
from omnisight.geometry.pose import Pose

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Largest distance of a curve from its chords.
TOLERANCE_PX = 0.25
# Steps of a half circle from which the refinement starts: a quarter of a degree each, so a camera with a field of
# view of one degree sees some of their ends.
INITIAL_STEPS = 720
# Refinements of a step by two: the ends of a piece are located within 4e-9 rad.
MAX_REFINEMENTS = 20
# Chords longer than this after all refinements cross the seam of a 360 image.
MAX_JUMP_PX = 1.0


class Epipoles(NamedTuple):
    """Images of the two directions along the baseline.

    Attributes
    ----------
    pixels
        (2, 2) of the direction to the centre of the other camera, and of the opposite one; they can lie outside of the
        image, and are NaN where the model has no pixel.
    visible
        (2,), whether they lie in the image and in the calibrated field of view.
    """

    pixels: Array
    visible: Mask

    __repr__ = named_tuple_text


def epipoles(camera: Camera, cam_from_other: Pose) -> Epipoles:
    """Return the images of the directions to and away from the centre of another camera.

    Raises
    ------
    ValueError
        If the translation is zero.
    """
    direction = _baseline(cam_from_other)
    pixels, visible = _look(camera, np.stack([direction, -direction]))
    return Epipoles(pixels, visible)


def epipolar_curve(camera: Camera, cam_from_other: Pose, bearing: ArrayLike) -> list[Array]:
    """Return the image of the epipolar half-plane of a bearing of another camera.

    The half-plane starts at the baseline and contains the ray of the other camera. It consists of half a great circle
    of directions, from the epipole of the other camera's centre through the direction of the bearing to the opposite
    epipole. All points at positive distances along the bearing are on it, whatever the fields of view.

    Parameters
    ----------
    camera
        The camera in whose image the curve lies, of any model.
    cam_from_other
        Pose of the cameras, x_cam = R x_other + t; the length of t has no effect.
    bearing
        (3,) direction in the frame of the other camera.

    Returns
    -------
    Polylines (K, 2), pixels, that deviate less than 0.25 px from the curve. They end where the curve leaves the image
    or the calibrated field of view, and at the seam of a 360 image. None if the curve is not visible.

    Raises
    ------
    ValueError
        If the translation is zero, or the bearing is parallel to the baseline, where all half-planes meet.
    """
    start = _baseline(cam_from_other)
    through = cam_from_other.rotation @ np.asarray(bearing, float)
    across = through - (through @ start) * start
    length = float(np.linalg.norm(across))
    if not length > 1e-12 * float(np.linalg.norm(through)):
        raise ValueError(f"the bearing {bearing} is parallel to the baseline and has no epipolar curve")
    return project_arc(camera, start, across / length, np.pi)


def project_arc(camera: Camera, first: Array, second: Array, length: float) -> list[Array]:
    """Return the visible pieces (K, 2), px, of the image of the great circle cos(s) first + sin(s) second.

    Parameters
    ----------
    camera
        A camera of any model.
    first, second
        (3,) orthogonal unit vectors.
    length
        The arc ends at this s, radians.
    """
    s = np.linspace(0.0, length, max(2, round(INITIAL_STEPS * length / np.pi)) + 1)
    pixels, visible = _look(camera, _directions(first, second, s))
    open_steps = np.ones(len(s) - 1, np.bool_)
    for _ in range(MAX_REFINEMENTS):
        steps = np.flatnonzero(open_steps & (visible[:-1] | visible[1:]))
        if not len(steps):
            break
        middle = (s[steps] + s[steps + 1]) / 2
        at_middle, visible_middle = _look(camera, _directions(first, second, middle))
        ends_visible = visible[steps] & visible[steps + 1]
        straight = _is_straight(pixels[steps], at_middle, pixels[steps + 1])
        divided = ~(ends_visible & visible_middle & straight)
        open_steps[steps] = divided
        at = steps[divided] + 1
        s = np.insert(s, at, middle[divided])
        pixels = np.insert(pixels, at, at_middle[divided], axis=0)
        visible = np.insert(visible, at, visible_middle[divided])
        open_steps = np.insert(open_steps, at, True)
    return _pieces(pixels, visible, open_steps)


def _pieces(pixels: Array, visible: Mask, open_steps: Mask) -> list[Array]:
    """Return the runs of visible pixels, divided where a step of the curve jumps."""
    with np.errstate(invalid="ignore"):
        jumps = open_steps & (np.linalg.norm(np.diff(pixels, axis=0), axis=1) > MAX_JUMP_PX)
    joined = visible[:-1] & visible[1:] & ~jumps
    ends = np.flatnonzero(np.diff(np.concatenate([[False], joined, [False]]).astype(np.int8)))
    return [pixels[start : stop + 1] for start, stop in zip(ends[::2], ends[1::2], strict=True)]


def _is_straight(start: Array, middle: Array, end: Array) -> Mask:
    """Return which chords (N,) represent the curve: its middle is near the middle of the chord.

    The middle of a chord that crosses the seam is at one of its ends.
    """
    chord = end - start
    with np.errstate(invalid="ignore", divide="ignore"):
        length = np.linalg.norm(chord, axis=1)
        offset = middle - (start + end) / 2
        across = np.abs(chord[:, 0] * offset[:, 1] - chord[:, 1] * offset[:, 0]) / length
        along = np.abs((chord * offset).sum(1)) / length
    return (length < TOLERANCE_PX) | ((across < TOLERANCE_PX) & (along < np.maximum(length / 4, TOLERANCE_PX)))


def _directions(first: Array, second: Array, s: Array) -> Array:
    return np.cos(s)[:, None] * first + np.sin(s)[:, None] * second


def _look(camera: Camera, bearings: Array) -> tuple[Array, Mask]:
    """Return the pixels (N, 2) of bearings (N, 3), and whether they are visible."""
    pixels, valid = camera.model.project_numpy(bearings)  # faster for few points than to load compiled code
    return pixels, valid & camera.in_image(pixels) & camera.calibrated(bearings)


def _baseline(cam_from_other: Pose) -> Array:
    """Return the direction (3,) to the centre of the other camera."""
    length = float(np.linalg.norm(cam_from_other.translation))
    if not length > 0:
        raise ValueError("the translation of the pose is zero: there are no epipoles")
    return cam_from_other.translation / length
