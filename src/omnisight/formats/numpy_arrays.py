"""NumPy's .npz of a camera matrix and coefficients, as scripts save what OpenCV gave them.

The arrays are told by the names that OpenCV's files use (K, mtx, camera_matrix; D, dist, distortion_coefficients; xi),
and mean what they mean there: px, integer pixel = pixel centre, k1 k2 p1 p2 k3, of a fisheye k1 k2 k3 k4. Four
coefficients need a `fisheye` of 0 or 1 beside them. Most such files do not hold the picture's size (`image_size`, width
and height). Nothing is unpickled, and sizes are checked before they are believed.
"""

import io
import math
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np

from omnisight.camera import Camera
from omnisight.formats._binary import to_bytes
from omnisight.formats._checks import build, left_out, refuse
from omnisight.formats._opencv_lens import coefficients_of
from omnisight.formats.opencv import cameras_of

TITLE = "NumPy npz of K and D"
SUFFIX = ".npz"
MODELS = ("kannala_brandt", "mei", "radial_tangential", "rational", "pinhole", "unified")
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; k1 k2 p1 p2 k3 ..., of a fisheye k1 k2 k3 k4"
ZIP, ARRAY = "PK\x03\x04", "\x93NUMPY"
LARGEST = 5_000_000  # bytes of one array
MOST = 100  # arrays
NUMBERS = "biuf"


def matches(text: str) -> bool:
    """Say whether this is a zip file or a NumPy array."""
    return text.startswith((ZIP, ARRAY))


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera, or each of a stereo pair."""
    if text.startswith(ARRAY):
        raise ValueError("a single array without a name; save both with np.savez('camera.npz', K=K, D=D, fisheye=1)")
    try:
        with zipfile.ZipFile(io.BytesIO(to_bytes(text))) as archive:
            members = [info for info in archive.infolist() if info.filename.endswith(".npy")]
            if not 0 < len(members) <= MOST:
                raise ValueError(f"{len(members)} arrays in it; a camera has from 1 to {MOST}")
            data = {info.filename[:-4]: _array(archive, info) for info in members}
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, OSError) as error:
        raise ValueError(f"a damaged npz: {error}") from error
    except Exception as error:
        # zlib.error is none of the above.
        raise ValueError(f"a damaged npz: {error}") if not isinstance(error, ValueError) else error from error
    return cameras_of({key: value for key, value in data.items() if value is not None})


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the bytes, as text."""
    refuse(camera, MODELS)
    name, values = camera.model.name, camera.model.to_dict()
    build(name, values)
    skew = values.get("skew", 0.0)
    arrays: dict[str, Any] = {
        "K": np.array([[values["fx"], skew, values["cx"]], [0.0, values["fy"], values["cy"]], [0.0, 0.0, 1.0]]),
        "D": np.array(coefficients_of(values, name)),
    }
    notes: tuple[str, ...] = ("the picture's size is not known, and so not written",)
    if all(camera.size):
        arrays["image_size"] = np.array(camera.size)
        notes = ()
    if "xi" in values:
        arrays["xi"] = np.array([values["xi"]])
    else:
        arrays["fisheye"] = np.array(int(name == "kannala_brandt"))
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue().decode("latin-1"), notes + left_out(camera)


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Any:
    """Give an array as lists, a single number as it is, and None for what holds no numbers."""
    with archive.open(info) as file:
        data = file.read(LARGEST + 1)
    if len(data) > LARGEST:
        raise ValueError(f"{info.filename[:40]} is larger than {LARGEST} bytes")
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = header(stream)
    if dtype.kind not in NUMBERS:
        return None
    body = data[stream.tell() :]
    if math.prod(shape) * dtype.itemsize != len(body):
        raise ValueError(f"{info.filename[:40]} claims {shape} of {dtype} in {len(body)} bytes")
    found = np.frombuffer(body, dtype).reshape(shape, order="F" if fortran else "C")
    if found.ndim > 2:
        found = found.squeeze()
    return found.tolist() if found.ndim <= 2 else None
