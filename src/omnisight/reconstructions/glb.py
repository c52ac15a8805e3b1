"""glTF 2.0 as one binary file: the points, and the axes of every camera, for Blender and viewers of web pages."""

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.rotation import quaternions
from omnisight.reconstructions._poses import marker_size, up_direction, world_from_cameras
from omnisight.reconstructions._protocol import ExportOptions, OutputFile
from omnisight.sfm.reconstruction import Reconstruction

TITLE = "glTF 2.0"
CONVENTION = (
    "a root node turns the mean up of the images to glTF's y; each camera is a node with the name of its image and axes"
    " x red, y green, z blue"
)
FILE = "model.glb"
GLB_MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
FLOAT, UNSIGNED_BYTE, ARRAY_BUFFER, POINTS, LINES = 5126, 5121, 34962, 0, 1
AXES = np.repeat(np.eye(3), 2, axis=0) * np.tile([[0.0], [1.0]], (3, 1))  # from the centre along x, y and z
AXIS_COLORS = np.repeat(np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255]], np.uint8), 2, axis=0)


def files(reconstruction: Reconstruction, options: ExportOptions) -> list[OutputFile]:
    """Return the file."""
    scene = _Scene()
    children: list[int] = []
    points = reconstruction.points
    if len(points):
        # 32-bit floats resolve a micrometre near their origin only.
        centre = points.position.mean(axis=0)
        mesh = scene.mesh("points", points.position - centre, points.color, POINTS)
        children.append(scene.node(name="points", mesh=mesh, translation=centre.tolist()))
    axes, scale = scene.mesh("camera", AXES, AXIS_COLORS, LINES), marker_size(reconstruction)
    rotations, positions = world_from_cameras(reconstruction)
    for name, position, quaternion in zip(reconstruction.names, positions, quaternions(rotations), strict=True):
        pose = {"translation": position.tolist(), "rotation": quaternion.tolist()}
        children.append(scene.node(name=name, mesh=axes, scale=[scale] * 3, **pose))
    root = scene.node(
        name="reconstruction", rotation=quaternions(_gltf_from_world(reconstruction)).tolist(), children=children
    )
    return [(FILE, scene.to_bytes(root))]


def _gltf_from_world(reconstruction: Reconstruction) -> NDArray[np.float64]:
    """Return a rotation (3, 3) that maps the world's up to y, and the x or z axis of the world into the xy plane."""
    up = up_direction(reconstruction)
    axis = np.eye(3)[0 if abs(up[0]) < 0.9 else 2]  # not parallel to it
    right = axis - (axis @ up) * up
    right /= np.linalg.norm(right)
    return np.array([right, up, np.cross(right, up)])


class _Scene:
    """The parts of a glTF file under construction."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.nodes: list[dict[str, Any]] = []
        self.meshes: list[dict[str, Any]] = []
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def node(self, **fields: Any) -> int:
        """Add a node and return its index."""
        self.nodes.append(fields)
        return len(self.nodes) - 1

    def mesh(self, name: str, positions: NDArray[np.float64], colors: NDArray[np.uint8], mode: int) -> int:
        """Add a mesh of points or lines (N, 3) with colours (N, 3) and return its index."""
        single = positions.astype("<f4")
        limits = {"min": single.min(axis=0).tolist(), "max": single.max(axis=0).tolist()}
        # Vertices start at multiples of four bytes, so colours have a fourth channel.
        opaque = np.column_stack([colors, np.full(len(colors), 255, np.uint8)])
        attributes = {
            "POSITION": self._accessor(single, componentType=FLOAT, type="VEC3", **limits),
            "COLOR_0": self._accessor(opaque, componentType=UNSIGNED_BYTE, normalized=True, type="VEC4"),
        }
        self.meshes.append({"name": name, "primitives": [{"attributes": attributes, "mode": mode}]})
        return len(self.meshes) - 1

    def _accessor(self, values: NDArray[Any], **fields: Any) -> int:
        """Add an array and return the index of its accessor."""
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": values.nbytes, "target": ARRAY_BUFFER}
        self.data += values.tobytes()
        self.views.append(view)
        self.accessors.append({"bufferView": len(self.views) - 1, "count": len(values), **fields})
        return len(self.accessors) - 1

    def to_bytes(self, root: int) -> bytes:
        """Return the file."""
        document = {
            "asset": {"version": "2.0", "generator": "omnisight"},
            "scene": 0,
            "scenes": [{"nodes": [root]}],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.data)}],
        }
        text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), JSON_CHUNK) + text
        chunks += struct.pack("<II", len(self.data), BINARY_CHUNK) + self.data
        return struct.pack("<III", GLB_MAGIC, 2, 12 + len(chunks)) + chunks
