"""COLMAP's binary files: cameras.bin, images.bin, points3D.bin, and rigs.bin and frames.bin of COLMAP 4."""

import struct
from collections.abc import Iterable, Sequence

import numpy as np

from omnisight.formats.colmap import CAMERA, COUNT, MODEL_NUMBERS
from omnisight.reconstructions._colmap_model import ColmapModel, colmap_model
from omnisight.reconstructions._protocol import ExportOptions, OutputFile
from omnisight.sfm.reconstruction import Reconstruction

TITLE = "COLMAP binary"
CONVENTION = (
    "cam_from_world, quaternion w x y z; the centre of the top-left pixel is (0.5, 0.5); the frame of a rig is that of"
    " its first camera"
)
POSE = struct.Struct("<7d")
SENSOR = struct.Struct("<iI")  # type, number
CAMERA_SENSOR = 0  # the type of a camera
OBSERVATION = np.dtype([("pixel", "<f8", 2), ("point", "<u8")])


def files(reconstruction: Reconstruction, options: ExportOptions) -> list[OutputFile]:
    """Return the five files."""
    return colmap_binary_files(colmap_model(reconstruction))


def colmap_binary_files(model: ColmapModel) -> list[OutputFile]:
    """Return the five files of a model."""
    return [
        ("cameras.bin", _table(_cameras(model))),
        ("rigs.bin", _table(_rigs(model))),
        ("frames.bin", _table(_frames(model))),
        ("images.bin", _table(_images(model))),
        ("points3D.bin", _table(_points(model))),
    ]


def _table(rows: Sequence[bytes]) -> bytes:
    return COUNT.pack(len(rows)) + b"".join(rows)


def _cameras(model: ColmapModel) -> list[bytes]:
    return [
        CAMERA.pack(number, MODEL_NUMBERS.index(camera.model), *camera.size) + _doubles(camera.params)
        for number, camera in enumerate(model.cameras, 1)
    ]


def _rigs(model: ColmapModel) -> list[bytes]:
    rows: list[bytes] = []
    for number, rig in enumerate(model.rigs, 1):
        head = struct.pack("<II", number, len(rig.sensors) + 1) + SENSOR.pack(CAMERA_SENSOR, rig.reference)
        others = [
            SENSOR.pack(CAMERA_SENSOR, sensor) + b"\x01" + POSE.pack(*pose)  # 1: the pose is known
            for sensor, pose in rig.sensors.items()
        ]
        rows.append(head + b"".join(others))
    return rows


def _frames(model: ColmapModel) -> list[bytes]:
    rows: list[bytes] = []
    for number, frame in enumerate(model.frames, 1):
        head = struct.pack("<II", number, frame.rig) + POSE.pack(*frame.pose) + struct.pack("<I", len(frame.images))
        data = [SENSOR.pack(CAMERA_SENSOR, camera) + struct.pack("<Q", image) for camera, image in frame.images]
        rows.append(head + b"".join(data))
    return rows


def _images(model: ColmapModel) -> list[bytes]:
    rows: list[bytes] = []
    for number, image in enumerate(model.images, 1):
        observations = np.empty(len(image.pixels), OBSERVATION)
        observations["pixel"], observations["point"] = image.pixels, image.points
        head = struct.pack("<I", number) + POSE.pack(*image.pose) + struct.pack("<I", image.camera)
        name = image.name.encode("utf-8", "surrogateescape") + b"\0"
        rows.append(head + name + COUNT.pack(len(observations)) + observations.tobytes())
    return rows


def _points(model: ColmapModel) -> list[bytes]:
    columns = zip(model.position.tolist(), model.color.tolist(), model.error.tolist(), model.tracks, strict=True)
    return [
        struct.pack("<Q3d3BdQ", number, *position, *color, error, len(track)) + track.astype("<u4").tobytes()
        for number, (position, color, error, track) in enumerate(columns, 1)
    ]


def _doubles(values: Iterable[float]) -> bytes:
    return np.array(list(values), "<f8").tobytes()
