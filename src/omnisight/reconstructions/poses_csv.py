"""poses.csv: one line per image with the pose of its camera."""

import csv
import io

from omnisight.reconstructions._poses import quaternions, world_from_cameras
from omnisight.reconstructions._protocol import ExportOptions, OutputFile
from omnisight.sfm.reconstruction import Reconstruction

TITLE = "poses.csv"
CONVENTION = "world_from_camera: x y z is the position of the camera; quaternion x y z w; x right, y down, z forward"
FILE = "poses.csv"
HEADER = ("name", "x", "y", "z", "qx", "qy", "qz", "qw")


def files(reconstruction: Reconstruction, options: ExportOptions) -> list[OutputFile]:
    """Return the table of world_from_camera; the names are relative to the image folder."""
    rotations, positions = world_from_cameras(reconstruction)
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(HEADER)
    for name, position, quaternion in zip(reconstruction.names, positions, quaternions(rotations), strict=True):
        writer.writerow([name, *map(repr, position.tolist()), *map(repr, quaternion.tolist())])
    return [(FILE, stream.getvalue().encode("utf-8", "surrogateescape"))]
