"""Rotation about the optical axis in the affine map of Scaramuzza's model, which other models do not have."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.models.ocam import Ocam
from omnisight.ray_camera import RayCamera
from omnisight.rig import Rig

Array = NDArray[np.float64]


def with_upright_ocam(rig: Rig) -> Rig:
    """Return the same rig with the rotation in the affine map of its ocam cameras moved to their poses.

    The camera frames turn about their optical axes, and with them `sensor_from_rig` and its covariance. The rays of all
    pixels in the rig frame stay the same.
    """
    pairs = [_upright(camera) for camera in rig.cameras]
    poses = [
        dataclasses.replace(pose, rotation=turn @ pose.rotation, translation=turn @ pose.translation)
        for pose, (_, turn) in zip(rig.sensor_from_rig, pairs, strict=True)
    ]
    covariance = rig.covariance
    if covariance is not None:
        jacobian = np.zeros_like(covariance)
        for k, (_, turn) in enumerate(pairs):
            for start in (6 * k, 6 * k + 3):
                jacobian[start : start + 3, start : start + 3] = turn
        covariance = jacobian @ covariance @ jacobian.T
    cameras = tuple(camera for camera, _ in pairs)
    return dataclasses.replace(rig, cameras=cameras, sensor_from_rig=tuple(poses), covariance=covariance)


def _upright(camera: Camera | RayCamera) -> tuple[Camera | RayCamera, Array]:
    """Return a camera without rotation in its affine map, and the rotation upright_from_camera.

    The polar decomposition of the affine map is a rotation, which the frame takes, and a symmetric stretch S. Its first
    entry s is 1 in the model: the plane is scaled by s, and a_i becomes a_i s^(1 - i).
    """
    if not isinstance(camera, Camera) or not isinstance(model := camera.model, Ocam):
        return camera, np.eye(3)
    u, values, vt = np.linalg.svd([[1.0, model.e], [model.d, model.c]])
    turn, stretch = u @ vt, u @ np.diag(values) @ u.T
    s = float(stretch[0, 0])
    powers = (0, *range(2, len(model.a) + 1))
    a = tuple(float(value * s ** (1 - i)) for i, value in zip(powers, model.a, strict=True))
    c, d = float(stretch[1, 1] / s), float(stretch[0, 1] / s)
    rotation = np.eye(3)
    rotation[:2, :2] = turn
    return dataclasses.replace(camera, model=dataclasses.replace(model, c=c, d=d, e=d, a=a)), rotation
