"""nerfstudio's transforms.json with the pose of every image, and the points as a PLY file beside it."""

import json
from typing import Any

import numpy as np

from omnisight.camera import Camera
from omnisight.conversion import convert_model
from omnisight.formats._export import MAX_REFIT_ERROR_PX
from omnisight.formats.nerfstudio import MODELS, serialize
from omnisight.reconstructions._poses import world_from_cameras
from omnisight.reconstructions._protocol import ExportOptions, OutputFile
from omnisight.reconstructions.ply import ply
from omnisight.sfm.reconstruction import Reconstruction

TITLE = "nerfstudio transforms.json"
CONVENTION = (
    "world_from_camera with OpenGL's axes (x right, y up, z back); the centre of the top-left pixel is (0.5, 0.5);"
    " images are in the folder images beside it"
)
FILE, POINTS_FILE, IMAGE_FOLDER = "transforms.json", "sparse_pc.ply", "images"
OPENGL_AXES = np.array([1.0, -1.0, -1.0])  # columns of a rotation world_from_camera


def files(reconstruction: Reconstruction, options: ExportOptions) -> list[OutputFile]:
    """Return the file of the cameras and the file of the points."""
    cameras = [_camera(reconstruction, sensor) for sensor in range(len(reconstruction.rig))]
    kinds = sorted({camera["camera_model"] for camera in cameras})
    if len(kinds) > 1:
        raise ValueError(f"it has one camera_model, and these cameras need {' and '.join(kinds)}: export --to splat")
    shared = cameras[0] if len(cameras) == 1 else {"camera_model": kinds[0]}
    frames: list[dict[str, Any]] = []
    for image, (rotation, position) in enumerate(zip(*world_from_cameras(reconstruction), strict=True)):
        matrix = np.vstack([np.column_stack([rotation * OPENGL_AXES, position]), [0, 0, 0, 1]])
        own = cameras[reconstruction.sensor[image]] if len(cameras) > 1 else {}
        path = f"{IMAGE_FOLDER}/{reconstruction.names[image]}"
        frames.append({"file_path": path, **own, "transform_matrix": matrix.tolist()})
    points = reconstruction.points
    text = json.dumps({**shared, "ply_file_path": POINTS_FILE, "frames": frames}, indent=1, allow_nan=False) + "\n"
    return [(POINTS_FILE, ply(points.position, points.color)), (FILE, text.encode())]


def _camera(reconstruction: Reconstruction, sensor: int) -> dict[str, Any]:
    """Return the fields of a camera; raise ValueError with the remedy if nerfstudio cannot represent it."""
    camera, name = reconstruction.rig.cameras[sensor], reconstruction.rig.names[sensor]
    if not isinstance(camera, Camera):
        raise ValueError(f"camera {name} is non-central ({camera.model.name}): export --to splat")
    try:
        fields = json.loads(serialize(camera if camera.model.name in MODELS else _fisheye(camera))[0])
    except ValueError as error:
        raise ValueError(f"camera {name}: nerfstudio {error}: --to splat exports views") from error
    return {key: value for key, value in fields.items() if key not in ("frames", *camera.extra)}


def _fisheye(camera: Camera) -> Camera:
    """Return the fisheye of nerfstudio that fits a camera; raise ValueError if none does."""
    fitted = convert_model(camera, MODELS[0])
    if not fitted.max_px <= MAX_REFIT_ERROR_PX:
        raise ValueError(f"cannot represent {camera.model.name}, {MODELS[0]} is {fitted.max_px:.2g} px off")
    return fitted.camera
