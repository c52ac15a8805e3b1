"""The ground from a calibration board that lies on it, in an image of one camera of a rig."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.calibration.ground_calibration import CameraFit, GroundCalibration
from omnisight.geometry.pose import Pose
from omnisight.pipeline.detection.detect import detect
from omnisight.pipeline.detection.detect_options import DetectOptions
from omnisight.pipeline.inputs.images_of_cameras import camera_name
from omnisight.rig import Rig
from omnisight.twoview.absolute_pose import AbsolutePose, resect
from omnisight.views.image_size import check_size

Array = NDArray[np.float64]


def rig_on_board(rig: Rig, image: Path, options: DetectOptions) -> GroundCalibration:
    """Return the rig in the frame of the ground on which a board lies, printed side up.

    The thickness of the board is neglected. The frame has its origin below that of the rig frame, and its z axis
    below that of the rig frame.

    Parameters
    ----------
    rig
        The rig, with the poses of its cameras, metres.
    image
        Image of one camera, with its name.
    options
        The board; its lengths are needed.

    Raises
    ------
    ValueError
        If the image is of no camera, shows no board, or the board has no lengths or is above the camera.
    """
    name = camera_name(image, rig.names)
    detections = detect([image], options)
    found = detections.images[0].boards
    if not found:
        raise ValueError(
            f"{image}: no board was detected ({detections.images[0].note or 'none'}); see omnisight detect"
        )
    board = found[0].board or detections.board
    if board is None or board.unit != "m":
        raise ValueError(f"{image}: the size of the board is unknown: specify --square, or --target with its lengths")
    check_size(detections.size, rig.cameras[rig.index(name)].size, image)
    calibration = rig_on_plane(rig, name, board.points[found[0].ids], found[0].pixels)
    if not calibration:
        raise ValueError(f"{image}: {calibration.reason}")
    return calibration


def rig_on_plane(rig: Rig, name: str, points: ArrayLike, pixels: ArrayLike) -> GroundCalibration:
    """Return the rig in the frame of the plane of board points (N, 3; z = 0 and down), seen by a camera at pixels."""
    k, pixels = rig.index(name), np.asarray(pixels, float)
    camera = rig.cameras[k]
    _, bearings, valid = camera.rays(pixels)
    points = np.asarray(points, float)[valid]
    found = resect(points, bearings[valid])
    if found.cam_from_world is None:
        return GroundCalibration(rig, {}, {}, f"the pose of the board was not found ({found.reason})")
    rig_from_board = rig.sensor_from_rig[k].inverse() @ found.cam_from_world
    down = rig_from_board.rotation[:, 2]
    forward = np.array([0.0, 0.0, 1.0]) - down[2] * down
    if np.linalg.norm(forward) < 0.5:
        return GroundCalibration(rig, {}, {}, "the z axis of the rig is not forward, but nearly vertical")
    forward /= np.linalg.norm(forward)
    ground_from_rig = np.array([np.cross(down, forward), down, forward], float)
    height = float(down @ rig_from_board.translation)
    rig_from_ground = Pose(ground_from_rig, np.array([0.0, -height, 0.0])).inverse()
    poses = tuple(pose @ rig_from_ground for pose in rig.sensor_from_rig)
    above = -float(poses[k].inverse().translation[1])
    if not above > 0:
        return GroundCalibration(rig, {}, {}, "the board faces down, or its image is mirrored")
    predicted, _ = camera.project(found.cam_from_world @ points)
    residuals = np.linalg.norm(predicted - pixels[valid], axis=1)
    rms = float(np.sqrt(np.mean(residuals[found.inliers] ** 2)))
    fit = CameraFit(rms, found.inliers, above, _height_sigma(found))
    return GroundCalibration(rig.in_frame(poses), {}, {name: fit})


def _height_sigma(found: AbsolutePose) -> float:
    """Return the standard deviation of the height above the board's plane, h = e_z . R^T t, for steps of the pose."""
    assert found.cam_from_world is not None
    r, t = found.cam_from_world.rotation, found.cam_from_world.translation
    gradient = np.concatenate([np.cross(t, r[:, 2]), r[:, 2]])
    return float(np.sqrt(max(gradient @ found.covariance @ gradient, 0.0)))
