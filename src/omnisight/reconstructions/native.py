"""omnisight's own file of a reconstruction, `reconstruction.npz`: nothing is lost.

A zip file of NumPy arrays, which `numpy.load` reads too, and of `reconstruction.json` with the rig and the names. Its
members are not compressed, so a hostile file costs no more memory than its length. Nothing is unpickled.
"""

import io
import json
import math
import zipfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.formats.native import rig_from_json, rig_to_json
from omnisight.geometry.pose import Pose
from omnisight.reconstructions._protocol import ExportOptions, OutputFile
from omnisight.sfm.reconstruction import PointObservations, Points, Reconstruction

TITLE = "omnisight reconstruction"
CONVENTION = "rig_from_world [R | t], x_rig = rig_from_world x_world; integer pixel = pixel centre, top-left is (0, 0)"
FILE = "reconstruction.npz"
TEXT_FILE = "reconstruction.json"
FORMAT, VERSION = "omnisight-reconstruction", 1
MAX_ROTATION_ERROR = 1e-6  # of an entry of R R^T; larger errors are not rounding
# Name: the type and the shape, in which a letter is a count.
ARRAYS = {
    "sensor": ("<i8", "I"),
    "frame": ("<i8", "I"),
    "rig_from_world": ("<f8", "F34"),
    "pose_covariance": ("<f8", "F66"),
    "position": ("<f8", "P3"),
    "covariance": ("<f8", "P33"),
    "color": ("|u1", "P3"),
    "image": ("<i8", "M"),
    "point": ("<i8", "M"),
    "pixels": ("<f8", "M2"),
    "residuals": ("<f8", "M2"),
}
FINITE = ("rig_from_world", "position", "pixels")
# Name: the array whose items it numbers.
INDICES = {"frame": "F", "image": "I", "point": "P"}
DAMAGED = (KeyError, TypeError, AttributeError, IndexError, OverflowError, RecursionError, EOFError)


def files(reconstruction: Reconstruction, options: ExportOptions) -> list[OutputFile]:
    """Return the file."""
    text = _to_json(reconstruction)
    rig_from_json(text["rig"])  # a name that cannot be read is refused now
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr(zipfile.ZipInfo(TEXT_FILE), json.dumps(text, indent=1, allow_nan=False))
        for name, array in _arrays(reconstruction).items():
            member = io.BytesIO()
            typed = np.ascontiguousarray(array, ARRAYS[name][0])
            np.lib.format.write_array(member, typed, version=(1, 0), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), member.getvalue())
    return [(FILE, stream.getvalue())]


def read(path: Path) -> Reconstruction:
    """Read a reconstruction.

    Raises
    ------
    ValueError
        If the file is damaged; the caller adds its name.
    """
    size = path.stat().st_size
    try:
        with zipfile.ZipFile(path) as archive:
            members = {info.filename: info for info in archive.infolist()}
            if any(info.compress_type != zipfile.ZIP_STORED for info in members.values()):
                raise ValueError("its members are compressed, and those of this format are not")
            if sum(info.file_size for info in members.values()) > size:
                raise ValueError(f"its members claim more than its {size} bytes")
            if missing := sorted({TEXT_FILE, *(f"{name}.npy" for name in ARRAYS)} - set(members)):
                raise ValueError(f"{', '.join(missing)} missing")
            text = json.loads(archive.read(TEXT_FILE))
            arrays = {name: _array(name, archive.read(f"{name}.npy")) for name in ARRAYS}
        return _reconstruction(text, arrays)
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError) as error:
        raise ValueError(f"damaged: {error}") from error
    except DAMAGED as error:
        raise ValueError(f"damaged ({type(error).__name__}: {error})") from error


