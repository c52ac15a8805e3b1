"""Fields of calibration files, kept in `Camera.extra`, that depend on the frame or on the pixels of the camera."""

from collections.abc import Mapping
from typing import Any

# Lengths in px: the image circle (aria, nerfstudio), and the focal length times the baseline (stella_vslam).
LENGTHS_PX = ("valid_radius_px", "fisheye_crop_radius", "focal_x_baseline")
PROJECTION = "projection_matrix"  # of the rectified image (ros), 3 x 4
# The part of the sensor that an image shows (ros).
SENSOR_WINDOW = ("binning_x", "binning_y", "roi")
# Angles of the pose (hugin). Other poses are lists or mappings.
POSE_ANGLES = ("y", "p", "r")


def rescaled_fields(fields: Mapping[str, Any], factor: float) -> dict[str, Any]:
    """Return the fields of a camera whose image is resized by a factor."""
    kept = {key: value for key, value in fields.items() if key not in SENSOR_WINDOW}
    kept |= {key: kept[key] * factor for key in LENGTHS_PX if isinstance(kept.get(key), int | float)}
    return kept | ({PROJECTION: _rescaled_projection(kept[PROJECTION], factor)} if PROJECTION in kept else {})


def reflected_fields(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a camera whose frame is reflected.

    Lists and mappings are left out, as they may be poses: a reflected frame has no rotation from another frame.
    """
    return {key: v for key, v in fields.items() if key not in POSE_ANGLES and not isinstance(v, list | tuple | Mapping)}


def _rescaled_projection(value: Any, factor: float) -> Any:
    """Return a projection matrix, a list of 12 numbers or a storage matrix, of the resized image."""
    if isinstance(value, Mapping):
        return {**value, "data": _rescaled_projection(value.get("data"), factor)}
    if not isinstance(value, list) or len(value) != 12:
        return value
    shift = (factor - 1) / 2  # a pixel centre c moves to (c + 1/2) factor - 1/2
    return [x * factor + shift * value[8 + i % 4] if i < 8 else x for i, x in enumerate(value)]
