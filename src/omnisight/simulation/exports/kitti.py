"""The format of KITTI's odometry benchmark: sequences/00 and poses/00.txt."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.models.pinhole import Pinhole
from omnisight.simulation.dataset import MountedCamera
from omnisight.simulation.exports._protocol import ExportFile, SimulatedSequence

DESCRIPTION = """\
kitti/       KITTI's odometry benchmark: sequences/00 with image_2 (the first camera), image_3 ... and times.txt,
             poses/00.txt of the first camera relative to its first image. calib.txt has the projection matrices of
             perspective cameras that are parallel; others are described by camera.json only. Images are links.
"""
NEEDS_IMU, NEEDS_SAMPLES = False, False

# The first colour camera of KITTI; 0 and 1 are gray.
FIRST_IMAGE_FOLDER = 2
# Angle of rotations that are equal, radians.
PARALLEL_RAD = 1e-6


def check(cameras: Sequence[MountedCamera]) -> None:
    """Accept all cameras."""


def files(sequence: SimulatedSequence) -> Iterator[ExportFile]:
    """Return the files of sequence 00."""
    place, count = "kitti/sequences/00", len(sequence.times)
    for k in range(len(sequence.cameras)):
        for frame in range(count):
            name = f"{place}/image_{FIRST_IMAGE_FOLDER + k}/{frame:06d}{sequence.suffix}"
            yield name, sequence.file(k, frame)
    times = sequence.times - sequence.times[0]
    yield f"{place}/times.txt", "".join(f"{time:.6e}\n" for time in times).encode()
    first = sequence.cameras[0].rig_from_camera
    poses = [sequence.world_from_rig(frame) @ first for frame in range(count)]
    from_world = poses[0].inverse()
    rows = [" ".join(f"{value:.9e}" for value in (from_world @ pose).matrix.ravel()) for pose in poses]
    yield "kitti/poses/00.txt", ("\n".join(rows) + "\n").encode()
    matrices = [projection_matrix(camera, sequence.cameras[0]) for camera in sequence.cameras]
    if all(matrix is not None for matrix in matrices):
        lines = [
            f"P{FIRST_IMAGE_FOLDER + k}: " + " ".join(f"{value:.12e}" for value in matrix.ravel())
            for k, matrix in enumerate(matrices)
            if matrix is not None
        ]
        yield f"{place}/calib.txt", ("\n".join(lines) + "\n").encode()


def projection_matrix(camera: MountedCamera, first: MountedCamera) -> NDArray[np.float64] | None:
    """Return the projection matrix (3, 4) from the first camera; None if it is no parallel perspective camera."""
    pose = camera.rig_from_camera.inverse() @ first.rig_from_camera
    if not isinstance(camera.camera, Camera) or not isinstance(camera.camera.model, Pinhole):
        return None
    if not np.allclose(pose.rotation, np.eye(3), atol=PARALLEL_RAD):
        return None
    m = camera.camera.model
    return np.array([[m.fx, 0, m.cx], [0, m.fy, m.cy], [0, 0, 1]]) @ pose.matrix
