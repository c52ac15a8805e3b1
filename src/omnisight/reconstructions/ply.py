"""PLY files of the points and of the positions of the cameras, for MeshLab, CloudCompare and Open3D."""

import numpy as np
from numpy.typing import NDArray

from omnisight.reconstructions._poses import world_from_cameras
from omnisight.reconstructions._protocol import ExportOptions, OutputFile
from omnisight.sfm.reconstruction import Reconstruction

TITLE = "PLY"
CONVENTION = "binary, little endian; positions in the world frame, as double because coordinates of a map are large"
POINTS_FILE, CAMERAS_FILE = "points.ply", "cameras.ply"
CAMERA_COLOR = (255, 80, 0)  # orange, rare in scenes
VERTEX = np.dtype([(name, "<f8") for name in ("x", "y", "z")] + [(name, "u1") for name in ("red", "green", "blue")])
TYPES = {"<f8": "double", "|u1": "uchar"}


def files(reconstruction: Reconstruction, options: ExportOptions) -> list[OutputFile]:
    """Return the files of the points and of the cameras."""
    points = reconstruction.points
    _, positions = world_from_cameras(reconstruction)
    colors = np.broadcast_to(np.array(CAMERA_COLOR, np.uint8), positions.shape)
    return [(POINTS_FILE, ply(points.position, points.color)), (CAMERAS_FILE, ply(positions, colors))]


def ply(positions: NDArray[np.float64], colors: NDArray[np.uint8]) -> bytes:
    """Return a PLY file of points (N, 3) with colours (N, 3)."""
    vertices = np.empty(len(positions), VERTEX)
    for names, columns in ((("x", "y", "z"), positions), (("red", "green", "blue"), colors)):
        for k, name in enumerate(names):
            vertices[name] = columns[:, k]
    properties = [f"property {TYPES[VERTEX[name].str]} {name}" for name in VERTEX.names or ()]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}", *properties, "end_header"]
    return ("\n".join(header) + "\n").encode() + vertices.tobytes()
