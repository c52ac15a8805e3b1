"""Uncertainty of the frame of a camera due to the choice of its model."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import Candidate
from omnisight.geometry import rotation as so3
from omnisight.models import CameraModel
from omnisight.rig import Rig
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]


def frame_covariance(best: Candidate, candidates: Sequence[Candidate], observations: Observations) -> Array:
    """Return the covariance (3, 3) of the orientation of a camera's frame, rad^2, over the candidate models.

    Models that fit the same images equally well can define the axis of the camera differently: a shift of the principal
    point resembles a rotation. For one camera every board pose absorbs it; the extrinsics of a rig do not. It is the
    second moment, weighted by the probabilities of the models, of the rotation that aligns the bearings of each model
    with those of the selected one (Kabsch 1976).
    """
    if not isinstance(best.state.model, CameraModel):
        return np.zeros((3, 3))
    reference, seen = best.state.model.unproject_numpy(observations.pixels)
    moment, total = np.zeros((3, 3)), 0.0
    for candidate in candidates:
        if not candidate.probability or not isinstance(candidate.state.model, CameraModel):
            continue
        bearings, valid = candidate.state.model.unproject_numpy(observations.pixels)
        both = seen & valid
        turn = so3.log(so3.nearest(reference[both].T @ bearings[both]))
        moment += candidate.probability * np.outer(turn, turn)
        total += candidate.probability
    return moment / total if total else moment


def with_frame_covariances(extrinsics: Array, rig: Rig, frames: Sequence[Array]) -> Array:
    """Return the covariance (6 C, 6 C) of the poses of a rig, including that of the frames of its C cameras.

    A frame turned by w turns `sensor_from_rig` by w about the camera; that of the first camera, which is the rig frame,
    turns all others back.

    Parameters
    ----------
    extrinsics
        Covariance of the poses given the frames.
    rig
        The rig; its first camera defines the rig frame.
    frames
        (3, 3) covariance of the orientation of each frame.
    """
    total = extrinsics.copy()
    for c, frame in enumerate(frames):
        derivative = np.zeros((6 * len(rig), 3))
        for k, pose in enumerate(rig.sensor_from_rig):
            if k == 0:
                continue
            if c == 0:
                derivative[6 * k : 6 * k + 3] = -pose.rotation
            elif k == c:
                derivative[6 * k : 6 * k + 3], derivative[6 * k + 3 : 6 * k + 6] = np.eye(3), -so3.hat(pose.translation)
        total += derivative @ frame @ derivative.T
    return total
