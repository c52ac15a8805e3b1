"""NumPy's .npz of a camera matrix and coefficients, as scripts around OpenCV save them.

The arrays have the names of OpenCV's files (K, mtx, camera_matrix; D, dist, distortion_coefficients; xi) and their
meaning: px, integer pixel = pixel centre, k1 k2 p1 p2 k3, of a fisheye k1 k2 k3 k4. Four coefficients need a `fisheye`
of 0 or 1. Most such files do not hold the image size (`image_size`, width and height). Nothing is unpickled.
"""

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.formats._export import check_supported, dropped_fields
from omnisight.formats._npz import ARRAY_SIGNATURE, NUMBER_KINDS, ZIP_SIGNATURE, read_npz
from omnisight.formats._opencv_lens import CV2_READERS, camera_matrix, coefficients_of
from omnisight.formats._values import build
from omnisight.formats.opencv import SIZE_NOT_WRITTEN, cameras_of

TITLE = "NumPy npz of K and D"
SUFFIX = ".npz"
MODELS = ("kannala_brandt", "mei", "radial_tangential", "rational", "pinhole", "unified")
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; k1 k2 p1 p2 k3 ..., of a fisheye k1 k2 k3 k4"
COMMENT = ""
READERS = CV2_READERS


def matches(text: str) -> bool:
    """Return whether this is a zip file or a NumPy array."""
    return text.startswith((ZIP_SIGNATURE, ARRAY_SIGNATURE))


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera, or each of a stereo pair."""
    if text.startswith(ARRAY_SIGNATURE):
        raise ValueError("a single array without a name; save both with np.savez('camera.npz', K=K, D=D, fisheye=1)")
    lists = {key: _to_list(value) for key, value in read_npz(text).items() if value.dtype.kind in NUMBER_KINDS}
    return cameras_of({key: value for key, value in lists.items() if value is not None})


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the bytes of the file as text."""
    check_supported(camera, MODELS)
    name, values = camera.model.name, camera.model.to_dict()
    build(name, values)
    arrays: dict[str, Any] = {"K": np.array(camera_matrix(values)), "D": np.array(coefficients_of(values, name))}
    notes: tuple[str, ...] = (SIZE_NOT_WRITTEN,)
    if all(camera.size):
        arrays["image_size"] = np.array(camera.size)
        notes = ()
    if "xi" in values:
        arrays["xi"] = np.array([values["xi"]])
    else:
        arrays["fisheye"] = np.array(int(name == "kannala_brandt"))
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue().decode("latin-1"), notes + dropped_fields(camera)


def _to_list(array: NDArray[Any]) -> Any:
    """Return an array as lists, or None if it has more than two dimensions."""
    flat = array.squeeze() if array.ndim > 2 else array
    return flat.tolist() if flat.ndim <= 2 else None