def _to_json(reconstruction: Reconstruction) -> dict[str, Any]:
    """Return the part of a reconstruction that is not in arrays."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "convention": CONVENTION,
        "has_scale": reconstruction.has_scale,
        "origin": reconstruction.origin,
        "rig": rig_to_json(reconstruction.rig),
        "names": list(reconstruction.names),
        "unverified": list(reconstruction.unverified),
    }


def _arrays(reconstruction: Reconstruction) -> dict[str, NDArray[Any]]:
    """Return the arrays by name."""
    points, observations = reconstruction.points, reconstruction.observations
    return {
        "sensor": reconstruction.sensor,
        "frame": reconstruction.frame,
        "rig_from_world": np.array([pose.matrix for pose in reconstruction.rig_from_world]).reshape(-1, 3, 4),
        "pose_covariance": reconstruction.pose_covariance,
        **{name: getattr(points, name) for name in ("position", "covariance", "color")},
        **{name: getattr(observations, name) for name in ("image", "point", "pixels", "residuals")},
    }


def _array(name: str, data: bytes) -> NDArray[Any]:
    """Return the array of a member of the file; its shape is compared with its length before memory is allocated."""
    kind, dimensions = ARRAYS[name]
    stream = io.BytesIO(data)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError(f"{name} is not an array of version 1.0")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    body = data[stream.tell() :]
    if dtype.str != kind or fortran or len(shape) != len(dimensions):
        raise ValueError(f"{name} must be {len(dimensions)}-dimensional of {kind}, got {shape} of {dtype.str}")
    if math.prod(shape) * dtype.itemsize != len(body):
        raise ValueError(f"{name} claims {shape} of {dtype.str} in {len(body)} bytes")
    return np.frombuffer(body, dtype).reshape(shape).copy()


def _reconstruction(text: Any, arrays: Mapping[str, NDArray[Any]]) -> Reconstruction:
    """Return the reconstruction of a file after checking it."""
    if not isinstance(text, dict) or text.get("format") != FORMAT:
        raise ValueError(f'{TEXT_FILE}: "format" is not "{FORMAT}"')
    if type(text.get("version")) is not int or not 1 <= text["version"] <= VERSION:
        raise ValueError(f"version {text.get('version')!r:.40}; this version of omnisight reads {VERSION}: update it")
    rig, names = rig_from_json(text["rig"]), _names(text["names"])
    counts = {"I": len(names), "S": len(rig)}
    for name, array in arrays.items():
        expected = tuple(
            counts.setdefault(key, size) if key.isalpha() else int(key)
            for key, size in zip(ARRAYS[name][1], array.shape, strict=True)
        )
        if array.shape != expected:
            raise ValueError(f"{name} has the shape {array.shape}, expected {expected}")
    for name, items in {**INDICES, "sensor": "S"}.items():
        if not ((arrays[name] >= 0) & (arrays[name] < counts[items])).all():
            raise ValueError(f"{name} must lie between 0 and {counts[items] - 1}")
    for name in FINITE:
        if not np.isfinite(arrays[name]).all():
            raise ValueError(f"{name} has numbers that are not finite")
    return Reconstruction(
        rig=rig,
        names=names,
        sensor=arrays["sensor"].astype(np.intp),
        frame=arrays["frame"].astype(np.intp),
        rig_from_world=_poses(arrays["rig_from_world"]),
        pose_covariance=arrays["pose_covariance"],
        points=Points(arrays["position"], arrays["covariance"], arrays["color"]),
        observations=PointObservations(
            arrays["image"].astype(np.intp), arrays["point"].astype(np.intp), arrays["pixels"], arrays["residuals"]
        ),
        has_scale=text["has_scale"] is True,
        origin=_origin(text.get("origin")),
        unverified=tuple(name for name in names if name in set(text["unverified"])),
    )


def _origin(values: Any) -> tuple[float, float, float] | None:
    """Return latitude, longitude and altitude of the origin of the world."""
    if values is None:
        return None
    latitude, longitude, altitude = (float(value) for value in values)
    if not (abs(latitude) <= 90 and abs(longitude) <= 180 and math.isfinite(altitude)):
        raise ValueError(f"the origin {values!r:.80} is not latitude, longitude and altitude")
    return latitude, longitude, altitude


def _names(names: Any) -> tuple[str, ...]:
    """Return the names of the images; none leads out of the folder of the images."""
    if not isinstance(names, list) or not all(isinstance(name, str) and name for name in names):
        raise ValueError("names must be texts")
    for name in names:
        path = PurePosixPath(name.replace("\\", "/"))
        if path.is_absolute() or ".." in path.parts or "\0" in name or name[1:2] == ":":
            raise ValueError(f"the name {name[:60]!r} of an image is not relative to the folder of the images")
    if len(set(names)) < len(names):
        raise ValueError("two images have the same name")
    return tuple(names)


def _poses(matrices: NDArray[np.float64]) -> tuple[Pose, ...]:
    """Return the poses of matrices (F, 3, 4)."""
    rotations = matrices[:, :, :3]
    errors = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3))
    if errors.size and (errors.max() > MAX_ROTATION_ERROR or (np.linalg.det(rotations) < 0).any()):
        raise ValueError("rig_from_world has a matrix that is not a rotation")
    return tuple(Pose.of_matrix(matrix) for matrix in matrices)
