"""poses.csv: one line per image with the pose of its camera."""

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import quaternions
from omnisight.images import write_bytes
from omnisight.reconstructions._poses import world_from_cameras
from omnisight.reconstructions._protocol import ExportOptions, OutputFile
from omnisight.sfm.reconstruction import Reconstruction

Array = NDArray[np.float64]

TITLE = "poses.csv"
CONVENTION = "world_from_camera: x y z is the position of the camera; quaternion x y z w; x right, y down, z forward"
FILE = "poses.csv"
HEADER = ("name", "x", "y", "z", "qx", "qy", "qz", "qw")


def files(reconstruction: Reconstruction, options: ExportOptions) -> list[OutputFile]:
    """Return the table of world_from_camera; the names are relative to the image folder."""
    rotations, positions = world_from_cameras(reconstruction)
    return [(FILE, _table(reconstruction.names, rotations, positions))]


def write_poses(path: Path, cam_from_world: Mapping[str, Pose]) -> None:
    """Write the table of world_from_camera of images by name."""
    poses = [pose.inverse() for pose in cam_from_world.values()]
    rotations = np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3)
    positions = np.array([pose.translation for pose in poses]).reshape(-1, 3)
    write_bytes(path, _table(tuple(cam_from_world), rotations, positions))


def _table(names: Sequence[str], rotations: Array, positions: Array) -> bytes:
    """Return the text of the table."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(HEADER)
    for name, position, quaternion in zip(names, positions, quaternions(rotations), strict=True):
        writer.writerow([name, *map(repr, position.tolist()), *map(repr, quaternion.tolist())])
    return stream.getvalue().encode("utf-8", "surrogateescape")
